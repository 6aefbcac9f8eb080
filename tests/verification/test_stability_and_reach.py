"""Checking a plan's stability and manipulation again: what is found, and that no claim is believed."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.errors import PlanError
from packenv.io.plans import plan_to_json, read_plan
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.options import Constraints, GraspRule, PlanOptions, StabilityRule
from packenv.robot.cell import Place
from packenv.robot.files import default_cell
from packenv.robot.gripper import top_down
from packenv.types import Container, FloatArray, OrderLine, Placement, Plan, RobotPath
from packenv.verification.stability_and_reach import Recheck, recheck
from tests.robot.sampling import TX90
from tests.shapes import box, cup, cylinder
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.005, n_yaws=2)
BOX = Container(0.2, 0.2, 0.12)
MESHES = {
    item.name: item
    for item in (
        box(0.08, 0.06, 0.04, "brick"),
        box(0.10, 0.08, 0.02, "book"),
        box(0.1998, 0.06, 0.04, "shelf"),
        cylinder(0.02, 0.06, "can", sections=24),
        cup(0.03, 0.05, name="cup"),
    )
}
NAMES = ["book", "brick", "can", "cup", "brick"]


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return shelf_of(MESHES, GRID)


@pytest.fixture(scope="module")
def robot_plan(shelf: ItemShelf) -> Plan:
    options = PlanOptions(grid=GRID)
    packing = assemble(options, shelf, BOX, margins=True).pack(NAMES, shelf.prepared, BOX)
    assert packing.complete
    lines = tuple(OrderLine(name, n) for name, n in Counter(NAMES).items())
    return make_plan(packing, lines, shelf, options)


def again(
    plan: Plan,
    shelf: ItemShelf,
    constraints: Constraints = "robot",
    stability: StabilityRule = "paper",
    grasp: GraspRule = "seal",
) -> Recheck:
    options = PlanOptions(constraints=constraints, stability=stability, grasp=grasp, grid=GRID)
    return recheck(plan, MESHES, shelf.fields, options)


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


def path_of(plan: Plan, step: int) -> RobotPath:
    path = plan.placements[step - 1].path
    assert path is not None
    return path


def with_path(plan: Plan, step: int, **changes: FloatArray) -> Plan:
    return with_step(plan, step, path=dataclasses.replace(path_of(plan, step), **changes))


def told(plan: Plan, step: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joints, grasp and cup heights that a step states."""
    path = path_of(plan, step)
    return path.joints, path.grasp, path.cup_heights


# ------------------------------------------------------------------------------------------------- laws


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_an_honest_plan_passes(constraints: Constraints, robot_plan: Plan, shelf: ItemShelf) -> None:
    assert again(robot_plan, shelf, constraints) == Recheck((), ())
    assert again(robot_plan, shelf, constraints).ok


def test_under_overlap_nothing_is_asked(shelf: ItemShelf) -> None:
    assert again(pile(put("brick", 0.05, 0.05, 0.07)), shelf, "overlap").ok


def test_under_stability_manipulation_is_not_asked(robot_plan: Plan, shelf: ItemShelf) -> None:
    bare = with_step(robot_plan, 2, details={}, path=None)
    assert again(bare, shelf, "stability").ok
    assert again(bare, shelf) == Recheck((), (2,))


def test_what_a_plan_says_of_its_stability_is_not_believed(robot_plan: Plan, shelf: ItemShelf) -> None:
    lie = {"decided_by": "first-order", "contacts": 4, "forces": [], "margin_deg": 45.0}
    floating = dataclasses.replace(put("brick", 0.05, 0.05, 0.03), details={"stability": lie})
    assert again(pile(floating), shelf, "stability") == Recheck((1,))
    silent = with_step(
        robot_plan, 1, details={k: v for k, v in robot_plan.placements[0].details.items() if k != "stability"}
    )
    assert again(silent, shelf).ok


def test_what_only_two_walls_hold_stands_by_the_papers_check_alone(shelf: ItemShelf) -> None:
    hanging = pile(put("shelf", 0.0001, 0.05, 0.05))
    for stability in ("cautious", "margin", "physics"):
        assert again(hanging, shelf, "stability", stability) == Recheck((1,))
    assert again(hanging, shelf, "stability", "paper").ok
    lying = pile(put("shelf", 0.0001, 0.05, 0.0))
    assert again(lying, shelf, "stability", "cautious").ok


@pytest.mark.parametrize("step", range(1, len(NAMES) + 1))
def test_only_the_tampered_step_is_unreachable(step: int, robot_plan: Plan, shelf: ItemShelf) -> None:
    joints, grasp, heights = told(robot_plan, step)
    for changes in (
        {"joints": joints + 1e-4},
        {"joints": -joints},
        {"grasp": grasp + np.array([1e-4, 0, 0])},
        {"cup_heights": heights - 1e-4},
    ):
        assert again(with_path(robot_plan, step, **changes), shelf) == Recheck((), (step,))


def test_a_turn_of_the_last_joint_beyond_its_limit_is_found(robot_plan: Plan, shelf: ItemShelf) -> None:
    """A whole turn leaves the cup where it is: only the limits tell."""
    joints, _, _ = told(robot_plan, 1)
    spin = joints.copy()
    spin[:, 5] += 2 * np.pi * np.where(joints[:, 5].mean() > 0, 1, -1)
    assert np.all(TX90.limit_margin(spin) < 0)
    np.testing.assert_allclose(TX90.forward(spin), TX90.forward(joints), atol=1e-9)
    assert again(with_path(robot_plan, 1, joints=spin), shelf).unreachable_steps == (1,)


@pytest.mark.parametrize(
    "changes",
    [
        {"joints": []},
        {"joints": [[]]},
        {"joints": [1.0, 2.0]},
        {"joints": "none"},
        {"joints": None},
        {"joints": {"a": 1}},
        {"joints": [[float("nan")] * 6] * 4},
        {"grasp": [0.1, 0.1]},
        {"grasp": "centre"},
        {"cup_heights": [0.1]},
        {"cup_heights": None},
        {"cup_heights": [[0.1], [0.2, 0.3]]},
    ],
    ids=str,
)
def test_a_malformed_path_is_told_when_the_file_is_read(
    changes: dict[str, object], robot_plan: Plan, tmp_path: Path
) -> None:
    document = plan_to_json(robot_plan)
    document["steps"][1]["details"]["manipulation"].update(changes)
    (key,) = changes
    with pytest.raises(PlanError, match=rf"steps\[1\]\.details\.manipulation\.{key}"):
        read_again(document, tmp_path)


@pytest.mark.parametrize("stated", [None, [], {}])
def test_a_path_that_is_no_path_is_told_when_the_file_is_read(
    stated: object, robot_plan: Plan, tmp_path: Path
) -> None:
    document = plan_to_json(robot_plan)
    document["steps"][2]["details"]["manipulation"] = stated
    with pytest.raises(PlanError, match=r"steps\[2\]\.details"):
        read_again(document, tmp_path)


def read_again(document: Mapping[str, Any], folder: Path) -> Plan:
    (folder / "plan.json").write_text(json.dumps(document))
    return read_plan(folder / "plan.json")


def test_a_step_without_a_path_is_unreachable(robot_plan: Plan, shelf: ItemShelf, tmp_path: Path) -> None:
    assert again(with_step(robot_plan, 3, path=None), shelf) == Recheck((), (3,))
    document = plan_to_json(robot_plan)
    document["steps"][2]["details"] = {}
    assert again(read_again(document, tmp_path), shelf) == Recheck((), (3,))
    assert again(read_again(plan_to_json(robot_plan), tmp_path), shelf).ok


@pytest.mark.parametrize("name", ["joints", "grasp", "cup_heights"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_path_that_is_not_finite_is_unreachable_not_a_crash(
    value: float, name: str, robot_plan: Plan, shelf: ItemShelf
) -> None:
    wrong = getattr(path_of(robot_plan, 2), name).copy()
    wrong.flat[0] = value
    assert again(with_path(robot_plan, 2, **{name: wrong}), shelf) == Recheck((), (2,))


def test_a_way_that_stops_above_the_rim_is_unreachable(robot_plan: Plan, shelf: ItemShelf) -> None:
    joints, _, heights = told(robot_plan, 1)
    for kept in (0, 1, 2, len(joints) - 1):
        cut = with_path(robot_plan, 1, joints=joints[:kept], cup_heights=heights[:kept])
        assert again(cut, shelf).unreachable_steps == (1,)


@pytest.mark.parametrize("step", range(1, len(NAMES) + 1))
def test_a_way_that_starts_below_the_rim_is_unreachable(
    step: int, robot_plan: Plan, shelf: ItemShelf
) -> None:
    """All else holds: it is the plan's own way without its first waypoint, 2 cm higher than the next."""
    joints, grasp, heights = told(robot_plan, step)
    low = robot_plan.placements[step - 1].corner[2] - grasp[2]
    assert heights[1] + low < BOX.height <= heights[0] + low
    late = with_path(robot_plan, step, joints=joints[1:], cup_heights=heights[1:])
    assert again(late, shelf) == Recheck((), (step,))


def test_a_tilted_cup_is_unreachable(robot_plan: Plan, shelf: ItemShelf) -> None:
    """The lip's middle is where it is stated, the cup leans by half a degree about it."""
    joints, _, _ = told(robot_plan, 1)
    tool, tilt = TX90.tool(joints), np.radians(0.5)
    lean = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    tool[:, :3, :3] = lean @ tool[:, :3, :3]
    found = TX90.continuous_branches(TX90.gripper.tool_to_flange(tool)).q
    leaning = found[np.argmin(np.abs(found - joints).max(axis=(1, 2)))]
    np.testing.assert_allclose(TX90.tool(leaning)[:, :3, 3], TX90.tool(joints)[:, :3, 3], atol=1e-9)
    assert again(with_path(robot_plan, 1, joints=leaning), shelf) == Recheck((), (1,))


@pytest.mark.parametrize("angle", [0.01, 1.5, -1.5])
def test_an_item_that_turns_on_its_way_is_unreachable(
    angle: float, robot_plan: Plan, shelf: ItemShelf
) -> None:
    """The cup stays where it is stated and upright: only the held item tells."""
    joints, _, _ = told(robot_plan, 1)
    turning, turned = joints.copy(), joints.copy()
    turning[:, 5] += np.linspace(angle, 0.0, len(joints))
    turned[:, 5] += angle / 8
    assert TX90.limit_margin(turning).min() > 0 < TX90.limit_margin(turned).min()
    assert again(with_path(robot_plan, 1, joints=turning), shelf) == Recheck((), (1,))
    assert again(with_path(robot_plan, 1, joints=turned), shelf).ok


def test_a_way_with_the_arm_below_the_rim_or_in_itself_is_unreachable(shelf: ItemShelf) -> None:
    """Far from the robot some branches are clear and some are not: a plan may state only those that are."""
    setup = dataclasses.replace(default_cell(), container=Place((0.6, -0.1, 0.0)))
    cell, options = setup.with_container(BOX), PlanOptions(cell=setup, grid=GRID)
    packing = assemble(options, shelf, BOX).pack(["brick"], shelf.prepared, BOX)
    plan = make_plan(packing, (OrderLine("brick", 1),), shelf, options)
    joints, _, _ = told(plan, 1)
    found = TX90.continuous_branches(TX90.forward(joints)).q
    clear = cell.arm_clear(found)
    assert 0 < clear.sum() < len(found)
    for branch, fine in zip(found, clear, strict=True):
        told_so = with_path(plan, 1, joints=branch)
        assert recheck(told_so, MESHES, shelf.fields, options).ok == fine


def test_a_way_down_to_another_place_is_unreachable(robot_plan: Plan, shelf: ItemShelf) -> None:
    """Of step 3, with step 1's joints, which do fit step 1's grasp."""
    joints, grasp, heights = told(robot_plan, 1)
    other = with_path(robot_plan, 3, joints=joints, grasp=grasp, cup_heights=heights)
    assert again(other, shelf).unreachable_steps == (3,)


def test_a_jump_to_another_branch_is_unreachable(robot_plan: Plan, shelf: ItemShelf) -> None:
    """Alg. 1 wants one continuous motion; here one waypoint is reached by another posture of the arm."""
    joints, grasp, heights = told(robot_plan, 1)
    middle = len(joints) // 2
    cup = default_cell().with_container(BOX).to_base(np.array([[*grasp[:2], heights[middle]]]))
    found = TX90.inverse(TX90.gripper.tool_to_flange(top_down(cup)))
    postures = found.q[0][found.valid[0]]
    postures = postures[TX90.limit_margin(postures) >= 0]
    far = postures[np.argmax(np.abs(postures - joints[middle]).max(axis=1))]
    assert np.abs(far - joints[middle]).max() > 0.5
    jump = joints.copy()
    jump[middle] = far
    assert again(with_path(robot_plan, 1, joints=jump), shelf).unreachable_steps == (1,)


# ---------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize(("overhang", "stands"), [(0.02, True), (0.03, True), (0.05, False), (0.07, False)])
def test_an_item_over_an_edge(overhang: float, stands: bool, shelf: ItemShelf) -> None:
    """A brick of 8 cm on a book falls where more than half of it is beyond the edge."""
    plan = pile(put("book", 0.02, 0.06, 0.0), put("brick", 0.04 + overhang, 0.07, 0.02))
    assert plan.placements[0].extents[0] == pytest.approx(0.10)
    assert again(plan, shelf, "stability").unstable_steps == (() if stands else (2,))


@pytest.mark.parametrize(
    ("overhang", "paper", "margin"),
    [
        (0.02, True, True),
        (0.035, True, True),
        (0.04 - 0.02 * np.tan(np.radians(8.5)), True, True),
        (0.04 - 0.02 * np.tan(np.radians(7.5)), True, False),
        (0.039, True, False),
        (0.05, False, False),
    ],
)
def test_near_the_edge_only_the_paper_s_rule_is_content(
    overhang: float, paper: bool, margin: bool, shelf: ItemShelf
) -> None:
    """A brick 4 cm high whose centre of mass is d inside the edge stands up to a tilt of atan(d / 2 cm).

    5 mm: 14°; 1 mm: 2.9°, less than the margin's 8°, which is met to half a degree on either side.
    """
    plan = pile(put("book", 0.02, 0.06, 0.0), put("brick", 0.04 + overhang, 0.07, 0.02))
    assert again(plan, shelf, "stability", "paper").ok == paper
    assert again(plan, shelf, "stability", "margin").ok == margin


def test_what_floats_is_unstable_from_its_step_on(shelf: ItemShelf) -> None:
    floating = put("brick", 0.1, 0.1, 0.04)
    plan = pile(put("book", 0.0, 0.0, 0.0), floating, put("book", 0.0, 0.0, 0.02))
    assert again(plan, shelf, "stability").unstable_steps == (2, 3)


def test_what_comes_later_may_hold_what_fell_before(shelf: ItemShelf) -> None:
    """A brick hangs 5 cm over, its centre 1 cm beyond the edge; a brick on its inner end holds it down.

    The two weigh the same, and the upper one's centre is 2.5 cm inside: 1 cm out and 2.5 cm in.
    """
    book, hanging = put("book", 0.02, 0.06, 0.0), put("brick", 0.09, 0.07, 0.02)
    upper = put("brick", 0.055, 0.07, 0.06)
    assert again(pile(book, hanging, upper), shelf, "stability").unstable_steps == (2,)


def test_the_sequence_matters(shelf: ItemShelf) -> None:
    """Upside down in time: the upper one floats, and the lower one has no way down past it."""
    below, above = put("book", 0.05, 0.05, 0.0), put("brick", 0.05, 0.05, 0.02)
    assert again(pile(below, above), shelf, "stability").ok
    turned = again(pile(above, below), shelf)
    assert turned.unstable_steps == (1,)
    assert 2 in turned.unreachable_steps


@pytest.mark.parametrize("step", [1, 3, 5])
def test_an_item_outside_the_container_is_unreachable(step: int, robot_plan: Plan, shelf: ItemShelf) -> None:
    aside = with_step(robot_plan, step, position=robot_plan.placements[step - 1].position - [0.5, 0, 0])
    found = again(aside, shelf)
    assert step in found.unreachable_steps
    assert not set(range(1, step)) & set(found.unreachable_steps)


def test_items_in_each_other_give_an_answer(shelf: ItemShelf) -> None:
    assert isinstance(again(pile(put("brick", 0.0, 0.0, 0.0), put("book", 0.0, 0.0, 0.01)), shelf), Recheck)


def test_the_empty_plan_passes(shelf: ItemShelf) -> None:
    assert again(pile(), shelf).ok


def test_the_grasp_rule_is_the_plan_s(robot_plan: Plan, shelf: ItemShelf) -> None:
    """The paper's rule takes any item at its centre; a can on its side has no flat spot."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    options = PlanOptions(grasp="paper", grid=GRID)
    packing = assemble(options, shelf, BOX).pack(["brick"], shelf.prepared, BOX)
    assert again(pile(*packing.placements), shelf, grasp="paper").ok
    lying = put("can", 0.0, 0.0, 0.0, turn=turn)
    for rule in _rules():
        assert again(pile(lying), shelf, grasp=rule).unreachable_steps == (1,)


def _rules() -> Sequence[GraspRule]:
    return ("seal", "flat", "paper")
