"""What leaves for a robot: a motion for every step of a plan, as a JSON file (docs/trajectory.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from packenv.geometry.transforms import rotation_to_quaternion
from packenv.io.files import write_whole
from packenv.robot.cell import Cell
from packenv.robot.timing import Motion, MotionLimits
from packenv.types import FloatArray, Item, Pose
from packenv.version import __version__

SCHEMA_VERSION = 1
_UNITS = {"length": "m", "mass": "kg", "time": "s", "angle": "rad"}


@dataclass(frozen=True)
class Leg:
    """A part of a step's motion, from rest to rest.

    Attributes:
        name: ``travel``, ``approach``, ``lift``, ``carry``, ``lower`` or ``retreat``.
        start: s after the step's start.
        end: likewise.
    """

    name: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class StepMotion:
    """How the robot brings one item to its place.

    Attributes:
        step: number of the step in the plan, from 1.
        item: name of the item.
        instance: as in :class:`packenv.types.Placement`.
        pick: pose of the item's mesh frame where it waits, base frame.
        place: likewise where it shall lie.
        release: likewise where the cup lets go.
        motion: joints over time; None where there is a problem.
        legs: parts of the motion, in their sequence.
        vacuum_on: s after the step's start.
        vacuum_off: likewise.
        posture: ``planned``, or ``other`` where the arm cannot come from the pick place in the posture that the
            plan's joints tell.
        problem: why there is no motion; None where there is one.
    """

    step: int
    item: str
    instance: int
    pick: Pose
    place: Pose
    release: Pose
    motion: Motion | None
    legs: tuple[Leg, ...] = ()
    vacuum_on: float = 0.0
    vacuum_off: float = 0.0
    posture: str = "planned"
    problem: str | None = None


@dataclass(frozen=True, eq=False)
class Trajectories:
    """A plan as motions of the robot.

    Attributes:
        cell: the robot, and where the container stands.
        limits: how fast it may move.
        steps: one for every placement that is the robot's to make.
        items: by name, those of the steps and those that lie in the container already.
        lying: name and pose, in the base frame, of what lies in the container at the beginning.
        wall: thickness of the container's walls and floor that was kept clear of, m.
        plan: name of the plan's file; None for a plan that is in no file.
        plan_sha256: hex digest of that file.
    """

    cell: Cell
    limits: MotionLimits
    steps: tuple[StepMotion, ...]
    items: Mapping[str, Item]
    lying: tuple[tuple[str, Pose], ...]
    wall: float
    plan: str | None = None
    plan_sha256: str | None = None

    @property
    def ok(self) -> bool:
        """Every step has a motion."""
        return all(step.problem is None for step in self.steps)

    @property
    def duration(self) -> float:
        """Of all steps that have a motion, s."""
        return sum(step.motion.duration for step in self.steps if step.motion is not None)

    def __repr__(self) -> str:
        """A line for people."""
        moved = sum(step.motion is not None for step in self.steps)
        return f"<Trajectories: {moved} of {len(self.steps)} steps, {self.duration:.1f} s>"

    def save(self, path: str | Path) -> None:
        """Write them as JSON.

        Raises:
            InputError: the file cannot be written.
        """
        document = json.dumps(self.to_json(), allow_nan=False, separators=(",", ":"))
        write_whole(Path(path), (document + "\n").encode())

    def to_json(self) -> dict[str, Any]:
        """The document of docs/trajectory.md."""
        cell, robot = self.cell, self.cell.robot
        urdf = robot.urdf()
        frame = _first_link(urdf)
        container = Pose(cell.turn, np.array(cell.position))
        return {
            "schema_version": SCHEMA_VERSION,
            "generator": f"robotpack {__version__}",
            "units": dict(_UNITS),
            "plan": {"file": self.plan, "sha256": self.plan_sha256},
            "frame_id": frame,
            "robot": {
                "name": robot.name,
                "joint_names": list(robot.joint_names),
                "position_lower": robot.lower.tolist(),
                "position_upper": robot.upper.tolist(),
                "velocity": self.limits.joint_speeds(robot.velocity).tolist(),
                "acceleration": self.limits.joint_accelerations(robot.velocity).tolist(),
                "tool_link": "tool",
                "urdf": urdf,
            },
            "limits": asdict(self.limits),
            "container": {
                **_pose(container),
                "inner_size": list(cell.container.size),
                "wall": self.wall,
            },
            "meshes": {
                name: {
                    "sha256": item.sha256,
                    "mass": item.mass,
                    "vertices": _rounded(item.vertices, 6),
                    "triangles": item.faces.tolist(),
                }
                for name, item in self.items.items()
            },
            "lying": [{"item": name, **_pose(pose)} for name, pose in self.lying],
            "ok": self.ok,
            "steps": [_step(step, robot.joint_names, frame) for step in self.steps],
        }


def _step(step: StepMotion, joint_names: tuple[str, ...], frame: str) -> dict[str, Any]:
    motion = step.motion
    found: dict[str, Any] = {
        "step": step.step,
        "item": step.item,
        "instance": step.instance,
        "problem": step.problem,
        "posture": step.posture,
        "pick": _pose(step.pick),
        "place": _pose(step.place),
        "release": _pose(step.release),
    }
    if motion is None:
        return {**found, "duration": None, "legs": [], "vacuum": [], "trajectory": None}
    points = zip(motion.times, motion.positions, motion.velocities, motion.accelerations, strict=True)
    return {
        **found,
        "duration": round(motion.duration, 9),
        "legs": [
            {"name": leg.name, "start": round(leg.start, 9), "end": round(leg.end, 9)} for leg in step.legs
        ],
        "vacuum": [
            {"time_from_start": _time(step.vacuum_on), "on": True},
            {"time_from_start": _time(step.vacuum_off), "on": False},
        ],
        "trajectory": {
            "header": {"frame_id": frame},
            "joint_names": list(joint_names),
            "points": [
                {
                    "positions": _rounded(q, 7),
                    "velocities": _rounded(v, 6),
                    "accelerations": _rounded(a, 5),
                    "time_from_start": _time(float(t)),
                }
                for t, q, v, a in points
            ],
        },
    }


def _pose(pose: Pose) -> dict[str, list[float]]:
    quaternion = rotation_to_quaternion(pose.rotation)
    return {"position": _rounded(pose.position, 9), "quat_xyzw": _rounded(quaternion, 12)}


def _time(seconds: float) -> dict[str, int]:
    whole, nanoseconds = divmod(round(seconds * 1e9), 10**9)
    return {"sec": whole, "nanosec": nanoseconds}


def _rounded(values: FloatArray, digits: int) -> list[Any]:
    rounded: list[Any] = (np.round(values, digits) + 0.0).tolist()
    return rounded


def _first_link(urdf: str) -> str:
    """The link that no joint moves: the base frame's."""
    robot = ElementTree.fromstring(urdf)
    moved = {child.get("link") for child in robot.iterfind("joint/child")}
    return next(str(link.get("name")) for link in robot.iterfind("link") if link.get("name") not in moved)
