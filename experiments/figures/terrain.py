"""The terrain heightmap of four items, beside the packed box (paper Sec. IV-A)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from packenv.items.plan_items import surfaces_of
from packenv.planning.options import PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Plan
from packenv.view.painter import Image

from ..orders import random_orders
from .figure import Figure, Source, size_words
from .sheet import DPI, TEXT, legend, save, show_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

NAME = "heightmap"
COUNT = 4
_DRAWN = 12
_SIZE = (480, 480)
_COLOURS = "viridis"


def heightmap(source: Source) -> Figure | None:
    """The figure; None where no drawn order is packed whole."""
    options = PlanOptions.paper()
    orders = random_orders(source.names(options, source.box), COUNT, _DRAWN, source.seed)
    for index, order in enumerate(orders):
        plan = source.plan(order, options)
        if plan.complete:
            break
    else:
        source.watcher.remark(f"figure {NAME}: is left out, for none of {_DRAWN} orders was packed whole")
        return None
    surface = surfaces_of(plan, source.shelf(options))[-1]
    nx, ny = surface.heights.shape
    caption = (
        f"Terrain heightmap of {COUNT} items in a box of {size_words(source.box)}: the packed box, its heightmap of "
        f"{nx} by {ny} cells of {surface.cell_size * 1e3:g} mm, and the same as a surface; heights are at most "
        f"{float(surface.heights.max()) * 100:.1f} cm. Each cell holds the highest point over all of it. Planned with "
        f"the paper's preset; order {index} of seed {source.seed}."
    )
    drawing = _draw(plan, surface, source.picture(plan, _SIZE))
    made_of = {
        "seed": source.seed,
        "orders": [list(order)],
        "options": options.to_mapping(),
        "cell_size_m": surface.cell_size,
        "highest_m": float(surface.heights.max()),
        "total_m": surface.total,
    }
    return Figure(
        NAME,
        "Terrain heightmap of four items",
        caption,
        save(drawing, source.out, NAME, vector=True),
        "Fig. 2, terrain heightmap of 4 items",
        made_of,
    )


def _draw(plan: Plan, surface: ContainerMap, picture: Image) -> Drawing:
    from matplotlib.figure import Figure as Drawing
    from matplotlib.patches import Patch

    length, width, _ = (100.0 * side for side in surface.container.size)
    nx, ny = surface.heights.shape
    cell = 100.0 * surface.cell_size
    heights = 100.0 * surface.heights.astype(np.float64)
    drawing = Drawing(figsize=(1500 / DPI, 520 / DPI), dpi=DPI, facecolor="white")
    left = drawing.add_axes((10 / 1500, 30 / 520, 480 / 1500, 480 / 520))
    show_picture(left, picture)
    entries = [Patch(color=colour, label=name) for colour, name in legend(plan)]
    drawing.legend(
        handles=entries, loc="lower left", bbox_to_anchor=(0.004, 0.0), ncols=COUNT, frameon=False, fontsize=8
    )
    middle = drawing.add_axes((545 / 1500, 75 / 520, 380 / 1500, 400 / 520))
    shown = middle.imshow(
        heights.T, origin="lower", extent=(0, nx * cell, 0, ny * cell), cmap=_COLOURS, interpolation="none"
    )
    middle.set(xlim=(0, length), ylim=(0, width), xlabel="x, cm", ylabel="y, cm")
    drawing.colorbar(shown, ax=middle, label="height, cm", shrink=0.86)
    right = drawing.add_axes((960 / 1500, 10 / 520, 530 / 1500, 510 / 520), projection="3d")
    x, y = np.meshgrid((np.arange(nx) + 0.5) * cell, (np.arange(ny) + 0.5) * cell, indexing="ij")
    right.plot_surface(
        x, y, heights, cmap=_COLOURS, rcount=nx, ccount=ny, linewidth=0, antialiased=False, rasterized=True
    )
    highest = max(1.0, float(heights.max()))
    right.set(xlim=(0, length), ylim=(0, width), zlim=(0, highest), xlabel="x, cm", ylabel="y, cm")
    right.set_zlabel("height, cm")
    right.set_box_aspect((length, width, max(highest, 0.2 * length)))
    right.view_init(elev=32, azim=-58)
    for axes in (middle, right):
        axes.tick_params(labelsize=8, colors=TEXT)
    return drawing
