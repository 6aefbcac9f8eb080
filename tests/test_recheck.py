"""Checking a plan's stability and manipulation again: what is found, and that no claim is believed."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import prepare_item
from packenv.io.plan_maker import make_plan
from packenv.planning.assembly import PlannerChoice, Shelf, assemble
from packenv.recheck import Recheck, recheck
from packenv.robot import gripper, tx90
from packenv.robot.cell import Cell
from packenv.types import Container, FloatArray, OrderLine, Placement, Plan
from tests.shapes import box, cup, cylinder

GRID = GridConfig(cell_size=0.005, n_yaws=2)
BOX = Container(0.2, 0.2, 0.12)
MESHES = {
    item.name: item
    for item in (
        box(0.08, 0.06, 0.04, "brick"),
        box(0.10, 0.08, 0.02, "book"),
        cylinder(0.02, 0.06, "can", sections=24),
        cup(0.03, 0.05, name="cup"),
    )
}
NAMES = ["book", "brick", "can", "cup", "brick"]


@pytest.fixture(scope="module")
def shelf() -> Shelf:
    prepared = {name: prepare_item(item, GRID) for name, item in MESHES.items()}
    return Shelf(MESHES, prepared, {name: SurfaceField.of_item(item) for name, item in MESHES.items()})


@pytest.fixture(scope="module")
def robot_plan(shelf: Shelf) -> Plan:
    choice = PlannerChoice(with_margin=True)
    packing = assemble(choice, shelf, BOX, GRID).pack(NAMES, shelf.prepared, BOX)
    assert packing.complete
    lines = tuple(OrderLine(name, n) for name, n in Counter(NAMES).items())
    return make_plan(packing, lines, MESHES, GRID, catalogue="builtin", settings={})


def again(
    plan: Plan,
    shelf: Shelf,
    constraints: str = "robot",
    stability: str = "paper",
    contacts: str = "surface",
    grasp: str = "seal",
) -> Recheck:
    return recheck(
        plan,
        MESHES,
        shelf.fields,
        constraints=constraints,
        stability=stability,
        contacts=contacts,
        grasp=grasp,
        cell_size=GRID.cell_size,
    )


def put(name: str, *position: float, turn: FloatArray | None = None) -> Placement:
    rotation = np.eye(3) if turn is None else turn
    placed = MESHES[name].vertices @ rotation.T
    at = np.array(position) - placed.min(axis=0)
    return Placement(name, 1, rotation, at, np.array(position), np.ptp(placed, axis=0), 0, 0.0, 0.0, 1)


def pile(*placements: Placement) -> Plan:
    return Plan(BOX, placements, ())


def with_step(plan: Plan, step: int, **changes: Any) -> Plan:
    steps = list(plan.placements)
    steps[step - 1] = dataclasses.replace(steps[step - 1], **changes)
    return dataclasses.replace(plan, placements=tuple(steps))


def with_manipulation(plan: Plan, step: int, **changes: object) -> Plan:
    details = dict(plan.placements[step - 1].details)
    told = details["manipulation"]
    assert isinstance(told, Mapping)
    details["manipulation"] = {**told, **changes}
    return with_step(plan, step, details=details)


def told(plan: Plan, step: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joints, grasp and cup heights that a step states."""
    manipulation = plan.placements[step - 1].details["manipulation"]
    assert isinstance(manipulation, Mapping)
    return tuple(np.array(manipulation[key]) for key in ("joints", "grasp", "cup_heights"))  # type: ignore[return-value]


# ------------------------------------------------------------------------------------------------- laws


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_an_honest_plan_passes(constraints: str, robot_plan: Plan, shelf: Shelf) -> None:
    assert again(robot_plan, shelf, constraints) == Recheck((), ())
    assert again(robot_plan, shelf, constraints).ok


def test_under_overlap_nothing_is_asked(shelf: Shelf) -> None:
    assert again(pile(put("brick", 0.05, 0.05, 0.07)), shelf, "overlap").ok


def test_under_stability_manipulation_is_not_asked(robot_plan: Plan, shelf: Shelf) -> None:
    bare = with_step(robot_plan, 2, details={})
    assert again(bare, shelf, "stability").ok
    assert again(bare, shelf) == Recheck((), (2,))


def test_what_a_plan_says_of_its_stability_is_not_believed(robot_plan: Plan, shelf: Shelf) -> None:
    lie = {"decided_by": "first-order", "contacts": 4, "forces": [], "margin_deg": 45.0}
    floating = dataclasses.replace(put("brick", 0.05, 0.05, 0.03), details={"stability": lie})
    assert again(pile(floating), shelf, "stability") == Recheck((1,))
    silent = with_step(
        robot_plan, 1, details={k: v for k, v in robot_plan.placements[0].details.items() if k != "stability"}
    )
    assert again(silent, shelf).ok


@pytest.mark.parametrize("step", range(1, len(NAMES) + 1))
def test_only_the_tampered_step_is_unreachable(step: int, robot_plan: Plan, shelf: Shelf) -> None:
    joints, grasp, heights = told(robot_plan, step)
    for changes in (
        {"joints": (joints + 1e-4).tolist()},
        {"joints": (-joints).tolist()},
        {"grasp": (grasp + np.array([1e-4, 0, 0])).tolist()},
        {"cup_heights": (heights - 1e-4).tolist()},
    ):
        assert again(with_manipulation(robot_plan, step, **changes), shelf) == Recheck((), (step,))


def test_a_turn_of_the_last_joint_beyond_its_limit_is_found(robot_plan: Plan, shelf: Shelf) -> None:
    """A whole turn leaves the cup where it is: only the limits tell."""
    joints, _, _ = told(robot_plan, 1)
    spin = joints.copy()
    spin[:, 5] += 2 * np.pi * np.where(joints[:, 5].mean() > 0, 1, -1)
    assert np.all(tx90.limit_margin(spin) < 0)
    np.testing.assert_allclose(tx90.forward(spin), tx90.forward(joints), atol=1e-9)
    assert again(with_manipulation(robot_plan, 1, joints=spin.tolist()), shelf).unreachable_steps == (1,)


@pytest.mark.parametrize(
    "changes",
    [
        {"joints": []},
        {"joints": [[]]},
        {"joints": [1.0, 2.0]},
        {"joints": "none"},
        {"joints": None},
        {"joints": {"a": 1}},
        {"joints": [[float("nan")] * 6]},
        {"grasp": [0.1, 0.1]},
        {"grasp": "centre"},
        {"cup_heights": [0.1]},
        {"cup_heights": None},
        {"cup_heights": [[0.1], [0.2, 0.3]]},
    ],
    ids=str,
)
def test_malformed_details_are_unreachable_not_a_crash(
    changes: dict[str, object], robot_plan: Plan, shelf: Shelf
) -> None:
    assert again(with_manipulation(robot_plan, 2, **changes), shelf) == Recheck((), (2,))


@pytest.mark.parametrize("details", [{}, {"manipulation": None}, {"manipulation": []}, {"manipulation": {}}])
def test_a_step_without_joints_is_unreachable(
    details: dict[str, object], robot_plan: Plan, shelf: Shelf
) -> None:
    assert again(with_step(robot_plan, 3, details=details), shelf) == Recheck((), (3,))


def test_a_way_that_stops_above_the_rim_is_unreachable(robot_plan: Plan, shelf: Shelf) -> None:
    joints, _, heights = told(robot_plan, 1)
    cut = with_manipulation(robot_plan, 1, joints=joints[:1].tolist(), cup_heights=heights[:1].tolist())
    assert again(cut, shelf).unreachable_steps == (1,)


def test_a_way_down_to_another_place_is_unreachable(robot_plan: Plan, shelf: Shelf) -> None:
    """Of step 3, with step 1's joints, which do fit step 1's grasp."""
    joints, grasp, heights = told(robot_plan, 1)
    other = with_manipulation(
        robot_plan, 3, joints=joints.tolist(), grasp=grasp.tolist(), cup_heights=heights.tolist()
    )
    assert again(other, shelf).unreachable_steps == (3,)


def test_a_jump_to_another_branch_is_unreachable(robot_plan: Plan, shelf: Shelf) -> None:
    """Alg. 1 wants one continuous motion; here one waypoint is reached by another posture of the arm."""
    joints, grasp, heights = told(robot_plan, 1)
    middle = len(joints) // 2
    cup = Cell.beside(BOX).to_base(np.array([[*grasp[:2], heights[middle]]]))
    found = tx90.inverse(gripper.tool_to_flange(gripper.top_down(cup)))
    postures = found.q[0][found.valid[0]]
    postures = postures[tx90.limit_margin(postures) >= 0]
    far = postures[np.argmax(np.abs(postures - joints[middle]).max(axis=1))]
    assert np.abs(far - joints[middle]).max() > 0.5
    jump = joints.copy()
    jump[middle] = far
    assert again(with_manipulation(robot_plan, 1, joints=jump.tolist()), shelf).unreachable_steps == (1,)


# ---------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize(("overhang", "stands"), [(0.02, True), (0.03, True), (0.05, False), (0.07, False)])
def test_an_item_over_an_edge(overhang: float, stands: bool, shelf: Shelf) -> None:
    """A brick of 8 cm on a book falls where more than half of it is beyond the edge."""
    plan = pile(put("book", 0.02, 0.06, 0.0), put("brick", 0.04 + overhang, 0.07, 0.02))
    assert plan.placements[0].extents[0] == pytest.approx(0.10)
    assert again(plan, shelf, "stability").unstable_steps == (() if stands else (2,))


@pytest.mark.parametrize(
    ("overhang", "paper", "margin"),
    [(0.02, True, True), (0.035, True, True), (0.039, True, False), (0.05, False, False)],
)
def test_near_the_edge_only_the_paper_s_rule_is_content(
    overhang: float, paper: bool, margin: bool, shelf: Shelf
) -> None:
    """A brick 4 cm high whose centre of mass is d inside the edge stands up to a tilt of atan(d / 2 cm).

    5 mm: 14°; 1 mm: 2.9°, less than the margin's 8°.
    """
    plan = pile(put("book", 0.02, 0.06, 0.0), put("brick", 0.04 + overhang, 0.07, 0.02))
    assert again(plan, shelf, "stability", "paper").ok == paper
    assert again(plan, shelf, "stability", "margin").ok == margin


def test_what_floats_is_unstable_from_its_step_on(shelf: Shelf) -> None:
    floating = put("brick", 0.1, 0.1, 0.04)
    plan = pile(put("book", 0.0, 0.0, 0.0), floating, put("book", 0.0, 0.0, 0.02))
    assert again(plan, shelf, "stability").unstable_steps == (2, 3)


def test_what_comes_later_may_hold_what_fell_before(shelf: Shelf) -> None:
    """A brick hangs 5 cm over, its centre 1 cm beyond the edge; a brick on its inner end holds it down.

    The two weigh the same, and the upper one's centre is 2.5 cm inside: 1 cm out and 2.5 cm in.
    """
    book, hanging = put("book", 0.02, 0.06, 0.0), put("brick", 0.09, 0.07, 0.02)
    upper = put("brick", 0.055, 0.07, 0.06)
    assert again(pile(book, hanging, upper), shelf, "stability").unstable_steps == (2,)


def test_the_sequence_matters(shelf: Shelf) -> None:
    """Upside down in time: the upper one floats, and the lower one has no way down past it."""
    below, above = put("book", 0.05, 0.05, 0.0), put("brick", 0.05, 0.05, 0.02)
    assert again(pile(below, above), shelf, "stability").ok
    turned = again(pile(above, below), shelf)
    assert turned.unstable_steps == (1,)
    assert 2 in turned.unreachable_steps


@pytest.mark.parametrize("step", [1, 3, 5])
def test_an_item_outside_the_container_is_unreachable(step: int, robot_plan: Plan, shelf: Shelf) -> None:
    aside = with_step(robot_plan, step, position=robot_plan.placements[step - 1].position - [0.5, 0, 0])
    found = again(aside, shelf)
    assert step in found.unreachable_steps
    assert not set(range(1, step)) & set(found.unreachable_steps)


def test_items_in_each_other_give_an_answer(shelf: Shelf) -> None:
    assert isinstance(again(pile(put("brick", 0.0, 0.0, 0.0), put("book", 0.0, 0.0, 0.01)), shelf), Recheck)


def test_the_empty_plan_passes(shelf: Shelf) -> None:
    assert again(pile(), shelf).ok


def test_the_grasp_rule_is_the_plan_s(robot_plan: Plan, shelf: Shelf) -> None:
    """The paper's rule takes any item at its centre; a can on its side has no flat spot."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    choice = PlannerChoice(grasp="paper")
    packing = assemble(choice, shelf, BOX, GRID).pack(["brick"], shelf.prepared, BOX)
    assert again(pile(*packing.placements), shelf, grasp="paper").ok
    lying = put("can", 0.0, 0.0, 0.0, turn=turn)
    for rule in _rules():
        assert again(pile(lying), shelf, grasp=rule).unreachable_steps == (1,)


def _rules() -> Sequence[str]:
    return ("seal", "flat", "paper")
