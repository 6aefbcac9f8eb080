"""Options that experiments on random orders share."""

from __future__ import annotations

import argparse
from pathlib import Path

from packenv.errors import InputError
from packenv.planning.assembly import heuristic_of
from packenv.planning.options import PlanOptions


def order_options(description: str, *, orders: int, out: str) -> argparse.ArgumentParser:
    """A parser with the options of every experiment on random orders, and their defaults."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--orders", type=int, default=orders)
    parser.add_argument(
        "--heuristics",
        nargs="+",
        type=heuristic,
        default=["hm", "dblf", "mta"],
        help="names, or own ones as my_module:my_rule",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(out))
    return parser


def heuristic(text: str) -> str:
    """A heuristic as an option takes it.

    Raises:
        argparse.ArgumentTypeError: there is none of that name.
    """
    try:
        heuristic_of(PlanOptions(heuristic=text))
    except InputError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None
    return text
