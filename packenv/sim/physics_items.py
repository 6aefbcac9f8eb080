"""What physics needs of an item: convex parts or a ball, mass and inertia, in its principal frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from packenv.geometry.convex_parts import ConvexParts
from packenv.types import Container, FloatArray, Item, Pose

_TURNED = 1e-6
"""Rotation matrices that differ by less are one, where boxes are asked for."""


@dataclass(frozen=True, eq=False)
class PhysicsItem:
    """An item as a rigid body.

    The *body frame* has its origin in the centre of mass and its axes along the principal axes of inertia, so
    that an engine needs no frame of its own for the inertia.

    Attributes:
        name: of the item.
        mass: kg.
        moments: (3,) principal moments of inertia, kg m²: those of uniform density, also where the centre of mass is
            stated to be elsewhere. How the mass is then spread nobody said, so there is no other figure to take.
        com: (3,) centre of mass in the mesh frame, m.
        axes: (3, 3) body frame to mesh frame.
        parts: (k, 3) vertices of each convex part in the body frame, m; empty for a ball.
        radius: of a ball, m; 0 where the item is none.
        ball_centre: (3,) in the body frame, m.
        reach: largest distance of a point of the item from its centre of mass, m.
        friction: coefficient of its surface; None takes the world's.
    """

    name: str
    mass: float
    moments: FloatArray
    com: FloatArray
    axes: FloatArray
    parts: tuple[FloatArray, ...]
    radius: float
    ball_centre: FloatArray
    reach: float
    friction: float | None = None

    @classmethod
    def of_item(cls, item: Item, convex: ConvexParts) -> PhysicsItem:
        """Bring an item and its parts into the body frame."""
        moments, axes = np.linalg.eigh(item.inertia)
        if np.linalg.det(axes) < 0.0:
            axes = axes * np.array([1.0, 1.0, -1.0])
        parts = tuple((part - item.com) @ axes for part in convex.parts)
        reach = max(float(np.linalg.norm(part, axis=1).max()) for part in parts)
        ball = convex.ball
        centre = np.zeros(3) if ball is None else (ball.centre - item.com) @ axes
        return cls(
            item.name,
            item.mass,
            moments,
            item.com,
            axes,
            () if ball is not None else parts,
            0.0 if ball is None else ball.radius,
            centre,
            reach,
            item.friction,
        )

    def body_pose(self, rotation: FloatArray, position: FloatArray) -> Pose:
        """Where the body frame is when the mesh frame is at (rotation, position).

        Args:
            rotation: (3, 3) mesh frame to world.
            position: (3,) m.

        Returns:
            (3, 3) and (3,) of the body frame.
        """
        return Pose(rotation @ self.axes, self.com_at(Pose(rotation, position)))

    def com_at(self, pose: Pose) -> FloatArray:
        """(3,) centre of mass in the world at a pose of the mesh frame, m."""
        com: FloatArray = pose[0] @ self.com + pose[1]
        return com

    def mesh_pose(self, rotation: FloatArray, position: FloatArray) -> Pose:
        """Inverse of :meth:`body_pose`."""
        mesh = rotation @ self.axes.T
        return Pose(mesh, position - mesh @ self.com)

    def heavier(self, factor: float) -> PhysicsItem:
        """The same shape with ``factor`` times the mass."""
        return replace(self, mass=self.mass * factor, moments=self.moments * factor)

    def bounds(self, rotation: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(3,) and (3,) smallest and largest coordinates at a pose of the mesh frame, m."""
        turned, at = self.body_pose(rotation, position)
        if self.radius > 0.0:
            centre = turned @ self.ball_centre + at
            return centre - self.radius, centre + self.radius
        points = np.concatenate(self.parts) @ turned.T + at
        return points.min(axis=0), points.max(axis=0)

    def boxes(self, poses: FloatArray) -> FloatArray:
        """(n, 2, 3) smallest and largest coordinates at (n, 4, 4) poses of the mesh frame, m."""
        turns = poses[:, :3, :3]
        com = turns @ self.com + poses[:, :3, 3]
        if self.radius > 0.0:
            centre = com + turns @ (self.axes @ self.ball_centre)
            return np.stack([centre - self.radius, centre + self.radius], axis=1)
        # A straight way down keeps the orientation, up to rounding.
        if len(poses) and np.abs(turns - turns[0]).max() < _TURNED:
            points = np.concatenate(self.parts) @ (turns[0] @ self.axes).T
            low, high = com + points.min(axis=0), com + points.max(axis=0)
            return np.stack([low, high], axis=1) + _TURNED * self.reach * np.array([[[-3.0], [3.0]]])
        bounds = [self.bounds(pose[:3, :3], pose[:3, 3]) for pose in poses]
        return np.array(bounds).reshape(-1, 2, 3)

    def beyond(self, container: Container, rotation: FloatArray, position: FloatArray) -> float:
        """How far the item sticks out of a container at a pose of the mesh frame, m; negative inside."""
        low, high = self.bounds(rotation, position)
        return max(float((-low).max()), float((high - np.array(container.size)).max()))
