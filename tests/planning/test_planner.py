"""The planner: sequence, legality, leftovers with reasons, determinism."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.config import CLEARANCE, GridConfig
from packenv.errors import InputError
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.geometry.transforms import yaw_rotation
from packenv.planning.planner import Planner, by_box_volume
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.search.replay import replay
from packenv.types import Container, Item
from tests.shapes import box, cup, cylinder

GRID = GridConfig()
MESHES = {
    item.name: item
    for item in (
        box(0.10, 0.08, 0.05, "brick"),
        box(0.20, 0.15, 0.03, "book"),
        cup(0.04, 0.09, name="cup"),
        cup(0.06, 0.05, name="bowl", taper=0.3),
        cylinder(0.03, 0.10, name="can"),
        box(0.50, 0.02, 0.02, "pole"),
    )
}


@pytest.fixture(scope="module")
def items() -> dict[str, PreparedItem]:
    return {name: prepare_item(mesh, GRID) for name, mesh in MESHES.items()}


def _pack(
    names: list[str], items: dict[str, PreparedItem], heuristic: str = "hm", seed: int = 0, **size: float
):
    container = Container(**{"length": 0.3, "width": 0.3, "height": 0.2, **size})
    return Planner(HEURISTICS[heuristic], GRID, seed=seed).pack(names, items, container)


def test_sequence_is_by_non_increasing_box_volume(items: dict[str, PreparedItem]) -> None:
    ordered = by_box_volume(["can", "cup", "book", "brick", "can"], items)
    assert ordered == ["book", "cup", "brick", "can", "can"]
    volumes = [items[name].box_volume for name in ordered]
    assert volumes == sorted(volumes, reverse=True)


def test_turning_a_mesh_file_does_not_change_the_sequence() -> None:
    tilted = yaw_rotation(0.7)
    turned = dataclasses.replace(
        MESHES["book"],
        vertices=MESHES["book"].vertices @ tilted.T,
        com=tilted @ MESHES["book"].com,
    )
    a, b = (prepare_item(item, GRID).box_volume for item in (MESHES["book"], turned))
    assert a == pytest.approx(b, rel=1e-6)
    assert a == pytest.approx(0.20 * 0.15 * 0.03, rel=1e-6)


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
def test_every_placement_is_inside_and_none_overlaps(heuristic: str, items: dict[str, PreparedItem]) -> None:
    packing = _pack(["book", "brick", "brick", "cup", "cup", "can", "can"], items, heuristic, seed=3)
    assert packing.complete
    for placement in packing.placements:
        mesh = MESHES[placement.item]
        placed = mesh.vertices @ placement.rotation.T + placement.position
        assert np.all(placed >= -1e-9)
        assert np.all(placed <= np.array(packing.container.size) + CLEARANCE)
        np.testing.assert_allclose(placed.min(axis=0), placement.corner, atol=1e-9)
        np.testing.assert_allclose(np.ptp(placed, axis=0), placement.extents, atol=1e-9)
    total = sum(MESHES[p.item].volume for p in packing.placements)
    assert packing.utilization == pytest.approx(total / packing.container.volume)


def test_an_item_larger_than_the_container_says_so(items: dict[str, PreparedItem]) -> None:
    packing = _pack(["brick", "pole"], items)
    assert [p.item for p in packing.placements] == ["brick"]
    (left,) = packing.leftovers
    assert (left.item, left.instance, left.reason) == ("pole", 1, "no-fitting-orientation")
    assert "x 0.5 m) is larger than" in left.detail


def test_an_item_that_finds_no_room_says_so(items: dict[str, PreparedItem]) -> None:
    packing = _pack(["brick"] * 4, items, length=0.11, width=0.11, height=0.11)
    assert len(packing.placements) == 2
    assert [(left.instance, left.reason) for left in packing.leftovers] == [
        (3, "no-legal-candidate"),
        (4, "no-legal-candidate"),
    ]
    assert not packing.complete


def test_after_a_leftover_smaller_items_still_go_in(items: dict[str, PreparedItem]) -> None:
    packing = _pack(["pole", "book", "brick"], items)
    assert [p.item for p in packing.placements] == ["book", "brick"]


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
def test_same_seed_same_packing(heuristic: str, items: dict[str, PreparedItem]) -> None:
    names = ["book", "brick", "cup", "can"]
    a, b = (_pack(names, items, heuristic, seed=11) for _ in range(2))
    for p, q in zip(a.placements, b.placements, strict=True):
        assert p.position.tolist() == q.position.tolist()
        assert p.score == q.score


def test_random_differs_between_seeds(items: dict[str, PreparedItem]) -> None:
    corners = {tuple(_pack(["can"], items, "random", seed=s).placements[0].corner) for s in range(8)}
    assert len(corners) > 4


def test_bowls_nest_under_hm(items: dict[str, PreparedItem]) -> None:
    """Paper Fig. 5: HM stacks bowls, because that raises the heightmap least."""
    upright = [o for o in items["bowl"].orientations if o.extents[2] < 0.0501 and o.rotation[2, 2] > 0.99]
    bowl = dataclasses.replace(items["bowl"], orientations=tuple(upright))
    first, second, third = (p.corner for p in _pack(["bowl"] * 3, {"bowl": bowl}).placements)
    np.testing.assert_allclose([second[:2], third[:2]], [first[:2], first[:2]])
    assert 0 < second[2] < 0.02
    assert third[2] == pytest.approx(2 * second[2], abs=1e-5)


def test_replaying_a_packing_gives_its_heightmaps(items: dict[str, PreparedItem]) -> None:
    packing = _pack(["book", "brick", "cup", "can"], items)
    meshes: dict[str, Item] = MESHES
    again = replay(packing.placements, meshes, packing.container, GRID.cell_size)
    for a, b in zip(packing.surfaces, again, strict=True):
        np.testing.assert_array_equal(a.heights, b.heights)


def test_heights_only_grow(items: dict[str, PreparedItem]) -> None:
    packing = _pack(["book", "brick", "cup", "can", "can"], items)
    for before, after in zip(packing.surfaces, packing.surfaces[1:], strict=False):
        assert np.all(after.heights >= before.heights)
        assert after.total > before.total


def test_more_headroom_never_packs_fewer(items: dict[str, PreparedItem]) -> None:
    names = ["brick"] * 12
    packed = [len(_pack(names, items, "dblf", height=h).placements) for h in (0.04, 0.06, 0.11, 0.16)]
    assert packed == sorted(packed)
    assert packed[0] < packed[-1] == 12


@pytest.mark.parametrize(("cell", "step"), [(0.002, 0.003), (0.0, 0.01), (0.002, 0.0), (0.002, -0.01)])
def test_a_grid_that_is_not_whole_cells_is_refused(cell: float, step: float) -> None:
    with pytest.raises(InputError):
        GridConfig(cell_size=cell, grid_step=step)


def test_an_item_exactly_as_tall_as_the_container_fits_and_says_so(items: dict[str, PreparedItem]) -> None:
    """Rounding of a rotation is not protrusion, and a second such item finds no room; it is not too large."""
    for seed in range(20):
        turn = Rotation.random(random_state=np.random.default_rng(seed)).as_matrix()
        cube = box(0.1, 0.1, 0.1, "cube")
        cube = dataclasses.replace(cube, vertices=cube.vertices @ turn.T, com=turn @ cube.com)
        prepared = {"cube": prepare_item(cube, GRID)}
        packing = _pack(["cube", "cube"], prepared, length=0.1, width=0.1, height=0.1)
        assert len(packing.placements) == 1
        assert packing.leftovers[0].reason == "no-legal-candidate"
