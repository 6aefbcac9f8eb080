"""The words of the command line: every command's arguments."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import Any, NoReturn, get_args

from packenv.cli import numbers
from packenv.cli.bench import add_bench
from packenv.config import UNIT_NAMES, EngineName
from packenv.errors import closest_match
from packenv.planning.options import PRESETS, PlanOptions, grid_rules, rules
from packenv.robot.timing import MotionLimits
from packenv.version import __version__


class _Parser(argparse.ArgumentParser):
    """Tells a mistake in one line; argparse would print the whole usage before it."""

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse what nothing knows here, where the command and so its options are known."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = [name for name in self._option_string_actions if name.startswith("--")]
            word = unknown[0].partition("=")[0]
            near = closest_match(word.lstrip("-"), [name[2:] for name in options])
            self.error(f"unknown argument {word!r}{near.replace(chr(39), chr(39) + '--', 1)}")
        return found, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a word that is none of the choices, with the nearest."""
        if action.choices is not None and value not in action.choices:
            words = [str(word) for word in action.choices]
            hint = closest_match(value, words, f"; choose from {', '.join(words)}")
            raise argparse.ArgumentError(action, f"invalid choice: {value!r:.60}{hint}")


def command_line() -> argparse.ArgumentParser:
    """The parser of the whole command line; what it parses names the ``module`` of its command."""
    parser = _Parser(
        prog="robotpack",
        description="Pack real, non-convex items into a box, check the plan and look at it.",
        epilog="Exit codes: 0 done, 1 something could not be packed or a check failed, 2 bad input.",
    )
    parser.add_argument("--version", action="version", version=f"robotpack {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_pack(commands)
    _add_verify(commands)
    _add_view(commands)
    _add_execute(commands)
    _add_export(commands)
    _add_items(commands)
    add_bench(commands)
    return parser


def number(text: str) -> float | str:
    """A number, or the word ``none``."""
    return "none" if text.lower() == "none" else float(text)


def planning_options(parser: argparse.ArgumentParser, without: Collection[str] = ()) -> None:
    """Add a flag for every option of planning; what is not given is None.

    Experiments and benchmarks take the same words, see :func:`packenv.cli.pack.options_from`.

    Args:
        parser: to add them to.
        without: options that it has a flag of its own for.
    """
    parser.add_argument(
        "--preset",
        choices=tuple(PRESETS),
        default="default",
        help="all options by one word: what measured best, or as the paper has them; single options take "
        "precedence "
        "(default: %(default)s)",
    )
    preset = PlanOptions()
    for name, rule in rules().items():
        if name in without:
            continue
        default = getattr(preset, name)
        shown = f" (default: {default})" if default is not None else ""
        flag = f"--{name.replace('_', '-')}"
        text = rule.meaning + shown
        if name == "heuristic":
            words = f"{{{','.join(rule.words)}}}|MODULE:NAME"
            text = (
                "how candidates are ranked; your own as my_module:my_rule, looked for in this folder, too"
                + shown
            )
            parser.add_argument(flag, metavar=words, help=text)
        elif name == "seed":
            parser.add_argument(flag, type=numbers.seed, metavar="N", help=text)
        elif rule.words:
            parser.add_argument(flag, choices=rule.words, help=text)
        elif rule.whole:
            parser.add_argument(flag, type=numbers.count, metavar="N", help=text)
        elif rule.optional:
            parser.add_argument(flag, type=number, metavar="X|none", help=text)
        else:
            metavar = "METRES" if name == "clearance" else "X"
            parser.add_argument(flag, type=float, metavar=metavar, help=text)
    own_constraint_option(parser)
    parser.add_argument(
        "--cell",
        metavar="FILE|NAME",
        help="robot cell: a cell file, a robot file or a robot's name, see docs/cell.md (default: tx90)",
    )


def grid_options(parser: argparse.ArgumentParser) -> None:
    """Add a flag for every setting of the grid; what is not given is None."""
    preset = PlanOptions().grid
    for name, rule in grid_rules().items():
        flag = f"--{name.removeprefix('n_').replace('_', '-')}"
        text = f"{rule.meaning} (default: {getattr(preset, name)})"
        kind, metavar = (numbers.count, "N") if rule.whole else (float, "METRES")
        parser.add_argument(flag, dest=name, type=kind, metavar=metavar, help=text)


def own_constraint_option(parser: argparse.ArgumentParser) -> None:
    """Add the flag for constraints of the user's own."""
    parser.add_argument(
        "--constraint",
        dest="own_constraints",
        action="append",
        metavar="MODULE:NAME",
        help="a further constraint of your own, as my_module:MyRule; more than one may be given",
    )


def _catalogue_options(parser: argparse.ArgumentParser, without: str | None) -> None:
    parser.add_argument(
        "--catalogue",
        metavar="DIR",
        help=f"folder of meshes, with objects.csv or bare (default: {without})"
        if without
        else "read the meshes from this folder, not from the one that the plan names",
    )
    parser.add_argument(
        "--unit",
        choices=UNIT_NAMES,
        help="unit of the meshes, and of a --container that can be no metres (default: metres)",
    )


def _add_pack(commands: argparse._SubParsersAction[Any]) -> None:
    pack = commands.add_parser(
        "pack",
        help="plan the packing of an order",
        description="Plan where and in which sequence every item of an order goes.",
    )
    pack.set_defaults(module="pack")
    pack.add_argument("order", metavar="ORDER", type=Path, help="order file: CSV (item,qty) or JSON")
    _catalogue_options(pack, "the plan's of --start, else builtin")
    pack.add_argument(
        "--density",
        type=float,
        metavar="KG/M3",
        help="density of the items without a mass (default: masses are estimated from volume and hull volume)",
    )
    pack.add_argument(
        "--container",
        metavar="SIZE|ID|auto",
        help="inner size in metres (0.32x0.32x0.30) or with a unit (320x320x300mm), a box id, or "
        "auto: the smallest box that takes all "
        "(default: the box of --start, else auto)",
    )
    pack.add_argument(
        "--start",
        type=Path,
        metavar="PLAN",
        help="pack into a box that is not empty: that of this plan, with all its items in it, or of a JSON file of "
        "container and items where they were measured (docs/plan-format.md)",
    )
    pack.add_argument(
        "--measured",
        type=Path,
        metavar="POSES",
        help="where the first items of --start really lie: a JSON list of item, position (m) and quat_xyzw",
    )
    pack.add_argument(
        "--boxes", type=Path, metavar="CSV", help="the boxes to choose from (default: assets/boxes.csv)"
    )
    pack.add_argument(
        "--boxes-max",
        type=numbers.at_least_one,
        default=1,
        metavar="N",
        help="use up to N boxes of these kinds: fewest boxes, then least volume; files are numbered then, as "
        "plan-1.json, and --json prints a list of plans (default: %(default)s)",
    )
    pack.add_argument(
        "--workers",
        type=numbers.at_least_one,
        default=1,
        metavar="N",
        help="search in N processes where there is a --budget or --plans; the same --plans give the same plan on any "
        "number (default: %(default)s)",
    )
    planning_options(pack)
    grid_options(pack)
    pack.add_argument("--out", type=Path, metavar="PLAN", help="write the plan (JSON)")
    pack.add_argument(
        "--html", type=Path, metavar="PAGE", help="write a page to look at the plan in a browser"
    )
    pack.add_argument("--png", type=Path, metavar="PICTURE", help="write a picture of the packed box")
    pack.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_verify(commands: argparse._SubParsersAction[Any]) -> None:
    verify = commands.add_parser(
        "verify",
        help="audit a plan from the meshes",
        description="Recompute from the exact meshes, independently of the planner, whether items overlap, "
        "stick out of the container, or could not be put in from above in the plan's sequence; for a plan on "
        "convex parts, from these as well.",
    )
    verify.set_defaults(module="verify")
    verify.add_argument("plan", metavar="PLAN", type=Path, help="plan file that pack wrote")
    _catalogue_options(verify, None)
    verify.add_argument("--json", action="store_true", help="print the report as JSON")


def _add_view(commands: argparse._SubParsersAction[Any]) -> None:
    view = commands.add_parser("view", help="write a page, picture, animation or 3D file of a plan")
    view.set_defaults(module="view")
    view.add_argument("plan", metavar="PLAN", type=Path, help="plan file that pack wrote")
    view.add_argument(
        "-o",
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="page (.html), picture (.png), animation (.gif) or 3D file (.glb) to write",
    )
    _catalogue_options(view, None)


def _add_execute(commands: argparse._SubParsersAction[Any]) -> None:
    execute = commands.add_parser(
        "execute",
        help="carry a plan out in physics",
        description="Let a simulated robot carry a plan out, and measure where every item ends. Success: "
        "nothing collides while items are placed, and at the end every item is inside the container.",
    )
    execute.set_defaults(module="execute")
    execute.add_argument("plan", metavar="PLAN", type=Path, help="plan file that pack wrote")
    execute.add_argument(
        "--closed-loop",
        action="store_true",
        help="feel contacts, measure every item's pose after each placement, and plan the rest again where "
        "it would fail",
    )
    execute.add_argument(
        "--budget",
        type=float,
        metavar="S",
        help="longest time for planning again, in closed loop, all in all; then the plan goes on as it is",
    )
    execute.add_argument(
        "--settle",
        type=numbers.settling,
        default=20.0,
        metavar="S",
        help="longest time for an item to come to rest (default: %(default)g)",
    )
    execute.add_argument(
        "--full-settle", action="store_true", help="wait that long after every item, at rest or not"
    )
    execute.add_argument(
        "--gentle",
        action="store_true",
        help="lower each item until something holds it, instead of letting it drop from 1 cm above its place",
    )
    execute.add_argument(
        "--feel",
        action="store_true",
        help="guarded moves: the robot lowers at half the speed, feels contacts, and tries beside them "
        "before it gives up; part of --closed-loop",
    )
    execute.add_argument(
        "--disturb",
        action="store_true",
        help="in a world that is not quite as planned: other friction, masses, grasps and time step",
    )
    execute.add_argument(
        "--seed", type=numbers.seed, metavar="N", help="of the disturbances, with --disturb (default: 0)"
    )
    execute.add_argument(
        "--heuristic", metavar="NAME|MODULE:NAME", help="plan again, in closed loop, with this rule"
    )
    own_constraint_option(execute)
    execute.add_argument(
        "--engine",
        choices=get_args(EngineName),
        default="auto",
        help="physics engine; auto: PyBullet where it is installed, else MuJoCo (default: %(default)s)",
    )
    execute.add_argument("--gui", action="store_true", help="watch in PyBullet's window (--engine bullet)")
    execute.add_argument("--out", type=Path, metavar="FILE", help="write the result (JSON)")
    execute.add_argument("--gif", type=Path, metavar="FILE", help="write an animation")
    execute.add_argument(
        "--html", type=Path, metavar="PAGE", help="write a page with measured and planned poses"
    )
    _catalogue_options(execute, None)
    execute.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_export(commands: argparse._SubParsersAction[Any]) -> None:
    export = commands.add_parser(
        "export",
        help="write a plan's motions for a robot",
        description="Find a motion of the robot for every step of a plan, from the pick place to the item's "
        "place, and write them with robot, container and meshes as JSON (docs/trajectory.md). Read there what "
        "to check before a real robot moves.",
    )
    export.set_defaults(module="export")
    export.add_argument("plan", metavar="PLAN", type=Path, help="plan file that pack wrote")
    export.add_argument("-o", "--out", type=Path, required=True, metavar="FILE", help="file (.json) to write")
    limits = MotionLimits()
    export.add_argument(
        "--share",
        type=float,
        default=limits.share,
        metavar="X",
        help="of the joints' published speeds that is used, at most 1 (default: %(default)g)",
    )
    export.add_argument(
        "--speed",
        type=float,
        default=limits.speed,
        metavar="X",
        help="largest speed of a held item, m/s (default: %(default)g)",
    )
    _catalogue_options(export, None)


def _add_items(commands: argparse._SubParsersAction[Any]) -> None:
    items = commands.add_parser("items", help="check or prepare the items of a catalogue")
    items.set_defaults(module="items")
    actions = items.add_subparsers(metavar="ACTION", dest="action", required=True)
    check = actions.add_parser("check", help="list every mesh and what is wrong with it")
    prepare = actions.add_parser("prepare", help="compute stable poses and heightmaps into the cache")
    for action in (check, prepare):
        action.add_argument("catalogue", metavar="DIR", help="folder of meshes, or builtin")
        action.add_argument("--unit", choices=UNIT_NAMES, help="unit of the meshes (default: metres)")
        action.add_argument("--json", action="store_true", help="print the result as JSON")
