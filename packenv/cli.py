"""The ``robotpack`` command line: parsing and exit codes. The work is in :mod:`packenv.commands`.

Exit codes: 0 done, 1 something could not be packed or a check failed, 2 bad input.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

from packenv import __version__
from packenv.commands.reporting import reported

HEURISTIC_NAMES = ("hm", "dblf", "mta", "minz", "first-fit", "random")
UNIT_NAMES = ("m", "cm", "mm", "in")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code.
    """
    arguments = _parser().parse_args(argv)

    def work() -> int:
        code: int = importlib.import_module(f"packenv.commands.{arguments.module}").run(arguments)
        return code

    return reported("robotpack", work)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
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
    _add_items(commands)
    return parser


def _seed(text: str) -> int:
    """A seed as NumPy takes it."""
    value = int(text)
    if not 0 <= value < 2**64:
        raise argparse.ArgumentTypeError(f"{value} is not between 0 and 2^64 - 1")
    return value


def _count(text: str) -> int:
    """A whole number of at least 0."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{value} is not at least 0")
    return value


def _seconds(text: str) -> float:
    """A time of more than 0 and at most 600 s."""
    value = float(text)
    if not 0.0 < value <= 600.0:
        raise argparse.ArgumentTypeError(f"{text} is not more than 0 and at most 600 seconds")
    return value


def _choice(
    parser: argparse.ArgumentParser, flag: str, words: tuple[str, ...], default: str, meaning: str
) -> None:
    """An option that takes one of several words."""
    parser.add_argument(flag, choices=words, default=default, help=f"{meaning} (default: %(default)s)")


def _catalogue_options(parser: argparse.ArgumentParser, default: str | None) -> None:
    parser.add_argument(
        "--catalogue",
        metavar="DIR",
        default=default,
        help="folder of meshes, with objects.csv or bare (default: %(default)s)"
        if default
        else "read the meshes from this folder, not from the one that the plan names",
    )
    parser.add_argument("--unit", choices=UNIT_NAMES, help="unit of the meshes (default: metres)")


def _add_pack(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    pack = commands.add_parser(
        "pack",
        help="plan the packing of an order",
        description="Plan where and in which sequence every item of an order goes.",
    )
    pack.set_defaults(module="pack")
    pack.add_argument("order", metavar="ORDER", type=Path, help="order file: CSV (item,qty) or JSON")
    _catalogue_options(pack, "builtin")
    pack.add_argument(
        "--container",
        default="auto",
        metavar="SIZE|ID|auto",
        help="inner size in metres (0.32x0.32x0.30), a box id, or auto: the smallest box that takes all "
        "(default: %(default)s)",
    )
    pack.add_argument(
        "--boxes", type=Path, metavar="CSV", help="the boxes to choose from (default: assets/boxes.csv)"
    )
    _choice(pack, "--heuristic", HEURISTIC_NAMES, "hm", "how candidates are ranked")
    _choice(
        pack,
        "--constraints",
        ("overlap", "stability", "robot"),
        "robot",
        "what a placement must meet: no overlap; also force balance of the pile; also a way for the "
        "robot to bring it there",
    )
    _choice(
        pack,
        "--stability",
        ("paper", "cautious", "margin", "physics"),
        "cautious",
        "equilibrium; that, and rather what also stands under gravity tilted by 8 degrees with a friction of "
        "0.25; only what does; or equilibrium and a drop in physics, after which the item must lie where it "
        "was planned",
    )
    _choice(
        pack,
        "--contacts",
        ("surface", "paper"),
        "surface",
        "contacts are where surfaces are at most 1.5 mm apart, or, as in the paper, where items "
        "scaled by 1.03 overlap",
    )
    _choice(
        pack,
        "--grasp",
        ("seal", "flat", "paper"),
        "seal",
        "where the vacuum cup may take an item: where it seals (a rough spot where there is no flat "
        "one), flat spots alone, or the centre of the top surface whatever is there",
    )
    pack.add_argument(
        "--clearance",
        type=float,
        default=0.0,
        metavar="METRES",
        help="how far an item may be off sideways at the release and still meet nothing, at most 0.05; less "
        "where it would leave an item without a place (default: %(default)g)",
    )
    pack.add_argument(
        "--rehearse",
        type=_count,
        default=0,
        metavar="N",
        help="carry the plan out in N simulated worlds, the nominal one and N - 1 disturbed ones in which "
        "the robot feels contacts, and plan otherwise where it fails (default: %(default)s)",
    )
    pack.add_argument(
        "--geometry",
        choices=("mesh", "parts"),
        help="plan on the meshes, or on meshes together with the convex parts that stand for them in physics "
        "(default: mesh; parts with --stability physics or --rehearse)",
    )
    pack.add_argument(
        "--restarts",
        type=_count,
        default=3,
        metavar="N",
        help="plan an incomplete order up to N times again with its leftovers first; none with "
        "--container auto (default: %(default)s)",
    )
    _choice(
        pack,
        "--search",
        ("3d", "5d"),
        "3d",
        "stable poses first and perturbed ones as the fallback, or all at once",
    )
    _choice(
        pack,
        "--sequence",
        ("volume", "given"),
        "volume",
        "by non-increasing bounding-box volume, or as the order gives it",
    )
    pack.add_argument(
        "--seed", type=_seed, default=0, metavar="N", help="for heuristics that draw (default: 0)"
    )
    pack.add_argument("--out", type=Path, metavar="PLAN", help="write the plan (JSON)")
    pack.add_argument(
        "--html", type=Path, metavar="PAGE", help="write a page to look at the plan in a browser"
    )
    pack.add_argument("--png", type=Path, metavar="PICTURE", help="write a picture of the packed box")
    pack.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_verify(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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


def _add_view(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    view = commands.add_parser("view", help="write a page or picture of a plan")
    view.set_defaults(module="view")
    view.add_argument("plan", metavar="PLAN", type=Path, help="plan file that pack wrote")
    view.add_argument(
        "-o",
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="page (.html) or picture (.png) to write",
    )
    _catalogue_options(view, None)


def _add_execute(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
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
        "--settle",
        type=_seconds,
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
        "--seed", type=_seed, metavar="N", help="of the disturbances, with --disturb (default: 0)"
    )
    execute.add_argument("--gui", action="store_true", help="watch in PyBullet's window")
    execute.add_argument("--out", type=Path, metavar="FILE", help="write the result (JSON)")
    execute.add_argument("--gif", type=Path, metavar="FILE", help="write an animation")
    execute.add_argument(
        "--html", type=Path, metavar="PAGE", help="write a page with measured and planned poses"
    )
    _catalogue_options(execute, None)
    execute.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_items(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    items = commands.add_parser("items", help="check or prepare the items of a catalogue")
    actions = items.add_subparsers(metavar="ACTION", required=True)
    check = actions.add_parser("check", help="list every mesh and what is wrong with it")
    prepare = actions.add_parser("prepare", help="compute stable poses and heightmaps into the cache")
    for action, module in ((check, "items_check"), (prepare, "items_prepare")):
        action.set_defaults(module=module)
        action.add_argument("catalogue", metavar="DIR", help="folder of meshes, or builtin")
        action.add_argument("--unit", choices=UNIT_NAMES, help="unit of the meshes (default: metres)")
        action.add_argument("--json", action="store_true", help="print the result as JSON")


if __name__ == "__main__":
    sys.exit(main())
