"""The arm's primitives against points sampled on them."""

import numpy as np
import pytest

from tests.robot.sampling import ROBOTS, TX90, random_joints


@pytest.fixture(params=ROBOTS, ids=lambda r: r.name)
def robot(request):
    return request.param


def surface_points(primitive, rng, count=4000):
    """Points on the primitive's surface, rims of flat ends included, in the link's frame."""
    start, end = np.array(primitive.start), np.array(primitive.end)
    length = np.linalg.norm(end - start)
    axis = (end - start) / length
    side = np.linalg.svd(axis[None])[2][1:]
    angle = rng.uniform(0, 2 * np.pi, count)
    ring = np.cos(angle)[:, None] * side[0] + np.sin(angle)[:, None] * side[1]
    along = rng.choice([0.0, 1.0, rng.uniform()], count)[:, None]
    points = [start + along * (end - start) + primitive.radius * ring]
    if primitive.capsule:
        ball = rng.normal(size=(count, 3))
        ball *= primitive.radius / np.linalg.norm(ball, axis=1, keepdims=True)
        points += [np.where(ball @ axis > 0, 1, 0)[:, None] * (end - start) + start + ball]
    return np.concatenate(points)


def in_base(points, frame):
    return points @ frame[:3, :3].T + frame[:3, 3]


def segment_distances(points, ends):
    axis = ends[1] - ends[0]
    t = np.clip((points - ends[0]) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(points - ends[0] - t[:, None] * axis, axis=1)


def test_capsules_enclose_the_primitives(robot):
    rng = np.random.default_rng(1)
    for q in random_joints(5, 1, robot=robot):
        frames = robot.link_frames(q)
        capsules = robot.shapes.capsules(frames)
        for k, primitive in enumerate(robot.shapes.primitives):
            points = in_base(surface_points(primitive, rng), frames[primitive.link])
            distances = segment_distances(points, capsules.ends[k])
            assert distances.max() <= capsules.radii[k] + 1e-12
            # and no looser than they need be
            assert distances.max() >= capsules.radii[k] - 1e-3


def test_lowest_points_are_the_lowest_sampled_ones(robot):
    rng = np.random.default_rng(2)
    for q in random_joints(10, 2, robot=robot):
        frames = robot.link_frames(q)
        lowest = robot.shapes.lowest_points(frames)
        for k, primitive in enumerate(robot.shapes.primitives):
            sampled = in_base(surface_points(primitive, rng), frames[primitive.link])[:, 2].min()
            assert lowest[k] <= sampled + 1e-12
            assert lowest[k] >= sampled - 3e-3


def test_the_arm_is_links_2_to_6_without_the_gripper(robot):
    q = random_joints(200, 3, robot=robot)
    arm = [k for k, p in enumerate(robot.shapes.primitives) if p.link >= 2 and k != robot.shapes.gripper]
    np.testing.assert_allclose(
        robot.arm_lowest(q), robot.shapes.lowest_points(robot.link_frames(q))[:, arm].min(axis=1), atol=1e-12
    )


def test_base_and_link_1_stay_in_their_column(robot):
    rng = np.random.default_rng(4)
    farthest = 0.0
    for q in random_joints(20, 4, robot=robot):
        frames = robot.link_frames(q)
        for primitive in (p for p in robot.shapes.primitives if p.link <= 1):
            points = in_base(surface_points(primitive, rng), frames[primitive.link])
            farthest = max(farthest, np.linalg.norm(points[:, :2], axis=1).max())
    assert farthest <= robot.shapes.column_radius + 1e-12
    assert farthest >= robot.shapes.column_radius - 1e-3


def test_self_collision_is_that_of_the_capsules_axes(robot):
    """Against distances of points on the axes, 5 mm apart: they differ by less than 5 mm."""
    t = np.linspace(0, 1, 101)[:, None]
    decided = 0
    for q in random_joints(150, 5, robot=robot):
        capsules = robot.shapes.capsules(robot.link_frames(q))
        links = capsules.links.copy()
        links[robot.shapes.gripper] = 7
        depth = -np.inf
        for a in range(len(links)):
            for b in range(a + 1, len(links)):
                if links[b] - links[a] < 2 or (links[a] >= 4 and links[b] != 7) or links[a] >= 5:
                    continue
                first, second = capsules.ends[a], capsules.ends[b]
                points = first[0] + t * (first[1] - first[0])
                gap = segment_distances(points, second).min() - capsules.radii[a] - capsules.radii[b]
                depth = max(depth, -gap)
        if abs(depth) > 0.005:
            decided += 1
            assert robot.self_collision(q) == (depth > 0)
    assert decided > 100


def test_upright_is_free_and_folded_back_is_not():
    assert not TX90.self_collision(np.zeros(6))
    assert TX90.self_collision(np.deg2rad([0, -130, -145, 0, 0, 0]))


def test_no_configurations_at_all(robot):
    assert robot.self_collision(np.empty((0, 6))).shape == (0,)
    assert robot.arm_lowest(np.empty((0, 6))).shape == (0,)
