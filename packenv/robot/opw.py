"""Six-axis arms with an ortho-parallel basis and a spherical wrist: most industrial arms are of this kind.

Seven lengths say all about such an arm (Brandstötter, Angerer and Hofbaur 2014): at *model angles* θ of 0 it
stands straight up, its frames parallel to the base's. Joint i of the arm itself is at q = sign · (θ + offset), so
θ = sign · q - offset: makers count joints from other postures and in other directions.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import atan2, hypot
from typing import Any

import numpy as np

from packenv.robot import kinematics
from packenv.robot.gripper import ATMOSPHERE, Gripper
from packenv.robot.protocol import MAX_STEP, Branches, PathBranches, Robot
from packenv.robot.shapes import LinkShapes, Primitive
from packenv.robot.urdf import urdf_text
from packenv.types import FloatArray

_BETWEEN = 2e-3
"""No link is longer than to be so much higher between two steps of 0.1° from the nearest, m."""


@dataclass(frozen=True)
class Lengths:
    """The seven lengths of an arm, m; the names are the paper's.

    Attributes:
        a1: from joint 1's axis to joint 2's, along x.
        a2: from joint 3's axis to joint 4's, along x; negative where the forearm lies above the elbow of an arm
            that reaches forward.
        b: from joint 1's axis to the plane of forearm and wrist, along y.
        c1: from the mounting face up to joint 2's axis.
        c2: from joint 2's axis to joint 3's.
        c3: from joint 3's axis to the wrist centre, along the forearm.
        c4: from the wrist centre to the flange.
    """

    a1: float
    a2: float
    b: float
    c1: float
    c2: float
    c3: float
    c4: float


@dataclass(frozen=True)
class Joint:
    """One joint, by the arm's own counting.

    Attributes:
        name: in URDF and trajectories.
        lower: smallest angle, rad.
        upper: largest angle, rad.
        velocity: largest speed, rad/s.
        effort: largest torque, N m; 0 where it is not published.
        sign: 1, or -1 where the joint turns against the model.
        offset: rad; see the module.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    effort: float = 0.0
    sign: int = 1
    offset: float = 0.0


@dataclass(frozen=True)
class OpwArm(Robot):
    """An arm with an ortho-parallel basis and a spherical wrist, and its gripper.

    Inverse kinematics: slot 4 · wrist + 2 · shoulder + elbow is the same configuration at every pose: wrist 0
    has θ5 ≥ 0, shoulder 0 reaches forward, elbow 0 has θ3 ≥ -atan2(a2, c3). Singularities: on the shoulder's and
    the elbow's borders two branches coincide and both are given; a wrist centre beyond the border by at most
    ``kinematics.REACH_TOLERANCE`` (1e-10 m) is taken to be on it. In the wrist's singularity (|sin θ5| <
    ``kinematics.WRIST_TOLERANCE``, 1e-9) joint 4 is free: one solution of the family is given, with θ4 = 0 (wrist
    0) or ±π (wrist 1).

    Attributes:
        name: one word.
        title: maker and type.
        source: where the figures are from, under which licence, and which are assumptions.
        lengths: of the arm.
        joints: six, from the base.
        link_names: seven, from the base; the last carries the flange.
        link_masses: kg, likewise.
        primitives: the space that the links take.
        gripper: at the flange.
        near_edge: recommended distance from joint 1's axis to the container's near wall, m.
        payload: rated load at the flange, the gripper included, kg; None where it is not known. Recorded, not
            checked.
    """

    name: str
    title: str
    source: str
    lengths: Lengths
    joints: tuple[Joint, ...]
    link_names: tuple[str, ...]
    link_masses: tuple[float, ...]
    primitives: tuple[Primitive, ...]
    gripper: Gripper
    near_edge: float
    payload: float | None = None
    joint_names: tuple[str, ...] = field(init=False, repr=False, compare=False)
    lower: FloatArray = field(init=False, repr=False, compare=False)
    upper: FloatArray = field(init=False, repr=False, compare=False)
    velocity: FloatArray = field(init=False, repr=False, compare=False)
    shapes: LinkShapes = field(init=False, repr=False, compare=False)
    _arm: FloatArray = field(init=False, repr=False, compare=False)
    _signs: FloatArray = field(init=False, repr=False, compare=False)
    _offsets: FloatArray = field(init=False, repr=False, compare=False)
    _plain: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the arrays that the compiled code reads."""
        signs = np.array([j.sign for j in self.joints], dtype=np.float64)
        offsets = np.array([j.offset for j in self.joints], dtype=np.float64)
        lower, upper, velocity = (
            np.array([getattr(j, name) for j in self.joints]) for name in ("lower", "upper", "velocity")
        )
        ends = np.sort(np.stack([signs * lower - offsets, signs * upper - offsets]), axis=0)
        a = self.lengths
        arm = np.concatenate(
            [
                [a.a1, a.a2, a.b, a.c1, a.c2, a.c3, a.c4, hypot(a.a2, a.c3), atan2(a.a2, a.c3)],
                *ends,
                0.0 - offsets,
            ]
        )
        for name, array in (
            ("lower", lower),
            ("upper", upper),
            ("velocity", velocity),
            ("_arm", arm),
            ("_signs", signs),
            ("_offsets", offsets),
        ):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "_plain", bool(np.all(signs == 1.0) and not offsets.any()))
        object.__setattr__(self, "joint_names", tuple(j.name for j in self.joints))
        object.__setattr__(self, "shapes", LinkShapes(self.primitives, self.gripper))

    def link_frames(self, q: FloatArray) -> FloatArray:
        """As :meth:`packenv.robot.protocol.Robot.link_frames`."""
        q = np.ascontiguousarray(q, dtype=np.float64)
        if q.shape[-1:] != (6,):
            raise ValueError(f"q has shape {q.shape}, give six joint angles on the last axis")
        frames = np.empty((q.size // 6, 7, 4, 4))
        kinematics.link_frames(self._arm, self._model(q.reshape(-1, 6)), frames)
        return frames.reshape(*q.shape[:-1], 7, 4, 4)

    def inverse(self, poses: FloatArray) -> Branches:
        """As :meth:`packenv.robot.protocol.Robot.inverse`."""
        poses = _poses(poses)
        q = np.empty((len(poses), 8, 6))
        valid = np.empty((len(poses), 8), dtype=np.bool_)
        kinematics.inverse(self._arm, poses, q, valid)
        return Branches(self._own(q), valid)

    def continuous_branches(self, path: FloatArray, *, max_step: float = MAX_STEP) -> PathBranches:
        """As :meth:`packenv.robot.protocol.Robot.continuous_branches`."""
        path = _poses(path)
        if not len(path):
            raise ValueError("path is empty, give at least one pose")
        q = np.empty((8, len(path), 6))
        state = np.empty(8, dtype=np.int8)
        kinematics.follow(self._arm, path, float(max_step), q, state)
        good = np.flatnonzero(state == 0)
        return PathBranches(
            self._own(q[good]), tuple(int(s) for s in good), int(np.count_nonzero(state == 2))
        )

    @cached_property
    def highest_rim(self) -> float:
        """As of link 2 alone, turned through all angles in steps of 0.2°; links 3 to 6 can only be lower."""
        angles = np.linspace(-np.pi, np.pi, 1801)
        lowest = np.full(angles.shape, np.inf)
        for part in (p for p in self.primitives if p.link == 2):
            ends = np.array([part.start, part.end])
            heights = np.outer(np.cos(angles), ends[:, 2]) - np.outer(np.sin(angles), ends[:, 0])
            length = float(np.linalg.norm(ends[1] - ends[0]))
            level = np.sqrt(np.maximum(0.0, 1.0 - ((heights[:, 1] - heights[:, 0]) / length) ** 2))
            lowest = np.minimum(lowest, heights.min(axis=1) - part.radius * (1.0 if part.capsule else level))
        return self.lengths.c1 + float(lowest.max()) + _BETWEEN

    @property
    def reach(self) -> float:
        """Of the arm stretched out level."""
        a = self.lengths
        return hypot(a.a1 + a.c2 + hypot(a.a2, a.c3), a.b)

    def urdf(self) -> str:
        """As :meth:`packenv.robot.protocol.Robot.urdf`."""
        return urdf_text(self)

    def to_mapping(self) -> dict[str, Any]:
        """As :meth:`packenv.robot.protocol.Robot.to_mapping`; ``records.robot_from`` reads it."""
        return {
            "name": self.name,
            "title": self.title,
            "source": self.source,
            "lengths_m": asdict(self.lengths),
            "joints": [
                {
                    "name": j.name,
                    "sign": j.sign,
                    "offset_rad": j.offset,
                    "lower_rad": j.lower,
                    "upper_rad": j.upper,
                    "velocity_rad_s": j.velocity,
                    "effort_nm": j.effort,
                }
                for j in self.joints
            ],
            "links": [
                {"name": name, "mass_kg": mass, "shapes": [_shape(p) for p in self.primitives if p.link == k]}
                for k, (name, mass) in enumerate(zip(self.link_names, self.link_masses, strict=True))
            ],
            "gripper": gripper_to_mapping(self.gripper),
            "payload_kg": self.payload,
            "near_edge_m": self.near_edge,
        }

    def with_gripper(self, gripper: Gripper) -> OpwArm:
        """As :meth:`packenv.robot.protocol.Robot.with_gripper`."""
        return replace(self, gripper=gripper)

    def _model(self, q: FloatArray) -> FloatArray:
        """Model angles of the arm's own."""
        return q if self._plain else q * self._signs - self._offsets

    def _own(self, model: FloatArray) -> FloatArray:
        """The arm's own angles of model angles."""
        return model if self._plain else self._signs * (model + self._offsets)


def _shape(part: Primitive) -> dict[str, Any]:
    return {
        "start_m": list(part.start),
        "end_m": list(part.end),
        "radius_m": part.radius,
        "round": part.capsule,
    }


def gripper_to_mapping(gripper: Gripper) -> dict[str, Any]:
    """A gripper as JSON has it."""
    plain = {
        "length_m": gripper.length,
        "radius_m": gripper.radius,
        "mass_kg": gripper.mass,
        "payload_kg": gripper.payload,
    }
    vacuum = {} if gripper.vacuum == ATMOSPHERE else {"vacuum_kpa": gripper.vacuum / 1000.0}
    return plain | vacuum | ({} if gripper.safety == 1.0 else {"safety_factor": gripper.safety})


def _poses(poses: FloatArray) -> FloatArray:
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape {poses.shape}, give (m, 4, 4)")
    return poses
