"""How low items come: closed forms, the exact audit on both sides of the answer, and never above the heightmaps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
import trimesh

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.heightmaps import orient_item
from packenv.items.catalogue import open_catalogue
from packenv.planning.search.contact_height import (
    ExactPile,
    FacesByCell,
    contact_height,
    inside_out,
    lower_faces,
    upper_faces,
)
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.kernels import lowest_at as lowest_z
from packenv.types import Container, FloatArray, Item, OrientedItem, Placement, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.geometry_samples import random_rotation
from tests.shapes import as_item, ball, box, cup, cylinder

CELL = 0.002
TOUCHING = 20e-6
"""What the audit takes for touching, m."""
UPRIGHT = np.eye(3)


@dataclass
class Heap:
    """Items put down one after another as low as they come."""

    container: Container = field(default_factory=lambda: Container(0.32, 0.32, 0.6))
    surface: ContainerMap = field(init=False)
    faces: list[FacesByCell] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)
    items: dict[str, Item] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.surface = ContainerMap.empty(self.container, CELL)

    def lowest(self, item: Item, oriented: OrientedItem, ix: int, iy: int) -> tuple[float, float]:
        """By the meshes, and by the heightmaps."""
        bound = float(lowest_z(self.surface.heights, oriented.bottom, ix, iy))
        faces = lower_faces(item, oriented)
        return contact_height(self.surface.heights, oriented, faces, ix, iy, self.faces), bound

    def put(self, item: Item, ix: int, iy: int, rotation: FloatArray = UPRIGHT) -> tuple[float, float]:
        oriented = orient_item(item, rotation, cell_size=CELL)
        z, bound = self.lowest(item, oriented, ix, iy)
        corner = np.array([ix * CELL, iy * CELL, z])
        position = oriented.offset + corner
        self.surface = self.surface.with_item(oriented, ix, iy, z)
        self.faces.append(upper_faces(item, rotation, position, CELL))
        self.items[item.name] = item
        self.placements.append(
            Placement(item.name, 1, rotation, position, corner, oriented.extents, 0, 0.0, 0.0, 1)
        )
        return z, bound

    def sound(self, sunk: float = 0.0) -> bool:
        """What the audit of the exact meshes says, the last item moved down by so much."""
        *others, last = self.placements
        down = np.array([0.0, 0.0, sunk])
        moved = Placement(
            last.item,
            1,
            last.rotation,
            last.position - down,
            last.corner - down,
            last.extents,
            0,
            0.0,
            0.0,
            1,
        )
        return audit_plan(Plan(self.container, (*others, moved), ()), self.items).ok


def cone(angle: float, radius: float = 0.06, wall: float = 0.004) -> Item:
    """A paper hat upside down: walls at ``angle`` to the vertical, as thick as ``wall`` measured straight up."""
    height = radius / math.tan(angle)
    outline = [(0.0, 0.0), (radius, height), (radius, height + wall), (0.0, wall)]
    return as_item(trimesh.creation.revolve(outline, sections=96), "hat")


@pytest.mark.parametrize("angle", [0.3, 0.6, 1.0])
def test_hats_nest_as_high_as_their_walls_are_thick(angle: float) -> None:
    heap, hat = Heap(), cone(angle)
    heights = [heap.put(hat, 20, 20)[0] for _ in range(3)]
    assert heights == pytest.approx([0.0, 0.004, 0.008], abs=5e-6)


def test_a_ball_sinks_into_a_square_hole_as_far_as_geometry_says() -> None:
    """Half the hole's width is a, the radius r: the ball's lowest point is r - √(r² - a²) below the edges."""
    a, r, height = 0.02, 0.03, 0.05
    wall = trimesh.creation.box((0.1, 0.1, height))
    hole = trimesh.creation.box((2 * a, 2 * a, 2 * height))
    frame = as_item(trimesh.boolean.difference([wall, hole]), "frame")
    heap = Heap()
    heap.put(frame, 20, 20)
    z, bound = heap.put(ball(r, subdivisions=5), 20 + 10, 20 + 10)
    sinks = r - math.sqrt(r * r - a * a)
    assert z == pytest.approx(height - sinks, abs=1e-4)  # the ball has 20,480 faces
    assert z <= bound


def test_crossing_edges_hold() -> None:
    """Two roofs, ridges crossing: the upper one stands on one point, ridge on ridge."""
    roof = as_item(
        trimesh.Trimesh(
            [[0, 0, 0], [0.1, 0, 0], [0.1, 0.06, 0], [0, 0.06, 0], [0, 0.03, 0.04], [0.1, 0.03, 0.04]],
            [[0, 3, 1], [1, 3, 2], [0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [0, 4, 3], [1, 2, 5]],
        ),
        "roof",
    )
    turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    heap = Heap()
    heap.put(roof, 20, 20)
    z, _ = heap.put(roof, 30, 10, turned)
    assert z == pytest.approx(0.04, abs=2e-6)
    assert heap.sound()
    assert not heap.sound(5 * TOUCHING)


def test_flush_items_do_not_hold_each_other() -> None:
    heap = Heap()
    heap.put(box(0.1, 0.1, 0.1, "one"), 0, 0)
    z, bound = heap.put(box(0.1, 0.1, 0.1, "two"), 50, 0)
    assert z == bound == 0.0
    assert heap.put(box(0.1, 0.1, 0.1, "three"), 25, 0)[0] == pytest.approx(0.1, abs=2e-6)


def test_the_floor_holds_what_nothing_else_does() -> None:
    heap = Heap()
    heap.put(cup(0.04, 0.06), 0, 0)
    assert heap.put(box(0.03, 0.03, 0.03), 60, 60)[0] == 0.0


def test_what_one_item_is_told_is_not_told_to_another() -> None:
    """Items that turn alike are asked for at one place of one pile, one after another."""
    below, *others = (ball(0.03), box(0.04, 0.04, 0.02, "flat"), cup(0.03, 0.05), cylinder(0.02, 0.05))
    oriented = {item.name: orient_item(item, UPRIGHT, cell_size=CELL) for item in (below, *others)}
    empty = ContainerMap.empty(
        Container(0.2, 0.2, 0.2), CELL, ExactPile({i.name: i for i in (below, *others)})
    )

    def told(names: list[str]) -> dict[str, float]:
        pile = empty.with_item(oriented[below.name], 20, 20, 0.0)
        return {n: pile.lowest(oriented[n], 44, 25, pile.bound(oriented[n], 44, 25)) for n in names}

    names = [item.name for item in others]
    alone = {name: told([name])[name] for name in names}
    assert len(set(alone.values())) > 1
    assert told(names) == told(names[::-1]) == alone


def fold(upside: float) -> Item:
    """A plate with a smaller plate beside it, above it or below it whose surface is inside out, as scans have folds."""
    plate = trimesh.creation.box((0.08, 0.08, 0.01))
    other = trimesh.creation.box((0.03, 0.03, 0.01))
    other.apply_translation([0.01, 0.0, 0.02 * upside])
    other.invert()
    return as_item(trimesh.util.concatenate([plate, other]), "fold")


@pytest.mark.parametrize("upside", [1.0, -1.0])
def test_what_is_inside_out_holds_and_is_held(upside: float) -> None:
    item = fold(upside)
    assert inside_out(item)
    heap = Heap()
    heap.put(item, 20, 20)
    assert heap.put(box(0.01, 0.01, 0.02), 42, 38)[0] == pytest.approx(0.03, abs=2e-6)
    assert heap.put(item, 70, 70)[0] == 0.0
    heap = Heap()
    heap.put(box(0.01, 0.01, 0.02), 42, 38)
    z, _ = heap.put(item, 20, 20)
    assert z == pytest.approx(0.02, abs=2e-6)
    assert heap.sound()


def test_no_sound_surface_counts_as_inside_out() -> None:
    assert not any(inside_out(item) for item in SHAPES)
    catalogue = open_catalogue("builtin")
    assert not any(inside_out(catalogue.item(name)) for name in catalogue.names)
    turned = ball(0.03)
    assert inside_out(Item(**{**turned.__dict__, "faces": turned.faces[:, ::-1]}))


SHAPES = (ball(0.03), box(0.06, 0.05, 0.03), cup(0.035, 0.06), cylinder(0.025, 0.05), cone(0.7))


@pytest.mark.parametrize("seed", range(30))
def test_the_audit_says_that_they_touch_and_no_more(seed: int) -> None:
    """Lower by a hair is an overlap, and as they are is none: the answer is exact, by another engine."""
    rng = np.random.default_rng(seed)
    heap = Heap(Container(0.14, 0.14, 0.6))
    for k in range(5):
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        item = Item(**{**shape.__dict__, "name": f"{shape.name}{k}"})
        rotation = random_rotation(100 * seed + k)
        oriented = orient_item(item, rotation, cell_size=CELL)
        room = [n - m for n, m in zip(heap.surface.heights.shape, oriented.top.shape, strict=True)]
        ix, iy = (int(rng.integers(0, r + 1)) for r in room)
        z, bound = heap.put(item, ix, iy, rotation)
        assert z <= bound + HEIGHT_QUANTUM
        assert heap.sound(), (seed, k)
        if z > 0.0:
            assert not heap.sound(10 * TOUCHING), (seed, k)


@pytest.mark.parametrize(
    "name", ["bowl", "plate", "flower_pot", "storage_tray", "nesting_cup_5", "party_cup"]
)
def test_our_own_nesting_items_touch_and_no_more(name: str) -> None:
    heap, item = Heap(), open_catalogue("builtin").item(name)
    heights = [heap.put(Item(**{**item.__dict__, "name": f"{name}{k}"}), 10, 10)[0] for k in range(3)]
    assert np.diff(heights) == pytest.approx([heights[1]] * 2, abs=3e-6)
    assert heap.sound()
    # Where walls are steep, a millimetre down is a few hundredths into each other.
    assert not heap.sound(1.5e-3)
