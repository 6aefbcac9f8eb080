"""Inverse kinematics of the TX90: ``python -m benchmarks.ik --json``.

``poses_per_s`` counts flange poses with all their branches, joint limits and whole turns included, at random
over the whole workspace. ``agreement`` is the share of poses at which another closed-form solver finds
exactly the same branches, null where py-opw-kinematics is not installed. Path figures are means over 200
top-down paths into the 0.32x0.32x0.30 container. Times are CPU times of one thread.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from packenv.robot.files import default_cell
from packenv.types import Container, FloatArray

TX90 = default_cell().robot
REPEATS = 7
MEETS = 1e-8
"""Two solvers' branches are the same where no joint differs by more, whole turns aside, rad."""


def seconds(work: Callable[[], Any], count: int) -> float:
    """Median CPU-seconds of one of ``count`` pieces of work that a call does; the first call compiles."""
    work()
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return statistics.median(times) / count


def round_trip(poses: FloatArray) -> tuple[float, float]:
    """Largest error of forward(inverse(pose)) over all branches: metres, and rad."""
    reached = TX90.forward(TX90.inverse(poses).q)
    metres = np.linalg.norm(reached[..., :3, 3] - poses[:, None, :3, 3], axis=-1)
    chord = np.linalg.norm(reached[..., :3, :3] - poses[:, None, :3, :3], axis=(-2, -1))
    return float(np.nanmax(metres)), float(np.nanmax(2 * np.arcsin(chord / np.sqrt(8))))


def against_opw(poses: FloatArray) -> dict[str, float | None]:
    """Agreement with py-opw-kinematics, and its speed."""
    try:
        import py_opw_kinematics as opw
    except ImportError:
        return {"agreement": None, "opw_poses_per_s": None}
    from scipy.spatial.transform import RigidTransform

    model = opw.KinematicModel(a1=0.05, a2=0.0, b=0.05, c1=0.478, c2=0.425, c3=0.425, c4=0.1)
    robot = opw.Robot(model, degrees=False)
    transforms, limits = RigidTransform.from_matrix(poses), np.stack([TX90.lower, TX90.upper], axis=1)
    theirs = robot.reach(transforms, joint_limits=limits).joints
    ours = TX90.inverse(poses)
    apart = np.abs((theirs - ours.q + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)
    there = ~np.isnan(theirs[..., 0])
    same = (there == ours.exists) & (~there | (apart < MEETS))
    return {
        "agreement": float(same.all(axis=1).mean()),
        "opw_poses_per_s": 1.0 / seconds(lambda: robot.reach(transforms, joint_limits=limits), len(poses)),
    }


def path_times(seed: int) -> dict[str, float]:
    """What a top-down path costs."""
    cell = default_cell().with_container(Container(0.32, 0.32, 0.30))
    points = np.random.default_rng(seed).uniform(0.01, [0.31, 0.31, 0.29], (200, 3))
    paths = [cell.top_down_path(p, cell.rim + 0.01) for p in points]
    return {
        "path_waypoints": statistics.median(len(p) for p in paths),
        "path_branches_us": 1e6 * seconds(lambda: [TX90.continuous_branches(p) for p in paths], len(paths)),
        "path_clear_us": 1e6 * seconds(lambda: [cell.clear_branches(p) for p in paths], len(paths)),
        "path_followed_share": float(np.mean([len(cell.clear_branches(p)) > 0 for p in paths])),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON only, no summary line")
    arguments = parser.parse_args()

    joints = np.random.default_rng(arguments.seed).uniform(TX90.lower, TX90.upper, (arguments.poses, 6))
    poses = TX90.forward(joints)
    found = TX90.inverse(poses)
    pose_seconds = seconds(lambda: TX90.inverse(poses), len(poses))
    metres, radians = round_trip(poses)
    report = {
        "poses": len(poses),
        "poses_per_s": 1.0 / pose_seconds,
        "us_per_pose": 1e6 * pose_seconds,
        "forward_us": 1e6 * seconds(lambda: TX90.link_frames(joints), len(joints)),
        "branches_mean": float(found.exists.sum(axis=1).mean()),
        "branches_in_limits_mean": float(found.valid.sum(axis=1).mean()),
        "max_error_m": metres,
        "max_error_rad": radians,
        **against_opw(poses),
        **path_times(arguments.seed),
    }
    if not arguments.json:
        print(
            f"{report['poses_per_s'] / 1e6:.2f} M poses/s, round trip within {metres:.1e} m, agreement "
            f"{report['agreement']}, a path {report['path_clear_us']:.0f} µs",
            file=sys.stderr,
        )
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
