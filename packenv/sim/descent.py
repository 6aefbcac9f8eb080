"""The way down: where joints and held item are at every time step, and how to get out of the way."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from packenv.robot.cell import Cell
from packenv.robot.motion import follow, refine
from packenv.sim.engine import Touch
from packenv.sim.physics_items import PhysicsItem
from packenv.types import FloatArray, Pose

_RADII = (0.002, 0.004, 0.006)
"""How far to search beside a contact, m."""
_TURNS = tuple(k * math.pi / 4.0 for k in (0, 1, -1, 2, -2, 3, -3, 4))
"""In which directions, from the likeliest."""
_BEYOND = 0.0015
"""How much farther than out of a contact it goes, m."""
_STEEP = 0.3
"""A normal with less of it horizontal (sine) does not say which way is out."""


@dataclass(frozen=True, eq=False)
class PlacementTask:
    """What the robot shall do with one item.

    Attributes:
        item: the item.
        rotation: (3, 3) mesh frame to container frame, as planned.
        position: (3,) as planned, m.
        joints: (m, 6) waypoints from above the rim to the release, and the place itself, rad; None where an
            ideal hand, of no size, holds the item: for plans that never asked the robot.
        heights: (m,) of the same waypoints, m, from any level.
        slip: (4, 4) by which the item is off in the cup, container axes about its planned centre of mass;
            None where it is held as planned.
    """

    item: PhysicsItem
    rotation: FloatArray
    position: FloatArray
    joints: FloatArray | None
    heights: FloatArray
    slip: FloatArray | None = None


@dataclass(frozen=True)
class Profile:
    """How fast the robot moves, and how far down.

    Attributes:
        speed: largest speed of the cup, m/s.
        acceleration: of the cup, m/s².
        share: of the joints' published speeds that is used.
        gentle: lower the item beyond the release until something below holds it, at most to its place; else
            it drops from the release (the paper).
        gentle_speed: of the cup on this last bit, m/s.
    """

    speed: float = 0.5
    acceleration: float = 2.5
    share: float = 0.5
    gentle: bool = False
    gentle_speed: float = 0.05


@dataclass(frozen=True, eq=False)
class Way:
    """Joints and held item at every time step of the way down.

    Attributes:
        joints: (n, 6) rad; None where an ideal hand holds the item.
        poses: (n, 4, 4) of the held item's mesh frame in the container frame.
        release: index at which the cup lets go of an item that drops; what follows is the last bit to the
            place itself, for gentle lowering.
    """

    joints: FloatArray | None
    poses: FloatArray
    release: int

    @classmethod
    def of_task(cls, task: PlacementTask, cell: Cell, profile: Profile, step: float) -> Way:
        """The way of a task, sampled at time steps of ``step`` seconds."""
        mesh = np.eye(4)
        mesh[:3, :3], mesh[:3, 3] = task.rotation, task.position
        if task.slip is not None:
            mesh = task.slip @ mesh
        parts: list[tuple[slice, float]] = [(slice(0, -1), profile.speed)]
        if profile.gentle:
            parts.append((slice(-2, None), profile.gentle_speed))
        if task.joints is None:
            heights = [_sampled_fall(task.heights[part], profile, v, step) for part, v in parts]
            lifts = np.concatenate([heights[0], *(h[1:] for h in heights[1:])])
            poses = np.repeat(mesh[None], len(lifts), axis=0)
            poses[:, 2, 3] += lifts - task.heights[-1]
            return cls(None, poses, len(heights[0]) - 1)
        joints = [_sampled(cell, task.joints[part], profile, v, step) for part, v in parts]
        path = np.concatenate([joints[0], *(q[1:] for q in joints[1:])])
        hold = np.linalg.inv(_tools(cell, task.joints[-1:])[0]) @ mesh
        return cls(path, _tools(cell, path) @ hold, len(joints[0]) - 1)

    def __len__(self) -> int:
        """Number of time steps, and one."""
        return len(self.poses)

    def held(self, k: int) -> Pose:
        """(3, 3) and (3,) pose of the held item's mesh frame in the container frame."""
        return Pose(self.poses[k, :3, :3], self.poses[k, :3, 3])

    def above(self, k: int, lift: float) -> int:
        """The last index at which the item is at least ``lift`` m higher than at ``k``; 0 where none is."""
        high = np.flatnonzero(self.poses[: k + 1, 2, 3] >= self.poses[k, 2, 3] + lift)
        return int(high[-1]) if len(high) else 0

    def deeper(self, k: int, other: int) -> float:
        """How much lower the item is at index ``k`` than at another, m."""
        return float(self.poses[other, 2, 3] - self.poses[k, 2, 3])

    def moved(self, aside: FloatArray, cell: Cell) -> Way | None:
        """The same way beside this one; None where the robot's arm cannot follow it.

        Args:
            aside: (2,) x and y in the container frame, m.
            cell: where the container is beside the robot.
        """
        poses = self.poses.copy()
        poses[:, :2, 3] += aside
        if self.joints is None:
            return replace(self, poses=poses)
        flanges = cell.robot.forward(self.joints)
        flanges[:, :2, 3] += cell.turn[:2, :2] @ aside if cell.yaw else aside
        branches = cell.robot.continuous_branches(flanges).q
        if not len(branches):
            return None
        nearest = int(np.argmin(np.abs(branches - self.joints).max(axis=(1, 2))))
        return replace(self, poses=poses, joints=branches[nearest])


def ways_out(touch: Touch, com: FloatArray) -> Iterator[FloatArray]:
    """Where to go to get out of a contact: (2,) x and y, m; the likeliest first.

    What a force and torque sensor tells, the contact's normal and place, is tried first; then a search around
    it, ever wider, as for a peg at a hole.

    Args:
        touch: the contact.
        com: (3,) centre of mass of the held item, m: where the normal is steep, out is towards it.
    """
    out, length = touch.normal[:2], touch.depth + _BEYOND
    if np.hypot(*out) < _STEEP:
        out = com[:2] - touch.point[:2]
    angle = math.atan2(out[1], out[0])
    if np.hypot(*touch.normal[:2]) >= _STEEP:
        yield length * np.array([math.cos(angle), math.sin(angle)])
    for radius in _RADII:
        for turn in _TURNS:
            yield radius * np.array([math.cos(angle + turn), math.sin(angle + turn)])


def _tools(cell: Cell, joints: FloatArray) -> FloatArray:
    """(n, 4, 4) tool frames in the container frame."""
    return cell.poses_to_container(cell.robot.tool(joints))


def _sampled(cell: Cell, joints: FloatArray, profile: Profile, speed: float, step: float) -> FloatArray:
    """(n, 6) joints at the world's time steps, both ends included."""
    fine = refine(cell.robot, joints)
    tips = cell.robot.tool(fine)[:, :3, 3]
    way = follow(
        fine,
        tips,
        cell.robot.velocity,
        speed=speed,
        acceleration=profile.acceleration,
        share=profile.share,
    )
    return way.sampled(step)


def _sampled_fall(heights: FloatArray, profile: Profile, speed: float, step: float) -> FloatArray:
    """(n,) heights of an ideal hand at the world's time steps: the same profile without joints."""
    tips = np.column_stack([np.zeros((len(heights), 2)), heights])
    way = follow(
        np.zeros((len(heights), 6)), tips, np.ones(6), speed=speed, acceleration=profile.acceleration
    )
    travelled = abs(float(heights[0] - heights[-1])) * np.linspace(0.0, 1.0, len(way.times))
    times = np.minimum(np.arange(int(np.ceil(way.duration / step - 1e-9)) + 1) * step, way.duration)
    down: FloatArray = float(heights[0]) - np.interp(times, way.times, travelled)
    return down
