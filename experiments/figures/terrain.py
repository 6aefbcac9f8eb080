"""The terrain heightmap of four items, beside the packed box (paper Sec. IV-A)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from packenv.items.plan_items import surfaces_of
from packenv.planning.options import PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.types import FloatArray, Plan
from packenv.view.camera import camera_around
from packenv.view.painter import FINE, Image, paint
from packenv.view.surfaces import Surface, box_corners

from ..orders import random_orders
from .figure import Figure, Source, size_words
from .sheet import DPI, TEXT, legend, save, show_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

NAME = "heightmap"
COUNT = 4
_DRAWN = 12
_SIZE = (490, 470)
_WIDTH, _HEIGHT = 1500, 520
_AZIMUTH, _ELEVATION = -58.0, 32.0
_COLOURS = "viridis"
_BANDS = 48


def heightmap(source: Source) -> Figure | None:
    """The figure; None where no drawn order is packed whole."""
    options = PlanOptions.paper()
    orders = random_orders(source.names(options, source.box), COUNT, _DRAWN, source.seed)
    plans = (source.plan(order, options) for order in orders)
    index, plan = next(((k, plan) for k, plan in enumerate(plans) if plan.complete), (0, None))
    if plan is None:
        source.watcher.remark(f"figure {NAME}: is left out, for none of {_DRAWN} orders was packed whole")
        return None
    surface = surfaces_of(plan, source.shelf(options))[-1]
    nx, ny = surface.heights.shape
    caption = (
        f"Terrain heightmap of {COUNT} items in a box of {size_words(source.box)}: the packed box, its heightmap of "
        f"{nx} by {ny} cells of {surface.cell_size * 1e3:g} mm, and the same as a surface; heights are at most "
        f"{float(surface.heights.max()) * 100:.1f} cm. Each cell holds the highest point over all of it. Planned with "
        f"the paper's preset; order index {index} of seed {source.seed}."
    )
    drawing = draw(plan, surface, source.picture(plan, _SIZE, _AZIMUTH, _ELEVATION))
    made_of = {
        "seed": source.seed,
        "index": index,
        "orders": [orders[index]],
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


def draw(plan: Plan, surface: ContainerMap, picture: Image) -> Drawing:
    """The figure of a plan, its heightmap and its picture."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure as Drawing
    from matplotlib.patches import Patch

    length, width, _ = (100.0 * side for side in surface.container.size)
    nx, ny = surface.heights.shape
    cell = 100.0 * surface.cell_size
    heights = 100.0 * surface.heights.astype(np.float64)
    palette = (255 * colormaps[_COLOURS](np.linspace(0, 1, _BANDS))[:, :3]).round().astype(int)
    drawing = Drawing(figsize=(_WIDTH / DPI, _HEIGHT / DPI), dpi=DPI, facecolor="white")
    cells = draw_surface(surface, [(r, g, b) for r, g, b in palette.tolist()], _SIZE)
    for left, title, shown in (
        (5, "Packed box", picture),
        (_WIDTH - _SIZE[0] - 5, "Heightmap, cell by cell", cells),
    ):
        place = (left / _WIDTH, 24 / _HEIGHT, _SIZE[0] / _WIDTH, _SIZE[1] / _HEIGHT)
        show_picture(drawing.add_axes(place), shown)
        drawing.text(
            (left + 8) / _WIDTH, 505 / _HEIGHT, title, color=TEXT, size=10.5, weight="bold", va="center"
        )
    entries = [Patch(color=colour, label=name) for colour, name in legend(plan)]
    drawing.legend(handles=entries, loc="lower left", ncols=COUNT, frameon=False, fontsize=8.5)
    axes = drawing.add_axes((545 / _WIDTH, 75 / _HEIGHT, 400 / _WIDTH, 400 / _HEIGHT))
    image = axes.imshow(
        heights.T, origin="lower", extent=(0, nx * cell, 0, ny * cell), cmap=_COLOURS, interpolation="none"
    )
    image.set_clim(0.0, _highest(heights))
    axes.set_title("Heightmap", loc="left", color=TEXT, size=10.5, weight="bold", y=1.03)
    axes.set(xlim=(0, length), ylim=(0, width))
    axes.set_xlabel("x, cm", color=TEXT)
    axes.set_ylabel("y, cm", color=TEXT)
    axes.tick_params(labelsize=8, colors=TEXT)
    drawing.colorbar(image, ax=axes, label="height, cm", shrink=0.8)
    return drawing


def draw_surface(
    surface: ContainerMap, palette: Sequence[tuple[int, int, int]], size: tuple[int, int]
) -> Image:
    """A heightmap in its container, each cell a column in the colour of its height.

    Args:
        surface: the map.
        palette: colours of heights, (red, green, blue) from 0 to 255: the floor first, the highest cell last.
        size: (width, height), px.
    """
    corners = box_corners(surface.container)
    camera = camera_around(corners, size, _AZIMUTH, _ELEVATION)
    return paint(surface.container, columns(surface, palette), camera, FINE, corners)


def columns(surface: ContainerMap, palette: Sequence[tuple[int, int, int]]) -> list[Surface]:
    """Tops of the cells and steps between them, a surface for each colour; see :func:`draw_surface`."""
    cell, heights = surface.cell_size, surface.heights.astype(np.float64)
    steps = np.pad(heights, 1)
    quads: list[FloatArray] = []
    normals: list[FloatArray] = []
    levels: list[FloatArray] = []
    at = np.argwhere(heights > 0.0)
    low, top = at * cell, heights[tuple(at.T)]
    high = low + cell
    flat = [
        (low[:, 0], low[:, 1]),
        (high[:, 0], low[:, 1]),
        (high[:, 0], high[:, 1]),
        (low[:, 0], high[:, 1]),
    ]
    quads.append(np.stack([np.column_stack([x, y, top]) for x, y in flat], axis=1))
    normals.append(np.tile([0.0, 0.0, 1.0], (len(at), 1)))
    levels.append(top)
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        toward = np.zeros(2, dtype=np.int64)
        toward[axis] = sign
        foot = steps[tuple((at + 1 + toward).T)]
        open_ = foot < top
        # Each step in pieces of a band's height, so that its colours are those of its heights.
        band = _highest(heights) / len(palette)
        edge = (high if sign > 0 else low)[open_]
        start = low[open_].copy()
        start[:, axis] = edge[:, axis]
        end = high[open_].copy()
        end[:, axis] = edge[:, axis]
        below, above = foot[open_], top[open_]
        while len(below):
            upper = np.minimum((np.floor(below / band + 1e-9) + 1) * band, above)
            corners = [(start, below), (end, below), (end, upper), (start, upper)]
            quads.append(np.stack([np.column_stack([xy, z]) for xy, z in corners], axis=1))
            normals.append(np.tile([*toward, 0.0], (len(below), 1)))
            levels.append((below + upper) / 2)
            more = upper < above
            start, end, below, above = start[more], end[more], upper[more], above[more]
    points, facing, level = np.concatenate(quads), np.concatenate(normals), np.concatenate(levels)
    shade = np.minimum((level / _highest(heights) * len(palette)).astype(np.int64), len(palette) - 1)
    return [_quads(points[shade == k], facing[shade == k], colour) for k, colour in enumerate(palette)]


def _quads(points: FloatArray, normals: FloatArray, colour: tuple[int, int, int]) -> Surface:
    """Squares as a surface: (n, 4, 3) corners in turn and (n, 3) normals; no line is drawn between them."""
    first = 4 * np.arange(len(points))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    vertices = points.reshape(-1, 3)
    # The corners go round as seen from outside.
    turned = np.einsum(
        "ij,ij->i", np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), normals
    )
    faces[np.repeat(turned < 0.0, 2)] = faces[np.repeat(turned < 0.0, 2)][:, ::-1]
    parts = np.zeros(len(faces), dtype=np.int64)
    red, green, blue = colour
    shade = 0.7  # a surface that does not show all of its shade has no lines
    return Surface(vertices, np.repeat(normals, 4, axis=0), faces, parts, (red, green, blue), shade)


def _highest(heights: FloatArray) -> float:
    """The top of the scale; of an empty map any."""
    return float(heights.max()) or 1.0
