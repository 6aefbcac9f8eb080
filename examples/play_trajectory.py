"""Play a plan's motions on the robot's URDF, from the exported file alone; another file may be named."""

import json
import sys
from pathlib import Path

import numpy as np
import pybullet as p

import packenv as rp

path = Path(sys.argv[1] if len(sys.argv) > 1 else "trajectories.json")
if len(sys.argv) == 1:
    plan = rp.plan(rp.Order.of("mug", "bowl", "banana"), rp.Container(0.32, 0.32, 0.30))
    rp.trajectories(plan).save(path)
file = json.loads(path.read_text())
robot, end = file["robot"], None


def seconds(row):
    """When a point is reached, or an event is due."""
    return row["time_from_start"]["sec"] + 1e-9 * row["time_from_start"]["nanosec"]


p.connect(p.DIRECT)  # p.GUI shows it
Path("robot.urdf").write_text(robot["urdf"])
arm = p.loadURDF("robot.urdf", useFixedBase=True)
infos = [p.getJointInfo(arm, j) for j in range(p.getNumJoints(arm))]
joints = [next(i[0] for i in infos if i[1].decode() == name) for name in robot["joint_names"]]
tool = next(i[0] for i in infos if i[12].decode() == robot["tool_link"])
for step in file["steps"]:
    points, poses = step["trajectory"]["points"], {}
    for point in points:
        for joint, angle in zip(joints, point["positions"], strict=True):
            p.resetJointState(arm, joint, angle)
        poses[seconds(point)] = p.getLinkState(arm, tool, computeForwardKinematics=True)[4:6]
    on, off = (poses[seconds(event)] for event in step["vacuum"])
    held = p.multiplyTransforms(*p.invertTransform(*on), step["pick"]["position"], step["pick"]["quat_xyzw"])
    let_go, turn = p.multiplyTransforms(*off, *held)
    assert np.allclose(let_go, step["release"]["position"], atol=1e-3)
    assert abs(np.dot(turn, step["release"]["quat_xyzw"])) > np.cos(np.radians(0.1) / 2.0)
    times = np.array([seconds(point) for point in points])
    q = np.array([point["positions"] for point in points])
    assert times[0] == 0.0 < np.diff(times).min()
    assert np.array_equal(q, np.clip(q, robot["position_lower"], robot["position_upper"]))
    assert (np.abs(np.diff(q, axis=0)) <= np.diff(times)[:, None] * robot["velocity"] + 1e-6).all()
    assert end is None or np.allclose(end, q[0], atol=1e-6)
    end = q[-1]
    print(f"step {step['step']}: {step['item']}, {times[-1]:.1f} s")
