"""Space that is wasted below an item: DBLF does not look at it, HM matches the terrain (paper Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import mean
from typing import TYPE_CHECKING

import numpy as np

from packenv.items.plan_items import surfaces_of
from packenv.planning.options import PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.replay import seated
from packenv.types import FloatArray, Plan
from packenv.verification.stability_and_reach import recheck
from packenv.view.colours import hex_colour, item_colour
from packenv.view.painter import Image

from ..orders import random_orders
from .bowls import TIE_BREAK
from .figure import Figure, Source, azimuth_from
from .sheet import DPI, TEXT, WASTE, Panel, drawn, legend, save, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "stable-versus-not"
BELOW = 7
"""Items of the pile on which one more is placed."""
ORDERS = 100
"""Orders that are drawn."""
RANKING = PlanOptions.paper(constraints="overlap", heights="mesh", contacts="surface")
"""The paper's ranking, of items that come down until surfaces touch: only then force balance tells which ones stand."""
_SIZE = (500, 430)
_PILE = "#c3c9d2"


@dataclass(frozen=True, eq=False)
class Placed:
    """A pile and the item that was placed on it last.

    Attributes:
        plan: of both.
        before: heightmap of the pile.
        corner: cells of the item's smallest x and y.
        bottom: (w, h) height of its underside, m; +inf outside its footprint.
        top: (w, h) height of its upper side, m.
        stable: whether the pile still stands, by force balance.
    """

    plan: Plan
    before: ContainerMap
    corner: tuple[int, int]
    bottom: FloatArray
    top: FloatArray
    stable: bool

    @property
    def terrain(self) -> FloatArray:
        """(w, h) heights of the pile below the item, m."""
        (ix, iy), (w, h) = self.corner, self.bottom.shape
        return self.before.heights[ix : ix + w, iy : iy + h].astype(np.float64)

    @property
    def gaps(self) -> FloatArray:
        """(w, h) free height between pile and item, m; 0 outside its footprint."""
        return np.where(np.isfinite(self.bottom), self.bottom - self.terrain, 0.0)

    @property
    def waste(self) -> float:
        """Volume below the item that is free and that nothing from above can reach any more, m³."""
        return float(self.gaps.sum()) * self.before.cell_size**2


def stable_versus_not(source: Source) -> Figure | None:
    """The figure; None where no pile could be planned."""
    hm = RANKING
    piled = hm.changed({"constraints": "stability"})
    dblf = hm.changed({"heuristic": "dblf", "tie_break": TIE_BREAK})
    orders = random_orders(source.names(hm, source.box), BELOW + 1, ORDERS, source.seed)
    pairs: dict[int, tuple[Placed, Placed]] = {}
    for index, order in enumerate(orders):
        pile = source.plan(order[:BELOW], piled)
        plans = (
            [source.plan(order[BELOW:], options, start=pile) for options in (hm, dblf)]
            if pile.complete
            else []
        )
        if plans and all(plan.complete for plan in plans):
            by_hm, by_dblf = (placed_last(source, plan) for plan in plans)
            pairs[index] = by_hm, by_dblf
    if not pairs:
        source.watcher.remark(f"figure {NAME}: is left out, for none of {ORDERS} orders was packed whole")
        return None
    index = max(pairs, key=lambda k: (*_tells(pairs[k]), _saved(pairs[k])))
    shown = pairs[index]
    panels = []
    for rule, found in zip(("HM", "DBLF"), shown, strict=True):
        picture = source.picture(found.plan, _SIZE, _before_pile(found.plan))
        panels.append(Panel(picture, _title(rule, found), legend(found.plan)))
    panels += [Panel(_section(found), _section_title(found)) for found in shown]
    volumes = [1e6 * found.waste for found in shown]
    means = [mean(1e6 * pair[side].waste for pair in pairs.values()) for side in (0, 1)]
    stand = [sum(pair[side].stable for pair in pairs.values()) for side in (0, 1)]
    stands, alone = _tells(shown)
    those = "HM's pile stands" if stands else "no HM pile stands"
    chosen = (
        "HM's pile stands, DBLF's does not, and of such the difference is largest"
        if alone
        else f"{those}, and of such the difference is largest"
    )
    caption = (
        f"{orders[index][BELOW]} placed on the same pile of {BELOW} items, which stands, by HM and by DBLF "
        f"(c = {TIE_BREAK:g}, in metres) under the non-overlap constraint, each seen from the side on which it lies, "
        f"and cuts through its middle with the space below it that is wasted: by the heightmaps {volumes[0]:.0f} cm³ "
        f"by HM and {volumes[1]:.0f} by DBLF. Order index {index} of {len(pairs)} random ones (seed {source.seed}), "
        f"chosen because {chosen}. Over all of them HM wastes {means[0]:.0f} cm³ on average and DBLF {means[1]:.0f}, "
        f"and the pile still stands, by force balance, in {stand[0]} and {stand[1]} of them."
    )
    made_of = {
        "seed": source.seed,
        "orders": [orders[k] for k in pairs],
        "shown": index,
        "options": [hm.to_mapping(), dblf.to_mapping()],
        "wasted_m3": [[found.waste for found in pair] for pair in pairs.values()],
        "stable": [[found.stable for found in pair] for pair in pairs.values()],
    }
    return Figure(
        NAME,
        "Space wasted below an item, by HM and by DBLF",
        caption,
        save(sheet(panels, 2), source.out, NAME),
        "Fig. 4, space wasted underneath by position-based heuristics",
        made_of,
    )


def placed_last(source: Source, plan: Plan) -> Placed:
    """What the last item of a plan does to the pile below it."""
    options = plan.made_with
    assert isinstance(options, PlanOptions)
    shelf = source.shelf(options)
    plan = replace(plan, lying=0)
    before, last = surfaces_of(plan, shelf)[-2], plan.placements[-1]
    oriented, ix, iy, z = seated(last, shelf.shapes[last.item], before)
    asked = options.changed({"constraints": "stability"})
    found = recheck(plan, shelf.shapes, shelf.fields, asked)
    return Placed(
        plan,
        before,
        (ix, iy),
        oriented.bottom.astype(np.float64) + z,
        oriented.top.astype(np.float64) + z,
        not found.unstable_steps,
    )


def _tells(pair: Sequence[Placed]) -> tuple[bool, bool]:
    """Whether HM's pile stands, and DBLF's does not."""
    by_hm, by_dblf = pair
    return by_hm.stable, by_hm.stable > by_dblf.stable


def _saved(pair: Sequence[Placed]) -> float:
    by_hm, by_dblf = pair
    return by_dblf.waste - by_hm.waste


def _before_pile(plan: Plan) -> float:
    """From where the last item is before the others, degrees."""
    last = plan.placements[-1]
    return azimuth_from(last.corner[:2] + last.extents[:2] / 2 - np.array(plan.container.size[:2]) / 2)


def _title(rule: str, found: Placed) -> str:
    stands = "the pile stands" if found.stable else "the pile does not stand"
    return f"{rule}: {1e6 * found.waste:.0f} cm³ wasted; {stands}"


def _cut(found: Placed) -> tuple[int, int]:
    """Axis along which the item is cut, and its cell across: of two cuts through the middle the one with more waste."""
    middles = [n // 2 for n in found.bottom.shape]
    along = [found.gaps[:, middles[1]].sum(), found.gaps[middles[0]].sum()]
    axis = int(np.argmax(along))
    return axis, middles[1 - axis]


def _section_title(found: Placed) -> str:
    axis, at = _cut(found)
    place = (found.corner[1 - axis] + at + 0.5) * found.before.cell_size
    return f"Cut at {'yx'[axis]} = {100 * place:.1f} cm"


def _section(found: Placed) -> Image:
    """A cut through the box and the middle of the item."""
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=(_SIZE[0] / DPI, _SIZE[1] / DPI), dpi=DPI, facecolor="white")
    axes = drawing.add_axes((0.09, 0.11, 0.88, 0.86))
    _draw_section(axes, found)
    return drawn(drawing)


def _draw_section(axes: Axes, found: Placed) -> None:
    axis, at = _cut(found)
    cell = 100 * found.before.cell_size
    heights, bottom, top, terrain = (
        100 * np.moveaxis(values, axis, 0)
        for values in (found.before.heights.astype(np.float64), found.bottom, found.top, found.terrain)
    )
    row, begin = found.corner[1 - axis] + at, found.corner[axis]
    edges = np.arange(len(heights) + 1) * cell
    axes.stairs(heights[:, row], edges, fill=True, color=_PILE, label="pile")
    inside = np.isfinite(bottom[:, at])
    own = edges[begin : begin + len(inside) + 1]
    last = len(found.plan.placements) - 1
    low, under, over = (np.where(inside, values[:, at], np.nan) for values in (terrain, bottom, top))
    name = found.plan.placements[last].item
    axes.stairs(over, own, baseline=under, fill=True, color=hex_colour(item_colour(last)), label=name)
    axes.stairs(
        under,
        own,
        baseline=low,
        fill=True,
        facecolor="none",
        edgecolor=WASTE,
        hatch="////",
        lw=0,
        label="wasted",
    )
    box = found.before.container.size
    axes.set(xlim=(0, 100 * box[axis]), ylim=(0, 100 * box[2]))
    axes.set_xlabel(f"{'xy'[axis]}, cm", color=TEXT)
    axes.set_ylabel("height, cm", color=TEXT)
    axes.tick_params(labelsize=8, colors=TEXT)
    axes.spines[["top"]].set_visible(False)
    axes.set_aspect("equal")
    axes.legend(loc="upper right", frameon=False, fontsize=8.5)
