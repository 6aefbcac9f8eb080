"""A stated centre of mass is the one that everything uses: poses, grasps, balance, settling, verify and physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.config import GridConfig
from packenv.geometry.convex_parts import ConvexParts
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.stable_poses import stable_poses
from packenv.planning.options import PlanOptions
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contacts import Body, item_contacts, join
from packenv.planning.stability.settling import settles
from packenv.types import Container, Item, Placement, Plan
from packenv.verification.stability_and_reach import recheck
from tests.shapes import box
from tests.shelf_samples import shelf_of

BOX = Container(0.4, 0.4, 0.3)
GRID = GridConfig(cell_size=0.005, n_yaws=4)
CORNER = np.array([0.09, 0.05, 0.01])
SIZE = np.array([0.10, 0.06, 0.03])
SPARE = 0.002
"""How far the centre of mass is inside or outside the edge, m: Bullet's rounded edges are 0.1 mm."""


def table() -> Item:
    """A block of 10 cm × 20 cm, 4 cm high, heavy enough that nothing on it tips it."""
    return replace(box(0.10, 0.20, 0.04, "table"), mass=5.0)


def loaded() -> Item:
    """A box whose mass is in one corner."""
    return replace(box(*SIZE, "loaded"), com=CORNER)


def over_the_edge(yaw_deg: float, beyond: float) -> tuple[np.ndarray, np.ndarray]:
    """Pose on the table with the centre of mass ``beyond`` its edge x = 0.2, in the middle of its width."""
    rotation = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    com = np.array([0.2 + beyond, 0.2, 0.04 + CORNER[2]])
    return rotation, com - rotation @ CORNER


CASES = [(yaw, beyond) for yaw in (0.0, 90.0, 180.0, 270.0) for beyond in (-SPARE, SPARE)]


@pytest.mark.parametrize(("yaw", "beyond"), CASES)
def test_a_box_with_its_mass_in_a_corner_tips_where_that_is_over_the_edge(yaw: float, beyond: float) -> None:
    """With the centroid for it, every answer at yaw 0 and 180 degrees would be the other one."""
    items = {item.name: item for item in (table(), loaded())}
    fields = shelf_of(items, GRID).fields
    rotation, position = over_the_edge(yaw, beyond)
    at = np.array([0.1, 0.1, 0.0])
    bodies = [Body(fields["table"], np.eye(3), at), Body(fields["loaded"], rotation, position)]
    own = item_contacts(bodies[1], bodies[:1], BOX, index=2)
    contacts = join([item_contacts(bodies[0], [], BOX, index=1), own])
    coms = [at + items["table"].com, position + rotation @ CORNER]
    checker = StabilityChecker()
    assert checker.check(contacts, [5.0, loaded().mass], coms).stable == (beyond < 0.0)
    assert settles(checker, own, coms[1], 2) == (beyond < 0.0)

    corner = np.zeros(3)
    plan = Plan(
        BOX,
        (
            Placement("table", 1, np.eye(3), at, corner, corner, 0, 0.0, 0.0, 1),
            Placement("loaded", 1, rotation, position, corner, corner, 0, 0.0, 0.0, 1),
        ),
        (),
    )
    for stability in ("paper", "cautious"):
        options = PlanOptions(constraints="stability", stability=stability, grid=GRID)  # type: ignore[arg-type]
        assert recheck(plan, items, fields, options).unstable_steps == (() if beyond < 0.0 else (2,))


@pytest.mark.parametrize(("yaw", "beyond"), CASES)
def test_in_physics_it_tips_there_too(yaw: float, beyond: float) -> None:
    from packenv.sim.physics_items import PhysicsItem
    from packenv.sim.world import World

    block, item = (
        PhysicsItem.of_item(i, ConvexParts((i.vertices,), None, 0.0, 0.0)) for i in (table(), loaded())
    )
    rotation, position = over_the_edge(yaw, beyond)
    with World(BOX) as world:
        world.add(block, np.eye(3), np.array([0.1, 0.1, 0.0]))
        body = world.add(item, rotation, position)
        assert world.raw_pose(body)[0] == pytest.approx(position + rotation @ CORNER, abs=1e-9)
        for _ in range(480):
            world.step()
        turned, at = world.pose(body)
    stays = turned[2, 2] > 0.999 and abs((turned @ CORNER + at)[2] - 0.04 - CORNER[2]) < 1e-3
    assert stays == (beyond < 0.0)


def test_its_moments_are_those_of_uniform_density() -> None:
    """How the mass is spread nobody said: the figures for a body in physics do not change with the centre."""
    from packenv.sim.physics_items import PhysicsItem

    even = box(*SIZE, "loaded")
    x, y, z = SIZE
    expected = even.mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    for item in (even, loaded()):
        made = PhysicsItem.of_item(item, ConvexParts((item.vertices,), None, 0.0, 0.0))
        assert np.sort(made.moments) == pytest.approx(np.sort(expected), rel=1e-9)
        assert made.reach == pytest.approx(np.linalg.norm(item.vertices - item.com, axis=1).max())


def test_stable_poses_and_heightmaps_follow_it() -> None:
    """A tall box with its mass at the bottom stands on that more surely than one with its mass at the top."""
    tall = box(0.04, 0.05, 0.12, "tall")
    low = replace(tall, com=np.array([0.02, 0.025, 0.01]))
    high = replace(tall, com=np.array([0.02, 0.025, 0.11]))

    def share(item: Item) -> float:
        """Of the pose with the mesh's z axis up."""
        return sum(p.probability for p in stable_poses(item) if p.rotation[2, 2] > 0.99)

    assert share(low) > share(tall) > share(high)
    for item in (low, high, loaded()):
        for pose in stable_poses(item):
            turned = item.vertices @ pose.rotation.T
            oriented = orient_item(item, pose.rotation, cell_size=0.005)
            assert oriented.com == pytest.approx(pose.rotation @ item.com - turned.min(axis=0), abs=1e-9)
