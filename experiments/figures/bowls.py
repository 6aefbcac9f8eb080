"""A large box after three bowls: HM nests the bowls, DBLF spreads them (paper Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.items.plan_items import surfaces_of
from packenv.planning.options import PlanOptions
from packenv.planning.search.heuristics import DeepestBottomLeft
from packenv.types import Plan

from .figure import Figure, Source, azimuth_from, size_words
from .sheet import Panel, legend, save, sheet

NAME = "bowls"
COUNT = 3
"""Bowls of the order."""
TIE_BREAK = DeepestBottomLeft().c
"""c of DBLF, in metres, with which Z comes first, as the paper describes it."""
_NESTED = 0.6
"""A copy comes to stand less than this share of its height higher than the one that it nests in."""
_SOLID = 0.8
"""A box fills at least this share of its bounding box."""
_SIZE = (500, 440)


@dataclass(frozen=True)
class Pile:
    """How the bowls of a plan lie.

    Attributes:
        floor: area of the container that they cover, m².
        height: of the highest of them, m.
        box_top: height of the large box's top, m.
    """

    floor: float
    height: float
    box_top: float


def bowls(source: Source) -> Figure | None:
    """The figure; None where the catalogue has no bowl or no box."""
    paper = PlanOptions.paper(constraints="overlap", sequence="given")
    shelf = source.shelf(paper)
    fitting = source.names(paper, source.box)
    bowl = nesting_item({name: shelf.prepared[name] for name in fitting})
    box = large_box({name: shelf.prepared[name] for name in fitting}, bowl)
    if bowl is None or box is None:
        source.watcher.remark(
            f"figure {NAME}: is left out, for {source.catalogue.label} has no {'box' if bowl else 'bowl'}"
        )
        return None
    order = (*[bowl] * COUNT, box)
    spread = paper.changed({"heuristic": "dblf", "tie_break": TIE_BREAK})
    ours = PlanOptions("hm", sequence="given", method="search")
    rows = (
        ("paper's preset, non-overlap", paper, spread),
        ("default preset, all constraints", ours, ours.changed({"heuristic": "dblf"})),
    )
    plans = [
        (f"{rule}, {words}", source.plan(order, options))
        for words, *both in rows
        for rule, options in zip(("HM", "DBLF"), both, strict=True)
    ]
    piles = [measure(source, plan) for _, plan in plans]
    panels = [
        Panel(source.picture(plan, _SIZE, _before_box(plan), 42.0), title, legend(plan), (_words(pile),))
        for (title, plan), pile in zip(plans, piles, strict=True)
    ]
    literal = measure(source, source.plan(order, paper.changed({"heuristic": "dblf"})))
    caption = (
        f"{COUNT} pieces of {bowl} and then {box}, in this sequence, in a box of {size_words(source.box)}. Above, the "
        f"paper's way of ranking under the non-overlap constraint: HM's bowls cover {_floor(piles[0])} of the floor, "
        f"DBLF's {_floor(piles[1])}. Here c of DBLF, the weight of X + Y in metres, is {TIE_BREAK:g}, a tie-break; "
        f"with the paper's c = 1, X + Y outweighs Z, and DBLF's bowls cover {_floor(literal)} and are "
        f"{literal.height * 100:.1f} cm high. Below, the default preset with all robot-packable constraints, which "
        f"lowers items until their surfaces touch: HM's bowls cover {_floor(piles[2])}, DBLF's {_floor(piles[3])}."
    )
    made_of = {
        "orders": [list(order)],
        "options": [options.to_mapping() for _, *both in rows for options in both],
        "bowls_floor_m2": [pile.floor for pile in piles],
        "bowls_height_m": [pile.height for pile in piles],
    }
    return Figure(
        NAME,
        "A large box after three bowls, by HM and by DBLF",
        caption,
        save(sheet(panels, 2), source.out, NAME),
        "Fig. 3, a large box after three bowls",
        made_of,
    )


def nesting_item(items: Mapping[str, PreparedItem]) -> str | None:
    """The bowl of a catalogue: the item in which a copy of it saves most volume, one that is called a bowl rather.

    Args:
        items: of the catalogue.

    Returns:
        Its name; None where none nests at a stable pose at which it is wider than high.
    """
    saved = {name: _saved(item) for name, item in items.items()}
    found = [name for name, volume in saved.items() if volume > 0.0]
    return max(found, key=lambda name: ("bowl" in name.lower(), saved[name]), default=None)


def large_box(items: Mapping[str, PreparedItem], bowl: str | None) -> str | None:
    """The largest item, by its bounding box, that fills that as a box does."""
    sizes = {
        name: item.box_volume
        for name, item in items.items()
        if name != bowl and item.volume >= _SOLID * item.box_volume
    }
    return max(sizes, key=lambda name: sizes[name], default=None)


def measure(source: Source, plan: Plan) -> Pile:
    """How the bowls of a plan lie."""
    options = plan.made_with
    assert isinstance(options, PlanOptions)
    surface = surfaces_of(plan, source.shelf(options))[COUNT - 1]
    tops = [float(p.corner[2] + p.extents[2]) for p in plan.placements]
    covered = float((surface.heights > 0.0).sum()) * surface.cell_size**2
    return Pile(covered, max(tops[:COUNT]), tops[-1])


def _saved(item: PreparedItem) -> float:
    """Volume that a copy saves that is put straight into an item, at the pose at which it saves most, m³."""
    most = 0.0
    for oriented in item.orientations:
        inside = oriented.footprint
        rise = float((oriented.top[inside] - oriented.bottom[inside]).max())
        wide = float(oriented.extents[:2].min()) > oriented.height
        if wide and rise < _NESTED * oriented.height:
            most = max(most, (oriented.height - rise) * float(inside.sum()) * oriented.cell_size**2)
    return most


def _floor(pile: Pile) -> str:
    return f"{pile.floor * 1e4:.0f} cm²"


def _words(pile: Pile) -> str:
    return (
        f"Bowls: {_floor(pile)} of the floor, {pile.height * 100:.1f} cm high; "
        f"top of the box at {pile.box_top * 100:.1f} cm."
    )


def _before_box(plan: Plan) -> float:
    """From where the bowls are before the box, degrees."""
    middles = np.array([p.corner[:2] + p.extents[:2] / 2 for p in plan.placements])
    return azimuth_from(middles[:COUNT].mean(axis=0) - middles[COUNT])
