"""A plan's motions: every law that a robot's controller and its surroundings ask for, on both robots."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import pytest

import packenv as rp
from packenv.execution.motion_check import MotionCheck, Task
from packenv.execution.trajectories import DWELL, _task, trajectories
from packenv.geometry.transforms import quaternion_to_rotation
from packenv.io.trajectories import StepMotion, Trajectories
from packenv.robot.cell import Cell, CellSetup, Place
from packenv.robot.timing import MotionLimits
from packenv.robot.transfer import same_posture
from packenv.types import Pose
from tests.conftest import REPO
from tests.memory_samples import BOX, COARSE, ORDER, meshes
from tests.robot.sampling import ROBOTS, TX90

LEGS = ["approach", "lift", "carry", "lower", "retreat"]


def planned(setup: CellSetup) -> rp.Plan:
    return rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), heuristic="hm", grid=COARSE, cell=setup)


TURNED = CellSetup(TX90, container=Place((0.38, -0.14, 0.03), 20.0))
SETUPS = {**{robot.name: CellSetup(robot) for robot in ROBOTS}, "turned": TURNED}


@pytest.fixture(scope="module", params=SETUPS)
def setup(request: pytest.FixtureRequest) -> CellSetup:
    """Both robots' default cells, and one with a container that is turned and raised."""
    return SETUPS[request.param]


@pytest.fixture(scope="module")
def plan(setup: CellSetup) -> rp.Plan:
    return planned(setup)


@pytest.fixture(scope="module")
def found(plan: rp.Plan) -> Trajectories:
    return trajectories(plan)


@pytest.fixture(scope="module")
def document(found: Trajectories) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(json.dumps(found.to_json(), allow_nan=False))
    return read


def seconds(row: dict[str, Any]) -> float:
    time = row["time_from_start"]
    return float(time["sec"] + 1e-9 * time["nanosec"])


def pose_of(row: dict[str, Any]) -> np.ndarray:
    rotation = quaternion_to_rotation(np.array(row["quat_xyzw"]))
    return Pose(rotation, np.array(row["position"])).matrix


def held_poses(step: StepMotion, cell: Cell) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) joints while the item is held, and (n, 4, 4) of its mesh frame, base frame."""
    assert step.motion is not None
    times = step.motion.times
    held = (times >= step.vacuum_on) & (times <= step.vacuum_off)
    q = step.motion.positions[held]
    tools = cell.robot.tool(q)
    return q, tools @ (np.linalg.inv(tools[0]) @ step.pick.matrix)


# ------------------------------------------------------------------------------------------ the motion


def test_every_step_has_a_motion(found: Trajectories, plan: rp.Plan) -> None:
    assert found.ok
    assert [(s.step, s.item) for s in found.steps] == [(k, p.item) for k, p in enumerate(plan.placements, 1)]
    assert {step.posture for step in found.steps} == {"planned"}
    assert [leg.name for leg in found.steps[0].legs] == LEGS
    for step in found.steps[1:]:
        names = [leg.name for leg in step.legs]
        assert names[0] == "travel"
        assert [name for name in names if name != "travel"] == LEGS


def test_limits_hold_as_written(document: dict[str, Any]) -> None:
    robot = document["robot"]
    for step in document["steps"]:
        points = step["trajectory"]["points"]
        q, v, a = (np.array([p[k] for p in points]) for k in ("positions", "velocities", "accelerations"))
        t = np.array([seconds(p) for p in points])
        assert t[0] == 0.0
        assert np.diff(t).min() > 0.0
        assert (q >= np.array(robot["position_lower"]) - 1e-6).all()
        assert (q <= np.array(robot["position_upper"]) + 1e-6).all()
        assert (np.abs(v) <= np.array(robot["velocity"]) + 1e-6).all()
        assert (np.abs(a) <= np.array(robot["acceleration"]) + 1e-5).all()
        steps = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
        assert (steps <= np.array(robot["velocity"]) + 1e-4).all()
        # Continuous: velocities integrate to positions.
        mean = (v[1:] + v[:-1]) / 2.0 - np.diff(t)[:, None] * np.diff(a, axis=0) / 12.0
        np.testing.assert_allclose(np.diff(q, axis=0), mean * np.diff(t)[:, None], atol=5e-5)


def test_it_rests_between_legs_and_while_the_vacuum_changes(found: Trajectories) -> None:
    for step in found.steps:
        motion = step.motion
        assert motion is not None
        for leg in step.legs:
            for moment in (leg.start, leg.end):
                k = int(np.argmin(np.abs(motion.times - moment)))
                assert abs(motion.times[k] - moment) < 1e-9
                assert np.abs(motion.velocities[k]).max() < 1e-9
        by_name = {leg.name: leg for leg in step.legs}
        assert step.vacuum_on == by_name["approach"].end
        assert by_name["lift"].start == pytest.approx(step.vacuum_on + DWELL)
        assert step.vacuum_off == by_name["lower"].end
        assert by_name["retreat"].start == pytest.approx(step.vacuum_off + DWELL)
        assert by_name["retreat"].end == motion.duration


def test_a_step_starts_where_the_one_before_ended(document: dict[str, Any]) -> None:
    steps = [step["trajectory"]["points"] for step in document["steps"]]
    for before, after in pairwise(steps):
        assert before[-1]["positions"] == after[0]["positions"]


def test_the_tool_is_at_the_planned_place_at_the_release(found: Trajectories, plan: rp.Plan) -> None:
    cell = found.cell
    for step, placement in zip(found.steps, plan.placements, strict=True):
        assert placement.path is not None
        q, poses = held_poses(step, cell)
        tool = cell.robot.tool(q[-1])
        np.testing.assert_allclose(tool, cell.robot.tool(placement.path.joints[-2]), atol=1e-9)
        assert same_posture(q[-1], placement.path.joints[-2])
        lip = cell.to_container(tool[:3, 3]) - placement.path.grasp
        np.testing.assert_allclose(lip, [0.0, 0.0, cell.setup.release_height], atol=1e-6)
        np.testing.assert_allclose(poses[-1], step.release.matrix, atol=1e-8)
        np.testing.assert_allclose(step.place.rotation, cell.turn @ placement.rotation, atol=1e-12)
        np.testing.assert_allclose(step.place.position, cell.to_base(placement.position), atol=1e-12)


def test_the_item_waits_at_the_pick_place(found: Trajectories) -> None:
    """By its mesh: the middle of the underside of its bounding box, and the planned orientation."""
    want = found.cell.setup.pick_place
    for step in found.steps:
        points = step.pick.apply(found.items[step.item].vertices)
        low, high = points.min(axis=0), points.max(axis=0)
        middle = [*((low + high) / 2.0)[:2], low[2]]
        np.testing.assert_allclose(middle, want.position, atol=1e-4)
        np.testing.assert_allclose(step.pick.rotation, step.place.rotation, atol=1e-9)


def test_a_held_item_is_never_tilted(found: Trajectories) -> None:
    for step in found.steps:
        _, poses = held_poses(step, found.cell)
        up = np.linalg.inv(poses[0, :3, :3])[:, 2]
        np.testing.assert_allclose(poses[:, :3, :3] @ up, [[0.0, 0.0, 1.0]] * len(poses), atol=1e-4)


def test_straight_lines_between_points_stay_within_a_millimetre(found: Trajectories) -> None:
    """Of the quintic through positions, velocities and accelerations, in the middle of two points."""
    robot = found.cell.robot
    for step in found.steps:
        m = step.motion
        assert m is not None
        q, v, a, h = m.positions, m.velocities, m.accelerations, np.diff(m.times)[:, None]
        line = (q[1:] + q[:-1]) / 2.0
        quintic = line + 5.0 / 32.0 * h * (v[:-1] - v[1:]) + h**2 / 64.0 * (a[:-1] + a[1:])
        apart = np.linalg.norm(robot.tool(line)[:, :3, 3] - robot.tool(quintic)[:, :3, 3], axis=1)
        assert apart.max() < 1e-3
        lower = next(leg for leg in step.legs if leg.name == "lower")
        inside = (m.times[:-1] >= lower.start) & (m.times[1:] <= lower.end)
        lips = robot.tool(line[inside])[:, :2, 3]
        assert np.abs(lips - robot.tool(q[m.times == lower.end])[:, :2, 3]).max() < 1e-3


def test_every_written_point_is_clear(found: Trajectories, plan: rp.Plan) -> None:
    check = MotionCheck(found.cell)
    for step, placement in zip(found.steps, plan.placements, strict=True):
        assert placement.path is not None
        m, task = step.motion, _task(found.cell, placement, placement.path)
        assert m is not None
        before = m.positions[m.times <= step.vacuum_on]
        held = m.positions[(m.times >= step.vacuum_on) & (m.times <= step.vacuum_off)]
        after = m.positions[m.times >= step.vacuum_off]
        assert check.problem(before, waiting=task) is None
        assert check.problem(held, held=task) is None
        assert check.problem(after, released=task) is None


# ------------------------------------------------------------------- an independent look at the surroundings


def test_exact_meshes_never_meet(found: Trajectories) -> None:
    assert first_meeting(found) is None
    assert first_meeting(found, inwards=0.02) == "book or cup meets 0", "a wall that moved is noticed"


def test_exact_meshes_of_real_items_never_meet() -> None:
    plan = rp.plan(rp.Order.of("bowl", "nesting_cup_5", "banana", "mug"), rp.Container(0.2, 0.2, 0.2))
    assert len(plan.placements) >= 3
    found = trajectories(plan)
    assert found.ok
    assert first_meeting(found) is None


def first_meeting(found: Trajectories, inwards: float = 0.0) -> str | None:
    """Held items and cup against walls and placed items, by python-fcl on the meshes, a tenth of a millimetre in.

    Args:
        found: the motions.
        inwards: by how much the walls are moved inwards.
    """
    cell = found.cell
    obstacles = _walls(cell, found.wall, inwards)
    gripper = cell.robot.gripper
    tube = fcl.Cylinder(gripper.radius - 1e-4, gripper.length - 2e-4)
    for step in found.steps:
        item = found.items[step.item]
        model = _model(item.vertices - 1e-4 * np.sign(item.vertices - item.vertices.mean(axis=0)), item.faces)
        q, poses = held_poses(step, cell)
        for tool, pose in zip(cell.robot.tool(q), poses, strict=True):
            middle = tool[:3, 3] - tool[:3, 2] * gripper.length / 2.0
            moved = fcl.CollisionObject(model, fcl.Transform(pose[:3, :3], pose[:3, 3]))
            cup = fcl.CollisionObject(tube, fcl.Transform(tool[:3, :3], middle))
            for number, other in enumerate(obstacles):
                for mine in (moved, cup):
                    if fcl.collide(mine, other, fcl.CollisionRequest(), fcl.CollisionResult()):
                        return f"{step.item} or cup meets {number}"
        placed = _model(item.vertices, item.faces)
        there = fcl.Transform(step.place.rotation, step.place.position)
        obstacles.append(fcl.CollisionObject(placed, there))
    return None


def _model(vertices: np.ndarray, faces: np.ndarray) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(faces), len(vertices))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model


def _walls(cell: Cell, wall: float, inwards: float) -> list[fcl.CollisionObject]:
    """Four walls and the floor as solids in the base frame."""
    size = np.array(cell.container.size)
    solids = []
    for axis in range(3):
        for side in (0, 1) if axis < 2 else (0,):
            extents = size + 2.0 * wall * np.array([1.0, 1.0, 0.0])
            centre = size / 2.0
            extents[axis], centre[axis] = (
                wall,
                (size[axis] - inwards + wall / 2.0 if side else inwards - wall / 2.0),
            )
            solids.append(
                fcl.CollisionObject(fcl.Box(*extents), fcl.Transform(cell.turn, cell.to_base(centre)))
            )
    return solids


# ------------------------------------------------------------------------------------------- the check


@pytest.fixture(scope="module")
def carried(found: Trajectories, plan: rp.Plan) -> tuple[MotionCheck, Task, np.ndarray]:
    """The check, the first task, and joints from the pick place to the release."""
    placement = plan.placements[0]
    assert placement.path is not None
    q, _ = held_poses(found.steps[0], found.cell)
    return MotionCheck(found.cell), _task(found.cell, placement, placement.path), q


def test_the_check_finds_what_is_in_the_way(carried: tuple[MotionCheck, Task, np.ndarray]) -> None:
    check, task, q = carried
    assert check.problem(q, held=task) is None
    # The same motion, an item that shall lie elsewhere: inside the container it is off its line.
    aside = task.tool_at_place.copy()
    aside[0, 3] += 0.02
    box = task.box_at_place.copy()
    box[0, 3] += 0.02
    other = replace(task, tool_at_place=aside, box_at_place=box)
    assert check.problem(q, held=other) == "the cup meets the container"
    # A taller item hangs lower.
    tall = replace(task, low=task.low - np.array([0.0, 0.0, 0.05]))
    assert check.problem(q, held=tall) == "the held item meets the ground"
    # One that reaches up to the flange.
    high = replace(task, high=task.high + np.array([0.0, 0.0, 0.4]))
    assert check.problem(q, held=high) == "the arm meets the held item"
    # A wide one is inside the walls at its place: there the planner has looked.
    wider = np.array([0.08, 0.08, 0.0])
    wide = replace(task, low=task.low - wider, high=task.high + wider)
    assert check.problem(q[-1:], held=wide) is None
    # Less above the rim than nothing.
    heights = check.robot.tool(q)[:, 2, 3]
    carry = q[heights > heights.max() - 1e-6]
    assert check.problem(carry, held=wide) is None
    deep = replace(task, low=task.low - np.array([0.0, 0.0, 0.012]))
    assert check.problem(carry, held=deep) == "the held item meets the container"
    # An item waits where the robot carries: the arm or the cup goes through it.
    standing = replace(task, box_at_pick=task.box_at_place @ _up(0.1), tool_at_pick=aside @ _up(9.0))
    assert "waiting item" in str(check.problem(q, released=task, waiting=standing))


def test_the_check_knows_limits_ground_and_arm(carried: tuple[MotionCheck, Task, np.ndarray]) -> None:
    check, task, q = carried
    robot = check.robot
    assert check.problem(np.vstack([q, robot.upper + 0.1]), held=task) == "a joint passes its limit"
    samples = np.random.default_rng(4).uniform(robot.lower, robot.upper, (4000, 6))
    found = {check.problem(sample[None]) for sample in samples}
    assert {None, "the arm meets itself", "the arm meets the ground", "the arm meets the container"} <= found


def _up(lift: float) -> np.ndarray:
    moved = np.eye(4)
    moved[2, 3] = lift
    return moved


# ------------------------------------------------------------------------------------------- cells


def test_moving_base_and_container_together_changes_no_joint(found: Trajectories, setup: CellSetup) -> None:
    at = np.array(found.cell.position)
    c, s = math.cos(math.radians(40.0)), math.sin(math.radians(40.0))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    base = np.array([1.0, -2.0, 0.5])
    moved = replace(
        setup,
        base=Place((1.0, -2.0, 0.5), 40.0),
        container=Place(
            tuple((base + turn @ at).tolist()),  # type: ignore[arg-type]
            40.0 + math.degrees(found.cell.yaw),
        ),
    )
    other = trajectories(planned(moved))
    for a, b in zip(found.steps, other.steps, strict=True):
        assert a.motion is not None
        assert b.motion is not None
        np.testing.assert_allclose(b.motion.positions, a.motion.positions, atol=1e-7)
        np.testing.assert_allclose(b.motion.times, a.motion.times, rtol=1e-7)


@pytest.mark.parametrize("angle", [-60.0, 75.0, 160.0])
def test_pick_places_all_around(setup: CellSetup, found: Trajectories, angle: float) -> None:
    distance = setup.robot.near_edge + 0.16
    x, y = distance * math.cos(math.radians(angle)), distance * math.sin(math.radians(angle))
    elsewhere = replace(setup, pick=Place((x, y, 0.05), 30.0))
    other = trajectories(planned(elsewhere))
    assert other.ok, [step.problem for step in other.steps]
    for a, b in zip(found.steps, other.steps, strict=True):
        np.testing.assert_allclose(b.release.position, a.release.position, atol=1e-9)
        turned = b.pick.rotation @ b.place.rotation.T
        assert math.degrees(math.atan2(turned[1, 0], turned[0, 0])) == pytest.approx(30.0)


def test_another_posture_is_taken_where_the_planned_one_cannot_come_from_the_pick_place() -> None:
    """Reaching backwards, joint 1 would have to go where its limit ends, on the shortened way and on the long one."""
    first = replace(TX90.joints[0], lower=math.radians(-175.0), upper=math.radians(60.0))
    robot = replace(TX90, joints=(first, *TX90.joints[1:]))
    setup = CellSetup(robot, container=Place((robot.near_edge, 0.0, 0.0)))
    plan = planned(setup)
    placements = []
    for placement in plan.placements:
        assert placement.path is not None
        ways = setup.robot.continuous_branches(setup.robot.forward(placement.path.joints)).q
        backwards = [q for q in ways if q[0, 0] < -1.6]
        if backwards:
            placement = replace(placement, path=replace(placement.path, joints=backwards[0]))
        placements.append(placement)
    found = trajectories(replace(plan, placements=tuple(placements)))
    assert found.ok
    for step, placement in zip(found.steps, placements, strict=True):
        assert placement.path is not None
        q, poses = held_poses(step, found.cell)
        backwards = placement.path.joints[0, 0] < -1.6
        assert step.posture == ("other" if backwards else "planned")
        assert same_posture(q[-1], placement.path.joints[-2]) != backwards
        np.testing.assert_allclose(poses[-1], step.release.matrix, atol=1e-8)
    assert "other" in {step.posture for step in found.steps}


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [(3.0, 0.0, "no posture"), (0.1, 0.1, "container"), (0.1, -0.055, "meets the container")],
)
def test_a_bad_pick_place_is_an_answer(setup: CellSetup, x: float, y: float, words: str) -> None:
    """Out of reach, in the container, in its wall."""
    at = setup.with_container(BOX).to_base(np.array([x, y, 0.0]))
    bad = Place(tuple(at.tolist()))  # type: ignore[arg-type]
    found = trajectories(planned(replace(setup, pick=bad)))
    assert not found.ok
    document = found.to_json()
    assert document["ok"] is False
    for step, row in zip(found.steps, document["steps"], strict=True):
        if step.motion is None:
            assert row["trajectory"] is None
            assert row["problem"] == step.problem
    assert all(words in str(step.problem) for step in found.steps), [s.problem for s in found.steps]


# ------------------------------------------------------------------------------------------- the file


def test_the_page_has_a_row_for_every_key(document: dict[str, Any]) -> None:
    rows = [
        line.split("|")[1]
        for line in (REPO / "docs" / "trajectory.md").read_text().splitlines()
        if "|" in line
    ]
    named = {word.strip("`.[] ").split(".")[-1].removesuffix("[]") for row in rows for word in row.split(",")}
    row_of = {"robot": document["robot"], "step": document["steps"][0], "top": document}
    for part, mapping in row_of.items():
        for key in mapping:
            if (part, key) in {("top", "robot"), ("top", "meshes")}:
                continue  # their rows name what is in them
            assert key in named, (part, key)


def test_the_file_stands_alone(document: dict[str, Any], found: Trajectories, plan: rp.Plan) -> None:
    robot, cell = document["robot"], found.cell
    assert document["frame_id"] == "base_link"
    assert robot["joint_names"] == list(cell.robot.joint_names)
    assert f'name="{robot["tool_link"]}"' in robot["urdf"]
    corner = pose_of(document["container"]) @ [0.1, 0.05, 0.0, 1.0]
    np.testing.assert_allclose(corner[:3], cell.to_base(np.array([0.1, 0.05, 0.0])), atol=1e-9)
    assert document["container"]["inner_size"] == list(BOX.size)
    for step in document["steps"]:
        mesh = document["meshes"][step["item"]]
        assert step["trajectory"]["joint_names"] == robot["joint_names"]
        assert step["trajectory"]["header"]["frame_id"] == document["frame_id"]
        points = (
            np.column_stack([mesh["vertices"], np.ones(len(mesh["vertices"]))]) @ pose_of(step["place"]).T
        )
        placement = plan.placements[step["step"] - 1]
        low = cell.to_container(points[:, :3]).min(axis=0)
        np.testing.assert_allclose(low, placement.corner, atol=1e-4)
        assert np.max(mesh["triangles"]) < len(mesh["vertices"])
        assert mesh["mass"] == plan.meshes[step["item"]].mass
        assert [event["on"] for event in step["vacuum"]] == [True, False]
        times = {seconds(point) for point in step["trajectory"]["points"]}
        assert all(seconds(event) in times for event in step["vacuum"])


def test_it_is_saved_with_the_plan_s_digest(plan: rp.Plan, tmp_path: Path) -> None:
    import hashlib

    rp.save_plan(plan, tmp_path / "p.json")
    read = rp.load_plan(tmp_path / "p.json", rp.load_catalogue(meshes()))
    made = rp.trajectories(read, rp.load_catalogue(meshes()))
    made.save(tmp_path / "t.json")
    document = json.loads((tmp_path / "t.json").read_text())
    digest = hashlib.sha256((tmp_path / "p.json").read_bytes()).hexdigest()
    assert document["plan"] == {"file": "p.json", "sha256": digest}
    assert document["steps"] == json.loads(json.dumps(made.to_json()["steps"]))
    assert repr(made).startswith("<Trajectories: 3 of 3 steps, ")


def test_slower_limits_take_longer_and_keep_the_way(found: Trajectories, plan: rp.Plan) -> None:
    slow = trajectories(plan, limits=MotionLimits(share=0.1, speed=0.1))
    assert slow.ok
    assert slow.duration > 2.0 * found.duration
    robot = slow.cell.robot
    for step in slow.steps:
        assert step.motion is not None
        assert (np.abs(step.motion.velocities) <= 0.1 * robot.velocity).all()


def test_items_that_lie_there_already_are_told(plan: rp.Plan) -> None:
    measured = [plan.placements[0].pose]
    rest = rp.plan_rest(plan, measured, rp.load_catalogue(meshes()))
    found = trajectories(rest, rp.load_catalogue(meshes()))
    assert [step.step for step in found.steps] == [2, 3]
    document = found.to_json()
    (lying,) = document["lying"]
    assert lying["item"] == plan.placements[0].item
    np.testing.assert_allclose(pose_of(lying)[:3, 3], found.cell.to_base(measured[0].position), atol=1e-8)


def test_a_plan_without_joints_is_refused() -> None:
    plan = rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), grid=COARSE, constraints="overlap")
    with pytest.raises(rp.InputError, match=r"step 1 .* tells no joints.*pack --constraints robot"):
        trajectories(plan)
    with pytest.raises(rp.InputError, match="places no item"):
        trajectories(replace(plan, placements=()))
    with pytest.raises(rp.InputError, match="is no plan"):
        trajectories("p.json")  # type: ignore[arg-type]
