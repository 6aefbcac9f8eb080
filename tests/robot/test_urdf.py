"""The URDF: the same robot as the planner's, for another engine too."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from packenv.io.assets import robot_urdf
from packenv.robot import gripper, shapes, tx90
from packenv.robot.shapes import Primitive
from packenv.robot.tx90_data import LINK_MASSES, LOWER, UPPER
from packenv.robot.urdf import mass_properties, urdf_text
from tests.conftest import NO_PHYSICS
from tests.robot.sampling import random_joints

pybullet = pytest.importorskip("pybullet", reason=NO_PHYSICS)

URDF = robot_urdf()


def test_the_asset_is_what_the_module_prints():
    assert URDF.read_text(encoding="utf-8") == urdf_text()


def test_links_joints_limits_and_masses():
    robot = ET.fromstring(urdf_text())
    joints = {j.get("name"): j for j in robot.findall("joint")}
    for i in range(6):
        limit = joints[f"joint_{i + 1}"].find("limit")
        assert float(limit.get("lower")) == pytest.approx(LOWER[i], abs=1e-8)
        assert float(limit.get("upper")) == pytest.approx(UPPER[i], abs=1e-8)
    masses = [float(m.get("value")) for m in robot.findall("link/inertial/mass")]
    assert sum(masses) == pytest.approx(sum(LINK_MASSES) + gripper.MASS, abs=1e-4)
    for inertia in robot.findall("link/inertial/inertia"):
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
def engine():
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(URDF), useFixedBase=True, physicsClientId=client)
    yield body, client
    pybullet.disconnect(client)


def test_pybullet_agrees_on_every_link_frame(engine):
    body, client = engine
    for q in random_joints(100, 1):
        for i, angle in enumerate(q):
            pybullet.resetJointState(body, i, angle, physicsClientId=client)
        frames = tx90.link_frames(q)
        for i in range(6):
            state = pybullet.getLinkState(body, i, computeForwardKinematics=True, physicsClientId=client)
            turn = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
            np.testing.assert_allclose(state[4], frames[i + 1, :3, 3], atol=1e-6)
            np.testing.assert_allclose(turn, frames[i + 1, :3, :3], atol=1e-6)
        tool = pybullet.getLinkState(body, 7, computeForwardKinematics=True, physicsClientId=client)
        np.testing.assert_allclose(tool[4], gripper.flange_to_tool(frames[6])[:3, 3], atol=1e-6)


def test_pybullet_agrees_on_the_lowest_points(engine):
    """Its distance from each link to a floor far below; its round shapes have flat facets."""
    body, client = engine
    half = [9.0, 9.0, 0.5]
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
    floor = pybullet.createMultiBody(0, shape, basePosition=[0, 0, -2.5], physicsClientId=client)
    compared = 0
    for q in random_joints(10, 2):
        for i, angle in enumerate(q):
            pybullet.resetJointState(body, i, angle, physicsClientId=client)
        lowest = shapes.lowest_points(q)
        for link in range(1, 8):  # 7 is the gripper
            mine = [
                k for k, p in enumerate(shapes.PRIMITIVES) if (7 if k == shapes.GRIPPER else p.link) == link
            ]
            near = pybullet.getClosestPoints(body, floor, 9.0, linkIndexA=link - 1, physicsClientId=client)
            assert min(n[8] for n in near) - 2.0 == pytest.approx(lowest[mine].min(), abs=2.5e-3)
            compared += 1
    assert compared == 70
