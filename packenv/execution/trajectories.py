"""From a plan to the robot's motions, from the pick place to every planned place.

A step is six legs, each from rest to rest: *travel* from where the step before ended; *approach* straight down to
the waiting item; *lift*; *carry* about joint 1's axis at a safe height; *lower* along the planned path to the
release; *retreat* straight up. From the approach to the retreat the arm keeps one posture (one branch of the inverse
kinematics), so a held item is never tilted: the planned one, or where that cannot come from the pick place another,
which is checked just as the planner does. The empty arm may change its posture on the travel.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from packenv.errors import PlanError
from packenv.execution.motion_check import WALL, MotionCheck, Task
from packenv.geometry.transforms import yaw_rotation
from packenv.io.trajectories import Leg, StepMotion, Trajectories
from packenv.items.plan_items import Items, options_of, require_plan, shelf_of
from packenv.robot.cell import Cell
from packenv.robot.timing import Motion, MotionLimits, timed
from packenv.robot.transfer import arcs, branches, joined, same_posture, straight, turned_to, vertical
from packenv.types import FloatArray, Placement, Plan, Pose, RobotPath
from packenv.watcher import SILENT, Watcher

DWELL: Final = 0.2
"""For how long the robot stands still while the vacuum comes or goes, s."""
_LIFTS: Final = (0.1, 0.2, 0.3)
"""How far the empty cup is lifted further for a change of posture, m."""
_EMPTY: Final = ("travel", "approach", "retreat")
"""Legs on which the cup holds nothing."""
_DEFAULT: Final = MotionLimits()


def trajectories(
    plan: Plan,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    limits: MotionLimits = _DEFAULT,
    watcher: Watcher = SILENT,
) -> Trajectories:
    """Find a motion of the robot for every step of a plan.

    Args:
        plan: the plan, made with constraints ``robot``.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.
        limits: how fast the robot may move.
        watcher: is told of progress.

    Returns:
        The motions; a step for which none was found tells its ``problem``.

    Raises:
        InputError: the plan places no item or tells no joints, or a mesh is not the plan's.
    """
    require_plan(plan)
    todo = list(enumerate(plan.placements, start=1))[plan.lying :]
    if not todo:
        raise PlanError(f"{plan.label}: places no item, so there is no motion")
    for step, placement in todo:
        if placement.path is None:
            raise PlanError(
                f"{plan.label}: step {step} ({placement.item}) tells no joints, plan with constraints robot: "
                "pack --constraints robot"
            )
    cell = options_of(plan).setup.with_container(plan.container)
    shelf = shelf_of(plan, catalogue, unit=unit)
    planner = _MotionPlanner(cell, limits)
    steps: list[StepMotion] = []
    joints: FloatArray | None = None
    for step, placement in watcher.progress(todo, "moving"):
        steps.append(planner.step(step, placement, joints))
        motion = steps[-1].motion
        joints = joints if motion is None else motion.positions[-1]
    return Trajectories(
        cell=cell,
        limits=limits,
        steps=tuple(steps),
        items={name: shelf.items[name] for name in dict.fromkeys(p.item for p in plan.placements)},
        lying=tuple((p.item, _in_base(cell, p.pose)) for p in plan.placements[: plan.lying]),
        wall=WALL,
        plan=None if plan.source is None else plan.source.name,
        plan_sha256=_digest(plan.source),
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """One leg before and after it is given times."""

    name: str
    joints: FloatArray
    motion: Motion


class _MotionPlanner:
    """Finds the motion of one step after another."""

    def __init__(self, cell: Cell, limits: MotionLimits) -> None:
        self.cell, self.limits, self.check = cell, limits, MotionCheck(cell)

    def step(self, number: int, placement: Placement, start: FloatArray | None) -> StepMotion:
        """One step; ``start`` is (6,) where the robot is, None where it may begin above the pick place."""
        path = placement.path
        assert path is not None
        task = _task(self.cell, placement, path)
        place = _in_base(self.cell, placement.pose)
        to_pick = task.box_at_pick @ np.linalg.inv(task.box_at_place) @ place.matrix
        found = StepMotion(
            step=number,
            item=placement.item,
            instance=placement.instance,
            pick=Pose(to_pick[:3, :3], to_pick[:3, 3]),
            place=place,
            release=place.moved(np.array([0.0, 0.0, _drop(path)])),
            motion=None,
        )
        handling = self._handling(task, path)
        if isinstance(handling, str):
            return replace(found, problem=handling)
        parts, planned = handling
        found = replace(found, posture="planned" if planned else "other")
        if start is not None:
            travel = self._travel(start, parts[0].joints[0], task)
            if travel is None:
                return replace(
                    found, problem="travel: no clear way of the empty cup to the pick place was found"
                )
            parts = [*travel, *parts]
        return _joined_parts(found, parts)

    def _handling(self, task: Task, path: RobotPath) -> tuple[list[_Part], bool] | str:
        """From above the pick place to above the container again, or why there is no clear way.

        Returns:
            the quickest way in the planned posture, else the quickest in another; and whether it is the planned.
        """
        cell = self.cell
        pick_z, place_z = (float(box[2, 3] + task.low[2]) for box in (task.box_at_pick, task.box_at_place))
        height = float(task.high[2] - task.low[2])
        safe = max(cell.rim, pick_z + height) + cell.setup.rim_clearance
        up = vertical(task.tool_at_pick, safe - pick_z)
        down = vertical(_raised(task.tool_at_place, _drop(path)), safe - place_z - _drop(path))[::-1]
        problems: dict[bool, str] = {}
        best: list[_Part] | None = None
        planned_found = False
        for arc in arcs(up[-1], down[0]):
            for q in branches(cell.robot, np.concatenate([up, arc, down])):
                planned = same_posture(q[-1], path.joints[-2])
                if planned_found and not planned:
                    continue
                lift, carry, lower = np.split(q, np.cumsum([len(up), len(arc)]))
                met = self._met(lift, carry, lower, task)
                if met is not None:
                    problems.setdefault(planned, met)
                    continue
                parts = [
                    self._part("approach", lift[::-1]),
                    self._part("lift", lift),
                    self._part("carry", carry),
                    self._part("lower", lower),
                    self._part("retreat", lower[::-1]),
                ]
                if best is None or planned > planned_found or _duration(parts) < _duration(best):
                    best, planned_found = parts, planned
        if best is not None:
            return best, planned_found
        unreached = "carry: no posture of the arm reaches from the pick place to above the container"
        return problems.get(True) or problems.get(False) or unreached

    def _met(self, lift: FloatArray, carry: FloatArray, lower: FloatArray, task: Task) -> str | None:
        """What is wrong with a way, and where."""
        asked = {
            "approach": self.check.problem(lift, waiting=task),
            "lift": self.check.problem(lift, held=task),
            "carry": self.check.problem(carry, held=task),
            "lower": self.check.problem(lower, held=task),
            "retreat": self.check.problem(lower, released=task),
        }
        return next((f"{name}: {problem}" for name, problem in asked.items() if problem is not None), None)

    def _travel(self, start: FloatArray, end: FloatArray, task: Task) -> list[_Part] | None:
        """The quickest clear way of the empty cup; None where there is none."""
        best: list[_Part] | None = None
        for way in self._ways(start, end):
            if any(self.check.problem(q, waiting=task) is not None for q in way):
                continue
            parts = [self._part("travel", q) for q in way]
            if best is None or _duration(parts) < _duration(best):
                best = parts
        return best

    def _ways(self, start: FloatArray, end: FloatArray) -> Iterator[list[FloatArray]]:
        """Ways that may or may not be clear, as paths of joints from rest to rest."""
        robot = self.cell.robot
        for q in joined(robot, start, end):
            yield [q]
        yield [straight(start, end)]
        for lift in _LIFTS:
            ups = [self._up(q, lift) for q in (start, end)]
            if ups[0] is not None and ups[1] is not None:
                yield [ups[0], straight(ups[0][-1], ups[1][-1]), ups[1][::-1]]

    def _up(self, start: FloatArray, lift: float) -> FloatArray | None:
        """(m, 6) straight up from joints, in the same posture; None where that is out of reach."""
        robot = self.cell.robot
        for q in branches(robot, vertical(robot.tool(start), lift)):
            if same_posture(q[0], start):
                return turned_to(q, start)
        return None

    def _part(self, name: str, joints: FloatArray) -> _Part:
        robot = self.cell.robot
        tips = robot.tool(joints)[:, :3, 3]
        return _Part(name, joints, timed(joints, tips, robot.velocity, self.limits, empty=name in _EMPTY))


def _task(cell: Cell, placement: Placement, path: RobotPath) -> Task:
    """Where item, box and tool are at both ends."""
    pick = cell.setup.pick_place
    low, high = placement.corner, placement.corner + placement.extents
    underside = np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    at_place, at_pick = np.eye(4), np.eye(4)
    at_place[:3, :3], at_place[:3, 3] = cell.turn, cell.position
    at_pick[:3, :3] = yaw_rotation(pick.yaw) @ cell.turn
    at_pick[:3, 3] = np.array(pick.position) - at_pick[:3, :3] @ underside
    tool = cell.robot.tool(path.joints[-1])
    return Task(low, high, at_pick, at_place, at_pick @ np.linalg.inv(at_place) @ tool, tool)


def _drop(path: RobotPath) -> float:
    """How far above its place an item is let go, m."""
    return float(path.cup_heights[-2] - path.cup_heights[-1])


def _raised(pose: FloatArray, lift: float) -> FloatArray:
    moved = pose.copy()
    moved[2, 3] += lift
    return moved


def _in_base(cell: Cell, pose: Pose) -> Pose:
    """A pose of the container frame in the base frame."""
    return Pose(cell.turn @ pose.rotation, cell.to_base(pose.position))


def _duration(parts: Sequence[_Part]) -> float:
    return sum(part.motion.duration for part in parts)


def _joined_parts(step: StepMotion, parts: Sequence[_Part]) -> StepMotion:
    """The parts one after another, with a stand where the vacuum comes or goes."""
    legs, motions, clock, events = [], [], 0.0, {}
    for part in parts:
        if part.name in ("lift", "retreat"):
            events[part.name] = clock
            clock += DWELL
        legs.append(Leg(part.name, clock, clock + part.motion.duration))
        # The first point of a leg is the last of the one before, unless the robot stood still.
        skip = 1 if legs[1:] and part.name not in events else 0
        m = part.motion
        motions.append(
            (clock + m.times[skip:], m.positions[skip:], m.velocities[skip:], m.accelerations[skip:])
        )
        clock += m.duration
    whole = Motion(*(np.concatenate(columns) for columns in zip(*motions, strict=True)))
    return replace(
        step, motion=whole, legs=tuple(legs), vacuum_on=events["lift"], vacuum_off=events["retreat"]
    )


def _digest(source: Path | None) -> str | None:
    return None if source is None else hashlib.sha256(source.read_bytes()).hexdigest()
