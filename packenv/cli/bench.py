"""The words of ``robotpack bench``; what it does stands in :mod:`packenv.experiments.command`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, get_args

from packenv.cli import numbers
from packenv.config import UNIT_NAMES, EngineName
from packenv.planning.options import Constraints

EXPERIMENTS = {
    "small-orders": "orders of 3 to 5 items into the smallest of five boxes (the paper's Sec. V-A)",
    "heuristics": "HM, DBLF, MTA, MinZ, auto and GLS on orders of ten (Table 1)",
    "fallback": "which items the fallback places, and how",
    "search5d": "the prioritized search, and all orientations at once",
    "execution-small": "small orders carried out in physics, as execution (Sec. V-C)",
    "execution": "plans of several kinds carried out in physics, nominal and disturbed (Table 2)",
}
"""Those that ``all`` runs, in this sequence."""
FURTHER = {
    "engines": "the same plans carried out in PyBullet and in MuJoCo",
    "early-rest": "the same plans carried out until rest, and with all the time to settle",
    "robustness": "whether what plans say that their piles withstand tells which executions succeed",
}
"""Those that are run when they are named."""
MODULE = "packenv.experiments.command"
BACKENDS = ("auto", "serial", "pebble", "ray")


def add_bench(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the command and its actions."""
    bench = commands.add_parser(
        "bench",
        help="run the paper's experiments, and report",
        description="Run the paper's experiments on any catalogue: rows that are never lost, tables with intervals, "
        "and a report. Stopped and started again with the same words, it goes on.",
    )
    actions = bench.add_subparsers(metavar="EXPERIMENT", dest="action", required=True)
    for name, text in {**EXPERIMENTS, "all": "all of these", **FURTHER}.items():
        _add_experiment(actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}."))
    merge = actions.add_parser("merge", help="put the rows of several shards or runs together, and report")
    merge.add_argument("folders", metavar="DIR", nargs="+", type=Path, help="folders that bench wrote")
    merge.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of the whole")
    report = actions.add_parser("report", help="write table and report of the rows that are there")
    report.add_argument("out", metavar="DIR", type=Path, help="folder that bench wrote")
    for parser in (merge, report):
        _add_output(parser)
    figures = actions.add_parser("figures", help="the paper's figures with the items of a catalogue")
    figures.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("runs/figures"), help="default: %(default)s"
    )
    _add_source(figures)
    for parser in actions.choices.values():
        parser.set_defaults(module=MODULE)


def _add_source(parser: argparse.ArgumentParser) -> None:
    """Options of whatever draws orders of a catalogue and may carry them out."""
    parser.add_argument(
        "--catalogue", default="builtin", metavar="DIR", help="folder of meshes (default: %(default)s)"
    )
    parser.add_argument("--unit", choices=UNIT_NAMES, help="unit of the meshes (default: metres)")
    parser.add_argument(
        "--seed", type=numbers.seed, default=0, metavar="N", help="of the orders (default: %(default)s)"
    )
    parser.add_argument(
        "--engine", choices=get_args(EngineName), default="auto", help="of executions (default: %(default)s)"
    )


def _add_experiment(parser: argparse.ArgumentParser) -> None:
    _add_source(parser)
    parser.add_argument(
        "--orders", type=numbers.at_least_one, default=20, metavar="N", help="orders (default: %(default)s)"
    )
    parser.add_argument(
        "--items",
        type=numbers.at_least_one,
        default=10,
        metavar="N",
        help="of a large order (default: %(default)s)",
    )
    parser.add_argument(
        "--container",
        default="0.32x0.32x0.30",
        metavar="SIZE|ID",
        help="of large orders (default: %(default)s)",
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        default=[],
        metavar="NAME",
        help="heuristics, my_module:my_rule, or gls (default: all)",
    )
    parser.add_argument(
        "--constraints",
        nargs="+",
        choices=get_args(Constraints),
        default=["overlap", "robot"],
        help="of the experiment heuristics (default: overlap robot)",
    )
    parser.add_argument(
        "--settings",
        nargs="+",
        default=[],
        metavar="SETTING",
        help="of the planner: default, paper, or with options as default,grasp=paper (default: default paper)",
    )
    parser.add_argument(
        "--gls-plans",
        type=numbers.at_least_one,
        default=100,
        metavar="N",
        help="rounds of guided local search (default: %(default)s)",
    )
    parser.add_argument(
        "--unseen",
        metavar="FILE|second-half",
        help="items that nothing was tuned on: orders of these alone are lines of their own",
    )
    parser.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="NAME",
        help="of the experiment execution (default: the usual ones)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs/bench"), metavar="DIR", help="default: %(default)s"
    )
    parser.add_argument(
        "--backend",
        choices=BACKENDS,
        default="auto",
        help="serial: in this process; pebble: worker processes; ray: a cluster, or Ray here; auto: pebble where it is "
        "installed (default: %(default)s)",
    )
    parser.add_argument(
        "--workers",
        type=numbers.at_least_one,
        metavar="N",
        help="default: 1; with --ray-address one for each CPU of the cluster",
    )
    parser.add_argument(
        "--ray-address", metavar="ADDRESS", help="cluster to join, with --backend ray; auto: this one"
    )
    parser.add_argument(
        "--shard", metavar="I/N", help="do part I of N, for job arrays; then robotpack bench merge"
    )
    parser.add_argument(
        "--timeout", type=numbers.seconds, metavar="S", help="give a job up after so many seconds"
    )
    _add_output(parser)


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--any-revision",
        action="store_true",
        help="count rows of other revisions of the product, too; the table says which",
    )
    parser.add_argument("--no-report", action="store_true", help="print the table, write no report")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
