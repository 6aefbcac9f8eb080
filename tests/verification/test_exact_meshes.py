"""The audit of whole plans: what it must find and must not, and that it believes no claim of the plan."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Sequence

import manifold3d
import numpy as np
import pytest
import trimesh

from packenv.config import CLEARANCE
from packenv.errors import InputError, PlanError
from packenv.types import Container, FloatArray, Item, Leftover, OrderLine, Placement, Plan
from packenv.verification.exact_meshes import AuditReport, Miscount, audit_plan

CONTAINER = Container(0.4, 0.3, 0.2)
C = 2e-5


def item_of(name: str, mesh: trimesh.Trimesh) -> Item:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()
    return Item(name, vertices, faces, 1.0, 1.0, False, np.zeros(3), np.eye(3), digest, f"{name}.ply")


def union(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    solids = [
        manifold3d.Manifold(
            manifold3d.Mesh64(np.array(p.vertices, order="C"), np.array(p.faces, np.uint64, order="C"))
        )
        for p in parts
    ]
    made = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).to_mesh64()
    return trimesh.Trimesh(made.vert_properties[:, :3], made.tri_verts.astype(np.int64), process=False)


def box(x: float, y: float, z: float, at: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    """A box whose smallest corner is at ``at``."""
    return trimesh.creation.box((x, y, z)).apply_translation(np.array([x, y, z]) / 2 + at)


LEGS = [box(0.01, 0.01, 0.06, [x, y, 0.0]) for x in (0.0, 0.09) for y in (0.0, 0.09)]
ITEMS = {
    name: item_of(name, mesh)
    for name, mesh in {
        "brick": box(0.05, 0.05, 0.05),
        "tile": box(0.1, 0.1, 0.01),
        "crate": box(0.4, 0.3, 0.2),
        "table": union(box(0.1, 0.1, 0.01, [0, 0, 0.055]), *LEGS),
        "ring": trimesh.creation.annulus(0.03, 0.05, 0.02).apply_translation([0.05, 0.05, 0.01]),
        "peg": trimesh.creation.cylinder(0.02, 0.1).apply_translation([0.05, 0.05, 0.05]),
    }.items()
}


def put(name: str, position: Sequence[float], rotation: FloatArray | None = None) -> Placement:
    turn = np.eye(3) if rotation is None else rotation
    return Placement(name, 1, turn, np.asarray(position, float), np.zeros(3), np.zeros(3), 0, 0.0, 0.0, 1)


def audit(*placements: Placement, container: Container = CONTAINER, clearance: float = C) -> AuditReport:
    return audit_plan(Plan(container, placements, ()), ITEMS, clearance=clearance)


def random_plan(seed: int, pieces: int) -> list[Placement]:
    rng = np.random.default_rng(seed)
    names = [n for n in ITEMS if n != "crate"]
    placements = []
    for name in rng.choice(names, pieces):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        q = q * np.sign(np.diag(r))
        q *= np.sign(np.linalg.det(q))
        placements.append(put(str(name), rng.uniform(0.05, 0.25, size=3) * [1, 1, 0.6], q))
    return placements


# ---------------------------------------------------------------------------------------------------- laws


@pytest.mark.parametrize("seed", range(6))
def test_overlaps_and_protrusions_do_not_depend_on_the_sequence(seed: int) -> None:
    placements = random_plan(seed, 7)
    order = np.random.default_rng(seed).permutation(len(placements))
    report = audit(*placements)
    shuffled = audit(*(placements[i] for i in order))
    assert report.overlaps  # seven items at random never fit
    pairs = {frozenset((found.step_a, found.step_b)) for found in report.overlaps}
    assert pairs == {
        frozenset(int(order[s - 1]) + 1 for s in (f.step_a, f.step_b)) for f in shuffled.overlaps
    }
    sides = {(found.step, found.axis, found.side, found.depth) for found in report.protrusions}
    assert sides == {(int(order[f.step - 1]) + 1, f.axis, f.side, f.depth) for f in shuffled.protrusions}


@pytest.mark.parametrize("seed", range(6))
def test_leaving_out_an_item_leaves_out_its_findings_and_adds_none(seed: int) -> None:
    placements = random_plan(seed, 6)
    report = audit(*placements)
    for gone in range(1, len(placements) + 1):
        kept = [step for step in range(1, len(placements) + 1) if step != gone]
        fewer = audit(*(placements[step - 1] for step in kept))
        assert [(kept[f.step_a - 1], kept[f.step_b - 1], f.depth) for f in fewer.overlaps] == [
            (f.step_a, f.step_b, f.depth) for f in report.overlaps if gone not in (f.step_a, f.step_b)
        ]
        assert [(kept[f.step - 1], kept[f.by_step - 1]) for f in fewer.blocked] == [
            (f.step, f.by_step) for f in report.blocked if gone not in (f.step, f.by_step)
        ]


@pytest.mark.parametrize("seed", range(4))
def test_a_larger_clearance_finds_a_part_of_what_a_smaller_one_finds(seed: int) -> None:
    placements = random_plan(seed, 6)
    found = [audit(*placements, clearance=c) for c in (1e-6, 1e-5, 1e-4, 1e-3)]
    for smaller, larger in itertools.pairwise(found):
        assert {(f.step_a, f.step_b) for f in larger.overlaps} <= {
            (f.step_a, f.step_b) for f in smaller.overlaps
        }
        assert {(f.step, f.by_step) for f in larger.blocked} <= {(f.step, f.by_step) for f in smaller.blocked}
    assert all(overlap.depth > report.clearance for report in found for overlap in report.overlaps)


@pytest.mark.parametrize("seed", range(4))
def test_every_overlap_is_blocked_too(seed: int) -> None:
    report = audit(*random_plan(seed, 7))
    assert {(f.step_b, f.step_a) for f in report.overlaps} <= {(f.step, f.by_step) for f in report.blocked}


def test_the_plan_s_own_claims_are_not_believed() -> None:
    honest = put("brick", [0.38, 0.0, 0.0])
    lying = dataclasses.replace(honest, corner=np.zeros(3), extents=np.full(3, 0.05))
    report = audit_plan(Plan(CONTAINER, (lying,), (), metrics={"overlaps": 0.0}), ITEMS)
    assert [(f.axis, f.side) for f in report.protrusions] == [("x", "high")]


# ------------------------------------------------------------------------------------------- closed forms


def test_bricks_that_fill_the_container_exactly_are_fine() -> None:
    spots = itertools.product(range(4), range(6), range(8))  # z slowest: from the floor up
    report = audit(*(put("brick", [0.05 * ix, 0.05 * iy, 0.05 * iz]) for iz, iy, ix in spots))
    assert report.ok, report
    assert report.pairs_checked == 192 * 191 // 2


def test_one_brick_a_hair_too_deep_is_found_with_its_depth() -> None:
    for depth, found in ((0.5 * C, False), (0.95 * C, False), (1.05 * C, True), (2e-3, True)):
        report = audit(put("brick", [0.1, 0.1, 0.0]), put("brick", [0.1, 0.12, 0.05 - depth]))
        assert bool(report.overlaps) == found
        for overlap in report.overlaps:
            assert (overlap.step_a, overlap.step_b) == (1, 2)
            assert (overlap.item_a, overlap.item_b) == ("brick", "brick")
            assert overlap.depth == pytest.approx(depth, rel=0.006)


def test_an_item_wholly_inside_another_is_found() -> None:
    report = audit(put("crate", [0, 0, 0]), put("brick", [0.1, 0.1, 0.1]))
    assert [f.depth for f in report.overlaps] == pytest.approx([0.1], rel=0.006)
    assert not report.protrusions


@pytest.mark.parametrize("depth", [0.9 * CLEARANCE, 1.1 * CLEARANCE, 0.03])
def test_protrusion_is_measured_on_each_side(depth: float) -> None:
    sides = {}
    for axis, size in enumerate(CONTAINER.size):
        for side, at in (("low", -depth), ("high", size - 0.05 + depth)):
            position = np.full(3, 0.1)
            position[axis] = at
            report = audit(put("brick", position))
            sides["xyz"[axis], side] = [(f.axis, f.side, f.depth) for f in report.protrusions]
            assert report.ok == (depth < CLEARANCE)
    for (axis, side), found in sides.items():
        assert found == ([] if depth < CLEARANCE else [(axis, side, pytest.approx(depth, rel=1e-6))])


def test_a_turned_item_protrudes_by_its_corner() -> None:
    half = np.sqrt(0.5)
    turned = np.array([[half, -half, 0], [half, half, 0], [0, 0, 1.0]])
    report = audit(put("brick", [0.02, 0.1, 0.0], turned))
    assert [(f.axis, f.side) for f in report.protrusions] == [("x", "low")]
    assert report.protrusions[0].depth == pytest.approx(0.05 * half - 0.02, abs=1e-12)


# ------------------------------------------------------------------------------------ feasible from above


def test_what_is_under_a_table_must_come_first() -> None:
    table, brick = put("table", [0.1, 0.1, 0.0]), put("brick", [0.125, 0.125, 0.0])
    assert audit(brick, table).ok
    report = audit(table, brick)
    assert not report.ok
    assert not report.overlaps
    assert [(f.step, f.item, f.by_step, f.by_item) for f in report.blocked] == [(2, "brick", 1, "table")]


def test_a_ring_on_a_peg_and_a_tile_on_top() -> None:
    peg, ring, tile = put("peg", [0, 0, 0]), put("ring", [0, 0, 0]), put("tile", [0, 0, 0.1])
    assert audit(peg, ring, tile).ok
    assert audit(ring, peg, tile).ok
    assert [(f.step, f.by_step) for f in audit(tile, peg, ring).blocked] == [(2, 1), (3, 1)]


def test_the_empty_plan_is_fine() -> None:
    report = audit()
    assert report.ok
    assert report.pairs_checked == 0


# ------------------------------------------------------------------------------------- report and mistakes


def test_report_is_json() -> None:
    report = audit(
        put("brick", [0.1, 0.1, 0.0]), put("brick", [0.12, 0.1, 0.0]), put("tile", [-0.01, 0, 0.19])
    )
    data = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert data["ok"] is False
    assert data["overlaps"] == [
        {"step_a": 1, "step_b": 2, "item_a": "brick", "item_b": "brick", "depth": report.overlaps[0].depth}
    ]
    assert data["protrusions"] == [
        {"step": 3, "item": "tile", "axis": "x", "side": "low", "depth": pytest.approx(0.01)}
    ]
    assert data["blocked"] == [{"step": 2, "item": "brick", "by_step": 1, "by_item": "brick"}]


NOT_A_ROTATION = {
    "stretched": np.diag([1.0, 1.0, 1.0 + 1e-6]),
    "mirrored": np.diag([1.0, 1.0, -1.0]),
    "nan": np.full((3, 3), np.nan),
    "flat": np.eye(3)[:2],
}


@pytest.mark.parametrize("name", sorted(NOT_A_ROTATION))
def test_a_pose_that_is_not_rigid_is_refused(name: str) -> None:
    with pytest.raises(PlanError, match=r"step 2 \(tile\)"):
        audit(put("brick", [0.2, 0.2, 0]), put("tile", [0, 0, 0], NOT_A_ROTATION[name]))


def test_other_mistakes_are_one_line_each() -> None:
    with pytest.raises(PlanError, match=r"step 1 \(brick\).*finite"):
        audit(put("brick", [0.0, np.inf, 0.0]))
    with pytest.raises(PlanError, match=r"step 1 \(teapot\).*catalogue"):
        audit(put("teapot", [0.0, 0.0, 0.0]))
    for clearance in (0.0, -1.0, np.nan, 1.0):
        with pytest.raises(InputError, match="clearance"):
            audit(clearance=clearance)


# --------------------------------------------------------------------------------------------- pieces


@pytest.mark.parametrize(
    ("ordered", "placed", "left"), [(2, 1, 1), (2, 0, 2), (2, 1, 0), (2, 1, 2), (0, 1, 0)]
)
def test_placed_and_left_over_pieces_are_those_of_the_order(ordered: int, placed: int, left: int) -> None:
    lines = (OrderLine("tile", 1), *([OrderLine("brick", ordered)] if ordered else []))
    bricks = [put("brick", [0.1 * k, 0.0, 0.0]) for k in range(placed)]
    leftovers = tuple(Leftover("brick", placed + k + 1, "no-legal-candidate", "") for k in range(left))
    plan = Plan(CONTAINER, (put("tile", [0.0, 0.1, 0.0]), *bricks), leftovers, order=lines)
    wrong = () if placed + left == ordered else (Miscount("brick", ordered, placed + left),)
    assert audit_plan(plan, ITEMS).miscounted == wrong
