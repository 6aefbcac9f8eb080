"""The heightmap of four items: what is drawn is the container's map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from packenv.experiments.figures.terrain import COUNT, columns, draw, draw_surface, heightmap
from packenv.items.plan_items import surfaces_of
from packenv.planning.options import PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container
from tests.experiments.figures.sources import SOME, source_of

pytest.importorskip("matplotlib")


def test_the_image_is_the_map_of_the_plan_replayed(tmp_path: Path) -> None:
    source = source_of(tmp_path, SOME)
    options = PlanOptions.paper()
    plan = source.plan(["softball", "soup_can", "bowl", "banana"], options)
    surface = surfaces_of(plan, source.shelf(options))[-1]
    drawing = draw(plan, surface, np.zeros((10, 10, 3), dtype=np.uint8))
    images = [image for axes in drawing.axes for image in axes.images if image.get_array().ndim == 2]
    shown = [image for image in images if image.get_array().shape == surface.heights.T.shape]
    assert len(shown) == 1
    assert np.array_equal(np.asarray(shown[0].get_array()), 100 * surface.heights.T.astype(np.float64))
    assert shown[0].get_clim() == pytest.approx((0.0, 100 * surface.heights.max()))
    # By the meshes, without any map: every vertex is below its cell's height, and the highest touches it.
    highest = 0.0
    for p in plan.placements:
        points = p.pose.apply(source.shelf(options).items[p.item].vertices)
        # A vertex on an edge between cells is in either.
        near = [(points[:, :2] + shift) / surface.cell_size for shift in (-1e-6, 1e-6)]
        cells = [np.clip(n.astype(int), 0, np.array(surface.heights.shape) - 1) for n in near]
        above = np.maximum(*(surface.heights[tuple(c.T)] for c in cells))
        assert (points[:, 2] <= above + 1e-6).all()
        highest = max(highest, float(points[:, 2].max()))
    assert surface.heights.max() == pytest.approx(highest, abs=2e-6)


def test_the_figure_states_what_was_packed(tmp_path: Path) -> None:
    source = source_of(tmp_path, SOME)
    figure = heightmap(source)
    assert figure is not None
    (order,) = figure.made_of["orders"]
    assert len(order) == COUNT
    options = PlanOptions.from_mapping(figure.made_of["options"])
    surface = surfaces_of(source.plan(order, options), source.shelf(options))[-1]
    assert figure.made_of["total_m"] == surface.total
    assert [path.suffix for path in figure.files] == [".png", ".svg"]
    assert all(path.stat().st_size > 10_000 for path in figure.files)


def test_columns_enclose_the_volume_below_the_map() -> None:
    rng = np.random.default_rng(3)
    heights = np.where(rng.random((12, 9)) < 0.6, rng.random((12, 9)) * 0.05, 0.0).astype(np.float32)
    surface = ContainerMap(Container(0.024, 0.018, 0.1), 0.002, heights)
    volume = area = 0.0
    for part in columns(surface, [(0, 0, 0)] * 7):
        a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
        crossed = np.cross(b - a, c - a) / 2
        assert (np.einsum("ij,ij->i", crossed, part.normals[part.faces[:, 0]]) > 0).all()  # seen from outside
        volume += float((crossed[:, 2] * (a + b + c)[:, 2] / 3).sum())
        area += float(np.abs(crossed[:, :2]).sum())
    exact = heights.astype(np.float64)
    assert volume == pytest.approx(exact.sum() * 0.002**2)
    padded = np.pad(exact, 1)
    steps = sum(float(np.abs(np.diff(padded, axis=axis)).sum()) for axis in (0, 1))
    assert area == pytest.approx(steps * 0.002)


def test_an_empty_container_can_be_drawn() -> None:
    empty = ContainerMap.empty(Container(0.1, 0.1, 0.1), 0.002)
    assert draw_surface(empty, [(0, 0, 0), (255, 255, 0)], (64, 64)).shape == (64, 64, 3)
