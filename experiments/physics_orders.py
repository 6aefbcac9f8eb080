"""What experiments in physics share: container and settings, random orders, and what a worker loads once."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

from packenv.config import EngineName, GridConfig
from packenv.robot.files import default_cell
from packenv.sim.session import ExecutionConfig
from packenv.types import Container

from .orders import fitting, random_orders, small_orders
from .plan_store import PlanStore
from .shelf import open_shelf

GRID = GridConfig()
BOX = Container(0.32, 0.32, 0.30)


class Worker:
    """What a worker process loads once."""

    store: PlanStore
    config = ExecutionConfig()


def prepare(catalogue: str, plans: Path, engine: EngineName = "auto") -> None:
    """Load a catalogue into this process, items as envelopes and as meshes; plans are kept in a folder."""
    shelves = (open_shelf(catalogue, geometry, GRID) for geometry in ("parts", "mesh"))
    parts, meshes = shelves
    Worker.store = PlanStore(plans, parts, BOX, meshes)
    Worker.config = ExecutionConfig.of(default_cell(), engine)


def options(description: str, *, orders: int, out: str) -> argparse.ArgumentParser:
    """A parser with the options of every experiment in physics, and their defaults."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--orders", type=int, default=orders)
    parser.add_argument("--items", type=int, default=10, help="items an order (default: %(default)s)")
    parser.add_argument("--small", action="store_true", help="orders of three to five items instead")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON alone, as it always is; taken for scripts")
    parser.add_argument(
        "--engine", choices=get_args(EngineName), default="auto", help="of executions (default: %(default)s)"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(out))
    parser.add_argument(
        "--plans", type=Path, default=Path("runs/plans"), help="folder of plans that are made once"
    )
    return parser


def drawn_orders(arguments: argparse.Namespace) -> list[list[str]]:
    """The orders that the options ask for, of items that fit the container alone."""
    names = fitting(Worker.store.shelf.prepared, BOX, GRID)
    if arguments.small:
        return small_orders(names, arguments.orders, arguments.seed)
    return random_orders(names, arguments.items, arguments.orders, arguments.seed)
