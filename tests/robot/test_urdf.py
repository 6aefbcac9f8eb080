"""The URDF: the same robot as the planner's, for another engine too."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from packenv.robot.shapes import Primitive
from packenv.robot.urdf import mass_properties
from tests.conftest import NO_BULLET
from tests.robot.sampling import ROBOTS, random_joints

pybullet = pytest.importorskip("pybullet", reason=NO_BULLET)


@pytest.fixture(params=ROBOTS, ids=lambda r: r.name)
def robot(request):
    return request.param


def test_links_joints_limits_and_masses(robot):
    tree = ET.fromstring(robot.urdf())
    joints = {j.get("name"): j for j in tree.findall("joint")}
    for i, name in enumerate(robot.joint_names):
        limit = joints[name].find("limit")
        assert float(limit.get("lower")) == pytest.approx(robot.lower[i], abs=1e-8)
        assert float(limit.get("upper")) == pytest.approx(robot.upper[i], abs=1e-8)
        assert float(limit.get("velocity")) == pytest.approx(robot.velocity[i], abs=1e-5)
    masses = [float(m.get("value")) for m in tree.findall("link/inertial/mass")]
    assert sum(masses) == pytest.approx(sum(robot.link_masses) + robot.gripper.mass, abs=1e-4)
    for inertia in tree.findall("link/inertial/inertia"):
        x, y, z = (float(inertia.get(k)) for k in ("ixx", "iyy", "izz"))
        assert x + y >= z
        assert y + z >= x
        assert z + x >= y


@pytest.mark.parametrize("capsule", [False, True])
def test_mass_properties_of_one_primitive(capsule):
    part = Primitive(2, (0.1, 0.0, 0.2), (0.1, 0.0, 0.5), 0.08, capsule=capsule)
    com, inertia = mass_properties([part], 3.0)
    make = trimesh.creation.capsule if capsule else trimesh.creation.cylinder
    mesh = make(height=0.3, radius=0.08, **({"count": [128, 128]} if capsule else {"sections": 256}))
    mesh.density = 3.0 / mesh.volume
    np.testing.assert_allclose(com, [0.1, 0.0, 0.35], atol=1e-12)
    np.testing.assert_allclose(inertia, mesh.moment_inertia, rtol=2e-3, atol=1e-6)


def test_mass_properties_add_up():
    """Two halves of a cylinder are the cylinder."""
    halves = [Primitive(2, (0, 0, a), (0, 0, a + 0.2), 0.1) for a in (0.0, 0.2)]
    whole = Primitive(2, (0, 0, 0.0), (0, 0, 0.4), 0.1)
    for got, expected in zip(mass_properties(halves, 2.0), mass_properties([whole], 2.0), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.fixture
def engine(robot, tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(robot.urdf(), encoding="utf-8")
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(file), useFixedBase=True, physicsClientId=client)
    yield body, client
    pybullet.disconnect(client)


def test_pybullet_agrees_on_every_link_frame(robot, engine):
    body, client = engine
    for q in random_joints(100, 1, robot=robot):
        for i, angle in enumerate(q):
            pybullet.resetJointState(body, i, angle, physicsClientId=client)
        frames = robot.link_frames(q)
        for i in range(6):
            state = pybullet.getLinkState(body, i, computeForwardKinematics=True, physicsClientId=client)
            turn = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
            np.testing.assert_allclose(state[4], frames[i + 1, :3, 3], atol=1e-6)
            np.testing.assert_allclose(turn, frames[i + 1, :3, :3], atol=1e-6)
        tool = pybullet.getLinkState(body, 7, computeForwardKinematics=True, physicsClientId=client)
        np.testing.assert_allclose(tool[4], robot.gripper.flange_to_tool(frames[6])[:3, 3], atol=1e-6)


def test_pybullet_agrees_on_the_lowest_points(robot, engine):
    """Its distance from each link to a floor far below; its round shapes have flat facets."""
    body, client = engine
    half = [9.0, 9.0, 0.5]
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
    floor = pybullet.createMultiBody(0, shape, basePosition=[0, 0, -2.5], physicsClientId=client)
    compared = 0
    for q in random_joints(10, 2, robot=robot):
        for i, angle in enumerate(q):
            pybullet.resetJointState(body, i, angle, physicsClientId=client)
        lowest = robot.shapes.lowest_points(robot.link_frames(q))
        for link in range(1, 8):  # 7 is the gripper
            parts = enumerate(robot.shapes.primitives)
            mine = [k for k, p in parts if (7 if k == robot.shapes.gripper else p.link) == link]
            near = pybullet.getClosestPoints(body, floor, 9.0, linkIndexA=link - 1, physicsClientId=client)
            assert min(n[8] for n in near) - 2.0 == pytest.approx(lowest[mine].min(), abs=2.5e-3)
            compared += 1
    assert compared == 70
