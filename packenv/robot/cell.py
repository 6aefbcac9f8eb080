"""The robot cell: which robot, where it stands, and where the container stands beside it.

By default robot and container stand on one table: the base frame's z = 0 is the container's inner floor. The
container's axes are then parallel to those of the base, its near wall the robot's ``near_edge`` in front of
joint 1's axis, its middle on the base's x axis. docs/cell.md shows the reachability map behind it. All stands
upright: robot and container may be turned about the vertical, never tilted.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, radians, sin
from typing import Any, Final

import numpy as np

from packenv.errors import InputError
from packenv.robot.gripper import top_down
from packenv.robot.protocol import MAX_STEP, PathBranches, Robot
from packenv.types import BoolArray, Container, FloatArray

RIM_CLEARANCE: Final = 0.01
"""What links, gripper and held item keep above the rim before they go over the container, m."""
RELEASE_HEIGHT: Final = 0.01
"""How far above its place an item is let go, m (paper Sec. V)."""
FRICTION: Final = 0.7
"""Coefficient of friction of surfaces that have none of their own (paper Sec. V)."""
WAYPOINT_STEP: Final = 0.02
"""Default distance of waypoints on a straight path, m."""
_PICK_BEYOND: Final = 0.16
"""How much farther than the near edge items wait by default: the middle of the paper's container, m."""


@dataclass(frozen=True)
class Place:
    """Where an upright thing stands.

    Attributes:
        position: (x, y, z), m.
        yaw_deg: turn about the vertical, degrees, so that a file's number stays what it is.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @property
    def yaw(self) -> float:
        """The turn, rad."""
        return radians(self.yaw_deg)

    def to_mapping(self) -> dict[str, Any]:
        """The place as JSON has it."""
        return {"position_m": list(self.position), "yaw_deg": self.yaw_deg}


@dataclass(frozen=True)
class CellSetup:
    """What a cell file says: everything about the cell but for the container's size.

    Attributes:
        robot: with its gripper.
        base: of the robot, in the cell's own frame, z up.
        container: its inner floor corner and the turn of its axes, in the cell's frame; None: in front of the
            robot, ``near_edge`` away, for a container of any size.
        pick: where an item waits: the middle of the underside of its bounding box, in the base frame, and its
            turn against the orientation that is planned; None: beside the robot, see :attr:`pick_place`.
        friction: coefficient of the container, and of items without their own, in planning and in physics.
        release_height: how far above its place an item is let go, m, at most ``rim_clearance``.
        rim_clearance: what a held item keeps above the rim before it goes over the container, m.
    """

    robot: Robot
    base: Place = Place()
    container: Place | None = None
    pick: Place | None = None
    friction: float = FRICTION
    release_height: float = RELEASE_HEIGHT
    rim_clearance: float = RIM_CLEARANCE

    def __post_init__(self) -> None:
        """Check that the numbers go together.

        Raises:
            InputError: they do not.
        """
        if not self.friction > 0.0:
            raise InputError(f"friction is {self.friction:g}, give a number above 0")
        if not 0.0 <= self.release_height <= self.rim_clearance:
            raise InputError(
                f"release_height_m is {self.release_height:g}, give a number from 0 to rim_clearance_m, "
                f"{self.rim_clearance:g}: so far above the rim is an item carried"
            )

    def with_container(self, container: Container) -> Cell:
        """The cell with a container of a certain size."""
        if self.container is None:
            return Cell(self, container, (self.robot.near_edge, -container.width / 2.0, 0.0))
        x, y, z = (c - b for c, b in zip(self.container.position, self.base.position, strict=True))
        turn = self.base.yaw
        if turn:
            x, y = cos(turn) * x + sin(turn) * y, cos(turn) * y - sin(turn) * x
        return Cell(self, container, (x, y, z), self.container.yaw - turn)

    @property
    def label(self) -> str:
        """The cell in a few words, for people."""
        gripper = self.robot.gripper
        place = "in front of it" if self.container is None else "where the cell says"
        return f"{self.robot.name}, gripper {gripper.length:g} m, holds {gripper.heaviest:.3g} kg, container {place}"

    @property
    def pick_place(self) -> Place:
        """Where items wait, in the base frame: to the robot's right where the cell does not say."""
        return self.pick or Place((0.0, -(self.robot.near_edge + _PICK_BEYOND), 0.0))

    def to_mapping(self) -> dict[str, Any]:
        """The setup as JSON has it; ``files.load_cell`` makes an equal one of it."""
        return {
            "robot": self.robot.to_mapping(),
            "base": self.base.to_mapping(),
            "container": None if self.container is None else self.container.to_mapping(),
            "pick": None if self.pick is None else self.pick.to_mapping(),
            "friction": self.friction,
            "release_height_m": self.release_height,
            "rim_clearance_m": self.rim_clearance,
        }


@dataclass(frozen=True)
class Cell:
    """A container in front of a robot.

    Attributes:
        setup: robot and settings.
        container: the box.
        position: (x, y, z) of the container frame's origin in the base frame, m.
        yaw: turn of the container's axes against those of the base, about the vertical, rad.
    """

    setup: CellSetup
    container: Container
    position: tuple[float, float, float]
    yaw: float = 0.0

    @property
    def robot(self) -> Robot:
        """The robot, with its gripper."""
        return self.setup.robot

    @property
    def rim(self) -> float:
        """Height of the container's rim in the base frame, m."""
        return self.position[2] + self.container.height

    @property
    def away(self) -> float:
        """Distance of the container's inside from joint 1's axis, m; 0 where the axis runs through it."""
        x, y, _ = self.to_container(np.zeros(3)).tolist()
        return hypot(max(-x, 0.0, x - self.container.length), max(-y, 0.0, y - self.container.width))

    @property
    def in_column(self) -> bool:
        """Whether the container stands where the robot's base and link 1 are, which no path can help."""
        return self.rim > 0.0 and self.away < self.robot.shapes.column_radius

    @property
    def turn(self) -> FloatArray:
        """(3, 3) container axes to base axes."""
        c, s = cos(self.yaw), sin(self.yaw)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def to_base(self, points: FloatArray) -> FloatArray:
        """Points of the container frame in the base frame: (..., 3) to (..., 3), m."""
        points = np.asarray(points, dtype=np.float64)
        moved: FloatArray = (points @ self.turn.T if self.yaw else points) + np.array(self.position)
        return moved

    def to_container(self, points: FloatArray) -> FloatArray:
        """Points of the base frame in the container frame: (..., 3) to (..., 3), m."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) - np.array(self.position)
        return moved @ self.turn if self.yaw else moved

    def poses_to_base(self, poses: FloatArray) -> FloatArray:
        """Poses in the container frame to poses in the base frame: (..., 4, 4) to (..., 4, 4)."""
        moved = np.array(poses, dtype=np.float64)
        moved[..., :3, 3] = self.to_base(moved[..., :3, 3])
        if self.yaw:
            moved[..., :3, :3] = self.turn @ moved[..., :3, :3]
        return moved

    def poses_to_container(self, poses: FloatArray) -> FloatArray:
        """Inverse of :meth:`poses_to_base`."""
        moved = np.array(poses, dtype=np.float64)
        moved[..., :3, 3] = self.to_container(moved[..., :3, 3])
        if self.yaw:
            moved[..., :3, :3] = self.turn.T @ moved[..., :3, :3]
        return moved

    def top_down_path(self, point: FloatArray, lift: float, *, spacing: float = WAYPOINT_STEP) -> FloatArray:
        """Flange poses that lower the cup straight down to a point.

        Args:
            point: (3,) centre of the cup's lip at the end, container frame, m.
            lift: how far above the point the path begins, m, at least 0.
            spacing: largest distance between two waypoints, m.

        Returns:
            (m, 4, 4) flange poses in the base frame, from the top down, both ends included.

        Raises:
            ValueError: ``lift`` is negative or ``spacing`` is not positive.
        """
        if not (lift >= 0.0 and spacing > 0.0):
            raise ValueError(f"lift is {lift:g} and spacing {spacing:g}, give lift ≥ 0 and spacing > 0")
        waypoints = int(np.ceil(lift / spacing - 1e-9)) + 1
        points = np.repeat(self.to_base(point)[None], waypoints, axis=0)
        points[:, 2] += np.linspace(lift, 0.0, waypoints)
        return self.robot.gripper.tool_to_flange(top_down(points))

    def barrier(self, tallest: float) -> str | None:
        """Why the robot can bring nothing into the empty container; None where it may.

        Args:
            tallest: no item is taller, however it is turned, m.
        """
        box, robot = self.container, self.robot
        tube = robot.gripper.length
        deeper = ""
        if box.height > tube:
            deeper = f"{box.label} is {box.height:.3g} m deep, deeper than the gripper of {tube:.3g} m, and "
        if self.rim > robot.highest_rim:
            return (
                f"{deeper}the rim of {box.label} is {self.rim:.3g} m above the base of {robot.name}, whose links are "
                f"never all higher than {robot.highest_rim:.3g} m"
            )
        if tallest + tube < box.height:
            return (
                f"{box.label} is {box.height:.3g} m deep, and the gripper of {tube:.3g} m with the "
                f"tallest item, at most {tallest:.3g} m, does not reach from its floor to its rim"
            )
        if self.away > robot.reach:
            return (
                f"{box.label} is {self.away:.3g} m away from {robot.name}, which reaches {robot.reach:.3g} m"
            )
        return None

    def arm_clear(self, q: FloatArray) -> BoolArray:
        """Whether the arm keeps above the rim and off itself along each of some paths.

        Links 2 to 6 above the rim hit neither the walls nor what the container holds; base and link 1 are
        :attr:`in_column`'s to answer for. The gripper and the held item are the caller's to check.

        Args:
            q: (k, m, 6) joints of k paths of m poses, rad.

        Returns:
            (k,) True where every pose of the path is clear.
        """
        frames, shapes = self.robot.link_frames(q), self.robot.shapes
        clear: BoolArray = np.all(shapes.arm_lowest(frames) >= self.rim, axis=-1)
        clear[clear] = ~shapes.self_collision(frames[clear]).any(axis=-1)
        return clear

    def clear_branches(self, path: FloatArray, *, max_step: float = MAX_STEP) -> PathBranches:
        """The continuous branches along a path whose arm keeps above the rim and off itself.

        Args:
            path: (m, 4, 4) flange poses in the base frame.
            max_step: as in :meth:`packenv.robot.protocol.Robot.continuous_branches`.

        Returns:
            the branches that are left; none is an answer.
        """
        found = self.robot.continuous_branches(path, max_step=max_step)
        keep = np.flatnonzero(self.arm_clear(found.q))
        return PathBranches(found.q[keep], tuple(found.slots[k] for k in keep), found.beyond_limits)
