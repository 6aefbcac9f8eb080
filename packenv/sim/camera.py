"""What a camera over the cell would see, kept as poses: who draws them, and how, is another's business.

Poses are only read, never set, so a recorded run is bit for bit the run without a recorder.
"""

from __future__ import annotations

import numpy as np

from packenv.sim.world import World
from packenv.types import Frame

_STILL_JOINT = 1e-3
_STILL_ITEM = 2e-4


class Recorder:
    """Keeps a frame every so often while something moves. Call it with the world after every step."""

    def __init__(self, rate: float = 12.0, most: int = 300) -> None:
        """Begin with no frames.

        Args:
            rate: frames a second of motion; moments in which nothing moves are left out.
            most: frames to keep, at least 2; a longer run keeps fewer a second.
        """
        self._period = 1.0 / rate
        self._most = most
        self._kept: list[Frame] = []
        self._next = 0.0

    def __call__(self, world: World) -> None:
        """Look at the world; keep a frame where it is time for one."""
        if world.time < self._next:
            return
        self._next = world.time + self._period * (1.0 - 1e-9)
        frame = _seen(world)
        if self._kept and not _moved(self._kept[-1], frame):
            return
        self._kept.append(frame)
        # Twice as many are kept as asked for, so that thinning at the end has something to choose from.
        if len(self._kept) >= 2 * self._most:
            self._kept = self._kept[::2]
            self._period *= 2.0

    def frames(self) -> tuple[Frame, ...]:
        """At most so many frames as asked for, evenly over all that were kept, first and last among them."""
        if len(self._kept) <= self._most:
            return tuple(self._kept)
        chosen = np.rint(np.linspace(0, len(self._kept) - 1, self._most)).astype(int)
        return tuple(self._kept[k] for k in chosen)


def _seen(world: World) -> Frame:
    joints = None if world.joints is None else world.joints.copy()
    return Frame(world.time, joints, tuple(world.pose(body) for body in world.items))


def _moved(before: Frame, after: Frame) -> bool:
    """Whether a viewer could tell two frames apart."""
    if len(before.poses) != len(after.poses):
        return True
    joints = [f.joints for f in (before, after) if f.joints is not None]
    if len(joints) == 2 and float(np.abs(joints[1] - joints[0]).max()) > _STILL_JOINT:
        return True
    return any(
        float(np.abs(q - p).max()) > _STILL_ITEM or float(np.abs(R - S).max()) > 10 * _STILL_ITEM
        for (S, p), (R, q) in zip(before.poses, after.poses, strict=True)
    )
