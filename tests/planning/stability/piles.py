"""Piles whose contacts are known without any mesh: analytic ones, and random ones in any number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from packenv.types import Contacts

DOWN = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True, eq=False)
class Pile:
    """A question for the force balance."""

    contacts: Contacts
    masses: np.ndarray
    coms: np.ndarray
    gravity: np.ndarray

    @property
    def args(self) -> tuple[Contacts, np.ndarray, np.ndarray]:
        """What every check takes first."""
        return self.contacts, self.masses, self.coms


def pile(points, normals, first, second, masses, coms, gravity=DOWN) -> Pile:
    """Build a pile from plain lists."""
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    normals = np.asarray(normals, dtype=float).reshape(-1, 3)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    contacts = Contacts(
        points=points,
        normals=normals,
        first=np.asarray(first, dtype=np.int64).reshape(-1),
        second=np.asarray(second, dtype=np.int64).reshape(-1),
        gaps=np.zeros(len(points)),
    )
    return Pile(
        contacts,
        np.asarray(masses, dtype=float).reshape(-1),
        np.asarray(coms, dtype=float).reshape(-1, 3),
        np.asarray(gravity, dtype=float),
    )


def turned(p: Pile, rotation: np.ndarray, shift=(0.0, 0.0, 0.0)) -> Pile:
    """The same pile and its gravity, seen in another frame."""
    c = p.contacts
    return Pile(
        Contacts(c.points @ rotation.T + shift, c.normals @ rotation.T, c.first, c.second, c.gaps),
        p.masses,
        p.coms @ rotation.T + shift,
        rotation @ p.gravity,
    )


def rectangle(x0: float, x1: float, y0: float, y1: float, z: float) -> np.ndarray:
    """(4, 3) corners of a level rectangle."""
    return np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1)])


def box_on_floor(com=(0.05, 0.05, 0.05), size: float = 0.1) -> Pile:
    """A cube that stands on the floor, its centre of mass where we say."""
    return pile(rectangle(0, size, 0, size, 0), [[0, 0, 1]] * 4, [0] * 4, [1] * 4, [1.0], [com])


def overhang(beyond: float) -> Pile:
    """A box on a ledge: its centre of mass is ``beyond`` the ledge's edge (x = 0), m."""
    p = rectangle(-0.05, 0.0, -0.05, 0.05, 0.1)
    return pile(p, [[0, 0, 1]] * 4, [0] * 4, [1] * 4, [0.5], [[beyond, 0.0, 0.15]])


def on_ramp(slope_deg: float, yaw_deg: float) -> Pile:
    """A flat box on a plane of the container that rises by ``slope_deg`` towards ``yaw_deg``."""
    flat = pile(rectangle(-0.1, 0.1, -0.1, 0.1, 0), [[0, 0, 1]] * 4, [0] * 4, [1] * 4, [1.0], [[0, 0, 0.01]])
    turn = Rotation.from_euler("yz", [-slope_deg, yaw_deg], degrees=True).as_matrix()
    tilted = turned(flat, turn)
    return Pile(*tilted.args, DOWN)


def plank(angle_deg: float, com_fraction: float = 0.5, length: float = 0.3) -> Pile:
    """A thin plank (2 cm wide) that leans on the wall x = 0, its foot on the floor.

    The floor pushes up, the wall along x.
    """
    a = np.radians(angle_deg)
    foot, head = np.array([length * np.cos(a), 0.0, 0.0]), np.array([0.0, 0.0, length * np.sin(a)])
    side = np.array([0.0, 0.01, 0.0])
    return pile(
        [foot - side, foot + side, head - side, head + side],
        [[0, 0, 1]] * 2 + [[1, 0, 0]] * 2,
        [0] * 4,
        [1] * 4,
        [0.7],
        [foot + com_fraction * (head - foot)],
    )


def plank_needs(angle_deg: float, com_fraction: float = 0.5) -> float:
    """Friction that the leaning plank needs where floor and wall have the same, in closed form.

    Both contacts on the edge of slipping: N = mg / (1 + μ²), wall force μ N; moments about the foot give
    c cos a = sin a · μ / (1 + μ²) + cos a · μ² / (1 + μ²), so (1 − c) μ² + tan a · μ − c = 0.
    """
    t, c = np.tan(np.radians(angle_deg)), com_fraction
    return float((-t + np.sqrt(t * t + 4.0 * (1.0 - c) * c)) / (2.0 * (1.0 - c)))


def arch(thickness: float, half_angle_deg: float = 80.0, stones: int = 3) -> Pile:
    """Voussoirs of equal angle on two springers (the container): a circular arch of mean radius 0.1 m.

    Joints are radial, and carry four points each.
    """
    radius, depth = 0.1, 0.03
    joints = np.radians(np.linspace(-half_angle_deg, half_angle_deg, stones + 1))
    points, normals, first, second = [], [], [], []
    for j, angle in enumerate(joints):
        out = np.array([np.sin(angle), 0.0, np.cos(angle)])
        along = np.array([np.cos(angle), 0.0, -np.sin(angle)])
        below, above = j, j + 1  # stones are numbered 1 to n from the left
        for r in (radius - thickness / 2, radius + thickness / 2):
            for y in (-depth / 2, depth / 2):
                points.append(r * out + [0, y, 0])
                if above <= stones:
                    normals.append(along)
                    first.append(below)
                    second.append(above)
                else:
                    normals.append(-along)
                    first.append(0)
                    second.append(below)
    middles = (joints[:-1] + joints[1:]) / 2
    spread = np.diff(joints) / 2
    inner, outer = radius - thickness / 2, radius + thickness / 2
    # Centroid of a sector of a ring.
    reach = 2 / 3 * (outer**3 - inner**3) / (outer**2 - inner**2) * np.sin(spread) / spread
    coms = np.column_stack([reach * np.sin(middles), np.zeros(stones), reach * np.cos(middles)])
    return pile(points, normals, first, second, [1.0] * stones, coms)


def ball_on_floor(radius: float = 0.04) -> Pile:
    """One contact straight below the centre."""
    return pile([[0.1, 0.1, 0.0]], [[0, 0, 1]], [0], [1], [0.2], [[0.1, 0.1, radius]])


def ball_in_corner(radius: float = 0.04) -> Pile:
    """A ball that touches the floor and two walls."""
    c = np.full(3, radius)
    points = [c - radius * e for e in np.eye(3)]
    return pile(points, np.eye(3), [0] * 3, [1] * 3, [0.2], [c])


def arch_needs(half_angle_deg: float = 80.0, stones: int = 3) -> float:
    """Friction that the arch needs as its thickness goes to zero, in closed form (three stones).

    The thrust passes through the four joints. With W a stone's weight, the inner joints carry W / 2 upwards
    and the springers 3 W / 2; moments of the left stone about its springer give the horizontal thrust H. At
    each joint friction is the tangent of the angle between thrust and the joint's normal.
    """
    assert stones == 3
    joints = np.radians([-half_angle_deg, -half_angle_deg / 3])
    (x0, x1), (z0, z1) = np.sin(joints), np.cos(joints)
    spread = (joints[1] - joints[0]) / 2
    xc = np.sin(joints).mean() / np.cos(spread) * np.sin(spread) / spread
    h = (0.5 * (x1 - x0) + (xc - x0)) / (z1 - z0)
    thrust = np.arctan2([1.5, 0.5], h)
    return float(np.tan(np.abs(thrust + joints)).max())


def bridge(key: bool) -> Pile:
    """Two halves of a bridge, each of which would topple inwards, and the key wedged between them.

    Items 1 and 2 are the halves, on piers that belong to the container; item 3 is the key. The key's thrust
    keeps the halves from toppling, and friction on the piers takes it up.
    """
    reach, pier = 0.06, 0.10
    points, normals, first, second = [], [], [], []

    def face(x: float, heights: tuple[float, float], normal: list[float], by: int, on: int) -> None:
        for z in heights:
            for y in (-0.02, 0.02):
                points.append([x, y, z])
                normals.append(normal)
                first.append(by)
                second.append(on)

    for side, item in ((-1.0, 1), (1.0, 2)):
        for x in (reach, pier):
            for y in (-0.02, 0.02):
                points.append([side * x, y, 0.1])
                normals.append([0.0, 0.0, 1.0])
                first.append(0)
                second.append(item)
        if key:
            face(side * 0.01, (0.105, 0.135), [-side, 0.0, 0.0], item, 3)
    masses = [1.0, 1.0, 0.05][: 3 if key else 2]
    coms = [[-0.052, 0, 0.12], [0.052, 0, 0.12], [0, 0, 0.12]][: len(masses)]
    return pile(points, normals, first, second, masses, coms)


def stack_of_boxes(rng: np.random.Generator, n: int, spread: float, per_edge: int = 2) -> Pile:
    """Boxes dropped level onto each other at random; ``per_edge``² points a contact patch.

    Args:
        rng: source of everything.
        n: boxes.
        per_edge: points along each side of a contact patch.
        spread: half-width of where boxes are dropped, m; wide piles lie on the floor, narrow ones tower.
    """
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    points, normals, first, second = [], [], [], []
    for body in range(1, n + 1):
        size = rng.uniform(0.03, 0.12, 3)
        low = np.append(rng.uniform(-spread, spread, 2), 0.0) - np.append(size[:2] / 2, 0.0)
        below = [(i, b) for i, b in enumerate(boxes, 1) if ((low < b[1]) & (low + size > b[0]))[:2].all()]
        low[2] = max((b[1][2] for _, b in below), default=0.0)
        supports = [(i, b) for i, b in below if abs(b[1][2] - low[2]) < 1e-9]
        if low[2] == 0.0:
            supports = [(0, (low - 1.0, low + size + 1.0))]
        for i, (b_low, b_high) in supports:
            lo, hi = np.maximum(low, b_low)[:2], np.minimum(low + size, b_high)[:2]
            grid = np.stack(
                np.meshgrid(*[np.linspace(lo[a], hi[a], per_edge) for a in (0, 1)], indexing="ij"), axis=-1
            )
            patch = np.column_stack([grid.reshape(-1, 2), np.full(per_edge**2, low[2])])
            points.extend(patch)
            normals.extend([[0.0, 0.0, 1.0]] * len(patch))
            first.extend([i] * len(patch))
            second.extend([body] * len(patch))
        boxes.append((low, low + size))
    masses = [1000.0 * rng.uniform(0.1, 1.0) * float(np.prod(hi - lo)) for lo, hi in boxes]
    coms = [(lo + hi) / 2 + rng.uniform(-0.1, 0.1, 3) * (hi - lo) for lo, hi in boxes]
    return pile(points, normals, first, second, masses, coms)


def rubble(rng: np.random.Generator, n: int, contacts: int, slant: float, near: int | None = None) -> Pile:
    """Bodies that touch lower ones or the container at random points under random slants.

    Args:
        rng: source of everything.
        n: bodies.
        contacts: of each body, on average.
        slant: size of the horizontal part of the normals; 0 is level.
        near: bodies touch the container and no other than the so many before them; all where None.
    """
    points, normals, first, second = [], [], [], []
    coms = np.column_stack([rng.uniform(-0.05, 0.05, (n, 2)), 0.05 + 0.05 * np.arange(n)])
    for body in range(1, n + 1):
        for _ in range(int(rng.integers(max(1, contacts - 2), contacts + 3))):
            offset = np.append(rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.05, 0.0))
            points.append(coms[body - 1] + offset)
            normals.append(np.append(slant * rng.normal(size=2) - 0.5 * slant * offset[:2] / 0.05, 1.0))
            lower = int(rng.integers(0, body if near is None else min(body, near + 1)))
            first.append(lower if near is None else max(body - near - 1, 0) + lower if lower else 0)
            second.append(body)
    return pile(points, normals, first, second, rng.uniform(0.01, 2.0, n), coms)


def random_pile(rng: np.random.Generator) -> Pile:
    """A random pile of one of the kinds, in a random frame; about half of them stand."""
    n = int(rng.integers(1, 7))
    kind = rng.integers(0, 2)
    if kind == 0:
        p = stack_of_boxes(rng, n, spread=float(rng.uniform(0.02, 0.12)))
    else:
        p = rubble(rng, n, contacts=int(rng.integers(4, 9)), slant=float(rng.uniform(0.1, 1.0)))
    return turned(p, Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())
