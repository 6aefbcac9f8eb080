"""Manipulation feasibility: laws on random maps, every accepted path against exact meshes, then cases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import fcl
import numpy as np
import pytest

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.collision import Pose, Posed, overlap_depth, solid_of
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.transforms import yaw_rotation
from packenv.items.catalogue import open_catalogue
from packenv.planning.manipulation.checker import (
    REASONS,
    ManipulationChecker,
    ManipulationResult,
    cup_kernels,
)
from packenv.planning.manipulation.grasps import Grasp, generate_grasps
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.kernels import lowest_at
from packenv.robot.cell import RIM_CLEARANCE, Cell
from packenv.robot.files import default_cell
from packenv.robot.protocol import MAX_STEP
from packenv.types import Container, Item, OrientedItem
from tests.planning.search.random_maps import CELL, quantized, random_oriented, random_surface
from tests.robot.sampling import TX90
from tests.shapes import ball, box, cup

PAPER = Container(0.32, 0.32, 0.30)
STEP = 5


def oriented_of(item: Item, rotation=None) -> OrientedItem:
    return orient_item(item, np.eye(3) if rotation is None else rotation, cell_size=CELL)


def grasp_at(oriented: OrientedItem, x: float, y: float) -> Grasp:
    """The cup on a point, whatever the seal."""
    z = cup_kernels.highest_under(oriented.top, x, y, TX90.gripper.radius, CELL)
    return Grasp(np.array([x, y, z]), "rough", 0.0, 0.0)


@dataclass
class Scene:
    """A random candidate in a random container; some are feasible, some not."""

    cell: Cell
    surface: ContainerMap
    oriented: OrientedItem
    corner: np.ndarray
    grasps: tuple[Grasp, ...]

    @classmethod
    def draw(cls, seed: int) -> Scene:
        rng = np.random.default_rng(seed)
        surface = random_surface(rng, int(rng.integers(20, 50)), int(rng.integers(20, 50)))
        oriented = random_oriented(rng, int(rng.integers(4, 16)), int(rng.integers(4, 16)))
        found = grid_search(surface, [oriented], 1)
        if len(found):
            k = rng.integers(0, len(found))
            z = float(found.z[k]) + rng.choice([0.0, 0.0, 0.01, -0.001])
            corner = np.array([found.ix[k] * CELL, found.iy[k] * CELL, z])
        else:
            corner = np.zeros(3)
        spots = rng.uniform(0, oriented.extents[:2], (int(rng.integers(0, 5)), 2))
        grasps = tuple(grasp_at(oriented, *spot) for spot in spots)
        position = (
            float(rng.uniform(0.25, 1.0)),
            float(rng.uniform(-0.3, 0.3)),
            float(rng.choice([0, 0.1, 0.4])),
        )
        return cls(Cell(default_cell(), surface.container, position), surface, oriented, corner, grasps)

    def check(self, **other) -> ManipulationResult:
        s = replace(self, **other)
        return ManipulationChecker(s.cell).check(s.oriented, s.corner, s.surface, s.grasps)


@pytest.fixture(scope="module")
def scenes() -> list[tuple[Scene, ManipulationResult]]:
    return [(scene, scene.check()) for scene in map(Scene.draw, range(300))]


def test_the_scenes_bring_up_nearly_every_answer(scenes) -> None:
    reasons = {result.reason for _, result in scenes}
    assert reasons >= {None, *REASONS} - {"joint-limits"}
    assert 0.15 < np.mean([result.feasible for _, result in scenes]) < 0.8


def test_an_answer_is_whole(scenes) -> None:
    """Joints carry the cup straight down to the release and on to the placement, on one branch."""
    for scene, found in scenes:
        assert found.grasps_tried <= len(scene.grasps)
        if not found.feasible:
            assert found.grasp is found.joints is found.lip_heights is None
            continue
        placed = scene.corner + found.grasp.point
        lips = found.lip_heights
        assert found.grasp is scene.grasps[found.grasps_tried - 1]
        cups = scene.cell.to_container(TX90.tool(found.joints)[:, :3, 3])
        np.testing.assert_allclose(cups[:, :2], np.tile(placed[:2], (len(lips), 1)), atol=1e-9)
        np.testing.assert_allclose(cups[:, 2], lips, atol=1e-9)
        assert lips[-1] == pytest.approx(placed[2])
        assert lips[-2] == pytest.approx(placed[2] + 0.01)
        held_bottom = lips[0] - found.grasp.point[2]
        assert held_bottom >= scene.cell.container.height + RIM_CLEARANCE - 1e-9
        assert np.all(np.diff(lips) < 0)
        assert np.all(np.diff(lips) >= -0.02 - 1e-9)
        assert np.abs(np.diff(found.joints, axis=0)).max() <= MAX_STEP
        assert TX90.limit_margin(found.joints).min() >= -1e-8
        assert TX90.arm_lowest(found.joints).min() >= scene.cell.rim


def test_translating_scene_and_robot_together_changes_nothing(scenes) -> None:
    """A wider container's frame lies elsewhere; robot, items and what the gripper may meet do not.

    The walls move, so only scenes whose cup keeps off them count.
    """
    compared = 0
    for scene, found in scenes:
        ix, iy = 7, 12
        nx, ny = scene.surface.heights.shape
        heights = np.zeros((nx + 2 * ix, ny + 2 * iy), dtype=np.float32)
        heights[ix : ix + nx, iy : iy + ny] = scene.surface.heights
        c = scene.cell.container
        wide = Container(c.length + 2 * ix * CELL, c.width + 2 * iy * CELL, c.height)
        shift = np.array([ix * CELL, iy * CELL, 0.0])
        x, y, z = np.array(scene.cell.position) - shift
        if found.reason == "gripper-hits-wall" or any(
            np.min([p := (scene.corner + g.point)[:2], np.array([c.length, c.width]) - p])
            < TX90.gripper.radius
            for g in scene.grasps
        ):
            continue
        again = scene.check(
            cell=Cell(default_cell(), wide, (float(x), float(y), float(z))),
            surface=ContainerMap(wide, CELL, heights),
            corner=scene.corner + shift,
        )
        assert again.reason == found.reason
        if found.feasible:
            np.testing.assert_allclose(again.joints, found.joints, atol=1e-7)
        compared += 1
    assert compared > 80


def test_raising_the_surroundings_never_helps(scenes) -> None:
    rng = np.random.default_rng(9)
    lost = 0
    for scene, found in scenes:
        heights = scene.surface.heights.copy()
        w, h = scene.oriented.top.shape
        ix, iy = np.round(scene.corner[:2] / CELL).astype(int)
        raised = heights + quantized(rng.random(heights.shape) * rng.choice([0.002, 0.05]))
        # Under the item itself often nothing: else every item is simply blocked.
        if rng.random() < 0.7:
            raised[ix : ix + w, iy : iy + h] = heights[ix : ix + w, iy : iy + h]
        after = scene.check(surface=ContainerMap(scene.surface.container, CELL, raised))
        assert found.feasible or not after.feasible
        lost += found.feasible and not after.feasible
    assert lost > 10


def test_more_grasps_never_hurt(scenes) -> None:
    gained = 0
    for scene, found in scenes:
        if found.feasible:
            for some in (scene.grasps[::-1], scene.grasps + scene.grasps[:1]):
                assert scene.check(grasps=some).feasible
        for k in range(len(scene.grasps)):
            fewer = scene.check(grasps=scene.grasps[:k])
            assert found.feasible or not fewer.feasible
            gained += found.feasible and not fewer.feasible
    assert gained > 30


def test_compiled_kernels_equal_the_definitions(scenes) -> None:
    for scene, _ in scenes[:100]:
        heights = scene.surface.heights.astype(float)
        w, h = scene.oriented.bottom.shape
        ix, iy = np.round(scene.corner[:2] / CELL).astype(int)
        window = heights[ix : ix + w, iy : iy + h]
        if window.shape == (w, h):
            gap = (window - scene.oriented.bottom)[scene.oriented.footprint].max()
            assert lowest_at(scene.surface.heights, scene.oriented.bottom, ix, iy) == max(0.0, gap)
        i, j = np.indices(heights.shape)
        for grasp in scene.grasps:
            x, y = (scene.corner + grasp.point)[:2]
            dx = np.maximum(np.abs((i + 0.5) * CELL - x) - CELL / 2, 0)
            dy = np.maximum(np.abs((j + 0.5) * CELL - y) - CELL / 2, 0)
            under = heights[np.hypot(dx, dy) < TX90.gripper.radius - 1e-6]
            assert (
                cup_kernels.highest_under(scene.surface.heights, x, y, TX90.gripper.radius, CELL)
                == under.max()
            )


def test_capsules_that_meet_a_box_are_found() -> None:
    rng = np.random.default_rng(11)
    answers = []
    for _ in range(400):
        ends = rng.uniform(-0.3, 0.3, (1, 1, 1, 2, 3))
        radius = np.array([rng.uniform(0.02, 0.1)])
        low = rng.uniform(-0.2, 0.1, (1, 3))
        high = low + rng.uniform(0.01, 0.2, (1, 3))
        hit = np.empty(1, dtype=np.bool_)
        cup_kernels.meets_box(ends, radius, low, high, 12, hit)
        t = np.linspace(0, 1, 2001)[:, None]
        axis = ends[0, 0, 0, 0] + t * (ends[0, 0, 0, 1] - ends[0, 0, 0, 0])
        gaps = np.linalg.norm(np.maximum(np.maximum(low - axis, axis - high), 0), axis=1)
        length = np.linalg.norm(ends[0, 0, 0, 1] - ends[0, 0, 0, 0])
        if gaps.min() < radius[0]:
            assert hit[0]
        elif gaps.min() > radius[0] + length / 24 + 1e-3:
            assert not hit[0]
        answers.append(bool(hit[0]))
    assert 0.2 < np.mean(answers) < 0.8


# --- accepted paths against exact geometry -------------------------------------------------------


def _bvh(item: Item) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(item.vertices), len(item.faces))
    model.addSubModel(np.asarray(item.vertices), np.asarray(item.faces))
    model.endModel()
    return model


def _meet(a: fcl.CollisionObject, b: fcl.CollisionObject) -> bool:
    return fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()) > 0


def _walls(container: Container, clearance: float = 2e-5) -> list[fcl.CollisionObject]:
    """Four walls and a floor, 2 cm thick, ``clearance`` outside the inner size."""
    (x, y, z), t = container.size, 0.02
    e = t + clearance
    solids = [
        ((t, y + 2 * e, z), (-clearance - t / 2, y / 2, z / 2)),
        ((t, y + 2 * e, z), (x + clearance + t / 2, y / 2, z / 2)),
        ((x + 2 * e, t, z), (x / 2, -clearance - t / 2, z / 2)),
        ((x + 2 * e, t, z), (x / 2, y + clearance + t / 2, z / 2)),
        ((x + 2 * e, y + 2 * e, t), (x / 2, y / 2, -clearance - t / 2)),
    ]
    return [fcl.CollisionObject(fcl.Box(*size), fcl.Transform(np.array(at))) for size, at in solids]


def _round_body(start, end, radius: float, capsule: bool) -> fcl.CollisionObject:
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    rotation = np.column_stack([side, np.cross(axis, side), axis])
    length = float(np.linalg.norm(end - start))
    shape = fcl.Capsule(radius, length) if capsule else fcl.Cylinder(radius, length)
    return fcl.CollisionObject(shape, fcl.Transform(rotation, (start + end) / 2))


def _robot(cell: Cell, q: np.ndarray) -> list[fcl.CollisionObject]:
    """Every primitive of the arm at one waypoint, container frame; the gripper, the last, 20 µm slimmer."""
    frames = TX90.link_frames(q)
    bodies = []
    for k, p in enumerate(TX90.shapes.primitives):
        frame = frames[p.link]
        start, end = (frame[:3, :3] @ np.array(e) + frame[:3, 3] for e in (p.start, p.end))
        start, end = cell.to_container(start), cell.to_container(end)
        radius = p.radius
        if k == TX90.shapes.gripper:
            end, radius = end + np.array([0, 0, 2e-5]), radius - 2e-5
        bodies.append(_round_body(start, end, radius, p.capsule))
    return bodies


@dataclass
class Placed:
    item: Item
    oriented: OrientedItem
    corner: np.ndarray
    mesh: fcl.CollisionObject

    @classmethod
    def at(cls, item: Item, oriented: OrientedItem, corner: np.ndarray) -> Placed:
        move = fcl.Transform(oriented.rotation, oriented.offset + corner)
        return cls(item, oriented, corner, fcl.CollisionObject(_bvh(item), move))

    def posed(self, lift: float = 0.0) -> Posed:
        position = self.oriented.offset + self.corner + np.array([0.0, 0.0, lift])
        return Posed(solid_of(self.item), Pose(self.oriented.rotation, position))


def assert_path_is_free(
    cell: Cell, pile: list[Placed], new: Placed, found: ManipulationResult, every: int
) -> None:
    """From the release upwards, at every ``every``-th waypoint."""
    walls = _walls(cell.container)
    for lip, q in zip(found.lip_heights[-2::-every], found.joints[-2::-every], strict=True):
        lift = lip - (new.corner + found.grasp.point)[2]
        held = Placed.at(new.item, new.oriented, new.corner + np.array([0.0, 0.0, lift]))
        for obstacle in walls:
            assert not _meet(held.mesh, obstacle)
        for other in pile:
            assert overlap_depth(new.posed(lift), other.posed()) == 0.0
        for k, part in enumerate(_robot(cell, q)):
            assert not _meet(part, held.mesh), (k, lift)
            for obstacle in [*walls, *(p.mesh for p in pile)]:
                assert not _meet(part, obstacle), (k, lift)


def random_pile(meshes: list[Item], seed: int, rule: str, every: int) -> tuple[int, int]:
    """Fill a container at random; every accepted path must be free, every refusal by the gripper earned."""
    rng = np.random.default_rng(seed)
    cell = default_cell().with_container(PAPER)
    checker = ManipulationChecker(cell)
    surface, pile = ContainerMap.empty(PAPER, CELL), []
    accepted = refused = 0
    drawn = [meshes[k] for k in rng.choice(len(meshes), 8)]
    if rule == "anywhere":
        # Thinner than the gripper: it reaches over the item's sides, to what is beside it.
        drawn = drawn[:4] + [box(*size, name="rod") for size in rng.uniform(0.008, [0.02, 0.1, 0.04], (8, 3))]
    for item in drawn:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn = turn * np.sign(np.linalg.det(turn)) if rng.random() < 0.3 else np.eye(3)
        oriented = oriented_of(item, yaw_rotation(rng.uniform(0, 6.28)) @ turn)
        candidates = grid_search(surface, [oriented], STEP)
        if not len(candidates):
            continue
        # Crowded corners and what lies deep are where the gripper is in trouble.
        k = int(rng.choice(np.argsort(candidates.z + candidates.xy_sum)[:200]))
        ix, iy, z = int(candidates.ix[k]), int(candidates.iy[k]), float(candidates.z[k])
        corner = np.array([ix * CELL, iy * CELL, z])
        spots = [grasp_at(oriented, *rng.uniform(0, oriented.extents[:2])) for _ in range(2)]
        grasps = [g for g in spots if np.isfinite(g.point[2]) and g.point[2] > 0]
        if rule == "seal":
            grasps = list(generate_grasps(oriented))
        new = Placed.at(item, oriented, corner)
        for grasp in grasps:
            found = checker.check(oriented, corner, surface, [grasp])
            if found.feasible:
                assert_path_is_free(cell, pile, new, found, every)
                accepted += 1
            elif found.reason == "gripper-hits-item":
                _assert_gripper_meets(pile, corner + grasp.point + np.array([0, 0, 0.01]))
                refused += 1
        surface = surface.with_item(oriented, ix, iy, z)
        pile.append(new)
    return accepted, refused


def _assert_gripper_meets(pile: list[Placed], lip: np.ndarray) -> None:
    """A tube wider by one cell's diagonal does meet an item: the maps refuse no more than that."""
    start = lip - np.array([0, 0, 2 * HEIGHT_QUANTUM])
    wide = TX90.gripper.radius + CELL * np.sqrt(2)
    tube = _round_body(start, start + np.array([0, 0, TX90.gripper.length]), wide, capsule=False)
    assert any(_meet(tube, p.mesh) for p in pile)


@pytest.fixture(scope="module")
def meshes() -> list[Item]:
    catalogue = open_catalogue("builtin")
    return [catalogue.item(name) for name in catalogue.names[::3]]


@pytest.mark.parametrize("rule", ["seal", "anywhere"])
def test_accepted_paths_are_free_of_exact_collision(meshes: list[Item], rule: str) -> None:
    counts = np.sum([random_pile(meshes, seed, rule, every=5) for seed in range(4)], axis=0)
    assert counts[0] > 25
    assert rule == "seal" or counts[1] > 0


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["seal", "anywhere"])
def test_many_accepted_paths_are_free_of_exact_collision(meshes: list[Item], rule: str) -> None:
    counts = np.sum([random_pile(meshes, seed, rule, every=2) for seed in range(100, 116)], axis=0)
    assert counts[0] > 150


# --- cases ----------------------------------------------------------------------------------------


def empty(container: Container = PAPER) -> ContainerMap:
    return ContainerMap.empty(container, CELL)


def with_box(surface: ContainerMap, size, at, z: float = 0.0) -> ContainerMap:
    return surface.with_item(oriented_of(box(*size)), round(at[0] / CELL), round(at[1] / CELL), z)


def check(item: OrientedItem, corner, surface=None, grasps=None, cell=None) -> ManipulationResult:
    surface = empty() if surface is None else surface
    checker = ManipulationChecker(default_cell().with_container(surface.container) if cell is None else cell)
    grasps = generate_grasps(item) if grasps is None else grasps
    return checker.check(item, np.array(corner, dtype=float), surface, grasps)


def test_a_box_in_a_corner_is_feasible() -> None:
    item = oriented_of(box(0.06, 0.06, 0.04))
    for x in (0.0, 0.26):
        for y in (0.0, 0.26):
            found = check(item, (x, y, 0.0))
            assert found.feasible
            assert found.grasp.kind == "centre"


def test_no_flat_spot_is_no_grasp() -> None:
    assert check(oriented_of(box(0.01, 0.01, 0.05)), (0.1, 0.1, 0.0)).reason == "no-grasp"


def test_a_thin_rod_at_the_wall_puts_the_gripper_into_the_wall() -> None:
    rod = oriented_of(box(0.01, 0.01, 0.10))
    assumed = generate_grasps(rod, rule="paper")
    assert check(rod, (0.0, 0.1, 0.0), grasps=assumed).reason == "gripper-hits-wall"
    assert check(rod, (0.1, 0.31, 0.0), grasps=assumed).reason == "gripper-hits-wall"
    assert check(rod, (0.006, 0.1, 0.0), grasps=assumed).feasible
    # Released above the rim, the gripper never goes below it.
    assert check(rod, (0.0, 0.1, 0.195), grasps=assumed).feasible


def test_a_narrow_hole_beside_a_tall_neighbour() -> None:
    rod = oriented_of(box(0.01, 0.01, 0.05))
    assumed = generate_grasps(rod, rule="paper")
    tall = with_box(empty(), (0.05, 0.05, 0.15), (0.1, 0.1))
    assert check(rod, (0.15, 0.12, 0.0), tall, assumed).reason == "gripper-hits-item"
    assert check(rod, (0.156, 0.12, 0.0), tall, assumed).feasible
    # 1 cm: the cup lets go above a neighbour that is up to 1 cm taller.
    for height, reason in ((0.06, None), (0.061, "gripper-hits-item")):
        low = with_box(empty(), (0.05, 0.05, height), (0.1, 0.1))
        assert check(rod, (0.15, 0.12, 0.0), low, assumed).reason == reason


def test_a_second_grasp_saves_what_the_first_cannot_reach() -> None:
    """At one end of the plank the gripper would hit the neighbour, at the other there is none."""
    plank = oriented_of(box(0.012, 0.2, 0.02))
    near, far = grasp_at(plank, 0.006, 0.02), grasp_at(plank, 0.006, 0.18)
    surface = with_box(empty(), (0.04, 0.06, 0.2), (0.1, 0.05))
    corner = (0.14, 0.05, 0.0)
    assert check(plank, corner, surface, [near]).reason == "gripper-hits-item"
    found = check(plank, corner, surface, [near, far])
    assert found.feasible
    assert found.grasp is far
    assert found.grasps_tried == 2


def test_a_cup_goes_into_a_cup() -> None:
    item = oriented_of(cup(0.045, 0.10))
    surface = empty().with_item(item, 50, 50, 0.0)
    z = lowest_at(surface.heights, item.bottom, 50, 50)
    assert 0.0 < z < 0.09  # nested, not on the rim
    found = check(item, (0.1, 0.1, z), surface)
    assert found.feasible
    assert found.grasp.point[2] < 0.01
    assert check(item, (0.1, 0.1, z - 1e-4), surface).reason == "held-item-blocked"


def test_what_is_not_inside_is_blocked() -> None:
    item = oriented_of(box(0.06, 0.06, 0.04))
    for corner in ((-0.002, 0.1, 0.0), (0.1, 0.262, 0.0), (0.1, 0.1, 0.262), (0.1, 0.1, -0.001)):
        assert check(item, corner).reason == "held-item-blocked"


def test_a_far_container_is_out_of_reach() -> None:
    item = oriented_of(ball(0.04))
    cell = Cell(default_cell(), PAPER, (1.2, -0.16, 0.0))
    assert check(item, (0.1, 0.1, 0.0), cell=cell).reason == "unreachable"


def test_a_container_deeper_than_the_gripper_is_refused_at_its_floor() -> None:
    deep = Container(0.32, 0.32, 0.36)
    item = oriented_of(box(0.06, 0.06, 0.02))
    assert check(item, (0.1, 0.1, 0.0), empty(deep)).reason == "link-collision"
    assert check(item, (0.1, 0.1, 0.2), empty(deep)).feasible


def test_the_flange_does_not_fit_into_a_deep_held_item() -> None:
    """Taken at its inner bottom, an item taller than the gripper is long would hold the flange."""
    tall = Container(0.32, 0.32, 0.05)
    shallow = oriented_of(box(0.06, 0.06, 0.04))
    deep = replace(shallow, extents=np.array([0.06, 0.06, 0.35]))
    checker = ManipulationChecker(default_cell().with_container(tall))
    (grasp, *_) = generate_grasps(shallow)
    lips = np.array([0.2, 0.1])
    corner = np.array([0.1, 0.1, 0.0])
    assert isinstance(checker._joints(shallow, corner, grasp, lips), np.ndarray)
    assert checker._joints(deep, corner, grasp, lips) == "link-collision"


def test_questions_that_make_no_sense_are_refused() -> None:
    item = oriented_of(box(0.06, 0.06, 0.04))
    with pytest.raises(ValueError, match="finite"):
        check(item, (np.nan, 0.1, 0.0))
    with pytest.raises(ValueError, match="robot cell"):
        check(item, (0.1, 0.1, 0.0), cell=default_cell().with_container(Container(0.3, 0.3, 0.3)))
    with pytest.raises(ValueError, match="cells are"):
        check(orient_item(box(0.06, 0.06, 0.04), np.eye(3), cell_size=0.004), (0.1, 0.1, 0.0))
    with pytest.raises(ValueError, match="spacing is"):
        ManipulationChecker(default_cell().with_container(PAPER), spacing=0.0)
