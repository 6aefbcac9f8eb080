"""Packed boxes: orders of three to five items in the smallest box, and orders of ten (paper Sec. V)."""

from __future__ import annotations

from collections.abc import Sequence

from packenv.io.containers import read_boxes
from packenv.planning.options import PlanOptions
from packenv.types import Container, Plan

from ..orders import random_orders, small_orders
from .figure import Figure, Source, size_words
from .sheet import Panel, legend, save, sheet

SHOWN = 6
"""Pictures of a gallery."""
_DRAWN = 18
"""Orders that are drawn at most."""
_SIZE = (440, 330)
_COLUMNS = 3


def small_gallery(source: Source) -> Figure | None:
    """Orders of three to five items, each in the smallest of the built-in boxes that takes all of it."""
    options = PlanOptions.paper()
    largest = max(read_boxes(), key=lambda box: box.volume)
    orders = small_orders(source.names(options, largest), _DRAWN, source.seed)
    return _gallery(
        source,
        "small-orders",
        "Orders of three to five items",
        "Fig. 5, packing plans of 3 to 5 items",
        orders,
        options,
        "auto",
        ", each in the smallest built-in box that takes all of it",
    )


def large_gallery(source: Source) -> Figure | None:
    """Orders of ten items."""
    options = PlanOptions.paper()
    size = size_words(source.box)
    return _gallery(
        source,
        "large-orders",
        "Orders of ten items",
        "Fig. 6, packing plans of 10 items",
        random_orders(source.names(options, source.box), 10, _DRAWN, source.seed),
        options,
        source.box,
        f" in a box of {size}",
    )


def _gallery(
    source: Source,
    name: str,
    title: str,
    paper: str,
    orders: Sequence[Sequence[str]],
    options: PlanOptions,
    container: Container | str,
    where: str,
) -> Figure | None:
    packed: list[Plan] = []
    left_over: list[int] = []
    for index, order in enumerate(orders):
        plan = source.plan(order, options, container)
        if plan.complete:
            packed.append(plan)
        else:
            left_over.append(index)
        if len(packed) == SHOWN:
            break
    if not packed:
        source.watcher.remark(
            f"figure {name}: is left out, for none of {len(orders)} orders was packed whole"
        )
        return None
    panels = [
        Panel(
            source.picture(plan, _SIZE),
            _title(plan, position),
            legend(plan),
        )
        for position, plan in enumerate(packed, start=1)
    ]
    drawn = len(packed) + len(left_over)
    which = (
        f"the first {drawn} random orders"
        if not left_over
        else f"{len(packed)} of the first {drawn} random orders"
    )
    caption = (
        f"{title}{where}, planned with the paper's preset (HM, all robot-packable constraints): {which} of the "
        f"catalogue {source.catalogue.label} (seed {source.seed})"
        + (f"; the other {len(left_over)} left something over." if left_over else ", all packed whole.")
    )
    made_of = {
        "seed": source.seed,
        "options": options.to_mapping(),
        "orders": [list(order) for order in orders[:drawn]],
        "not_packed": left_over,
        "boxes": [plan.container.label for plan in packed],
    }
    return Figure(name, title, caption, save(sheet(panels, _COLUMNS), source.out, name), paper, made_of)


def _title(plan: Plan, position: int) -> str:
    """Of a picture: the box where it has a name, else which order it is."""
    name = plan.container.name
    return f"Order {position}" if name is None else f"Box {name}, {size_words(plan.container)}"
