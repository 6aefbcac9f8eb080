"""A mesh of several closed bodies: duplicates, inverted ones, cavities, overlaps."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.mass import area, signed_volume
from packenv.geometry.topology import compact
from packenv.types import BoolArray, FloatArray, IntArray

MAX_BODIES = 2_000
"""Bodies that a mesh may have."""

THIN = 1e-6
"""A body whose volume over area is below this share of the item's diagonal has no thickness."""

SPECK = 0.01
"""A body without thickness below this share of the diagonal is a speck, and dropped."""

TOUCHING = 1e-6
"""Bodies overlap when their union has less than the sum of their volumes by more than this share."""


@dataclass(frozen=True, eq=False)
class _Body:
    vertices: FloatArray
    faces: IntArray
    volume: float

    @property
    def low(self) -> FloatArray:
        low: FloatArray = self.vertices.min(axis=0)
        return low

    @property
    def high(self) -> FloatArray:
        high: FloatArray = self.vertices.max(axis=0)
        return high

    @property
    def across(self) -> float:
        return float(np.linalg.norm(self.high - self.low))

    def turned(self) -> _Body:
        return replace(self, faces=self.faces[:, ::-1], volume=-self.volume)


def settle_bodies(
    path: Path, vertices: FloatArray, faces: IntArray, labels: IntArray
) -> tuple[FloatArray, IntArray, tuple[str, ...], tuple[str, ...]]:
    """Make one solid of several closed bodies.

    Args:
        path: the mesh file, named in messages.
        vertices: (n, 3), m.
        faces: (m, 3), every body closed and wound alike.
        labels: (m,) body of each face.

    Returns:
        (vertices, faces, repairs, notes). Where nothing had to be repaired, the arrays are the given ones.

    Raises:
        MeshError: too many bodies, one without thickness, or an overlap that cannot be united.
    """
    bodies = _split(path, vertices, faces, labels)
    repairs: list[str] = []
    notes: list[str] = []
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    for step in (_without_specks, _without_duplicates):
        bodies = step(path, bodies, diagonal, repairs)
    solids, cavities = _outward(bodies, repairs)
    united = _united(path, solids, cavities, repairs)
    if united is None and not repairs:
        result = (vertices, faces)
    else:
        result = united or _together([*solids, *(c for group in cavities for c in group)])
    n_cavities = sum(len(group) for group in cavities)
    if n_cavities and united is None:
        notes.append(f"{_count(n_cavities, 'closed cavity', 'closed cavities')} inside")
    if len(solids) > 1 and united is None:
        notes.append(f"{len(solids)} disjoint bodies: taken as one rigid item")
    return (*result, tuple(repairs), tuple(notes))


def _split(path: Path, vertices: FloatArray, faces: IntArray, labels: IntArray) -> list[_Body]:
    n = int(labels.max()) + 1
    if n > MAX_BODIES:
        raise MeshError(
            f"{path}: {n:,} separate bodies, the limit is {MAX_BODIES:,}; is it a scan with loose dust?"
        )
    order = np.argsort(labels, kind="stable")
    cuts = np.searchsorted(labels[order], np.arange(1, n))
    bodies = []
    for group in np.split(order, cuts):
        own_vertices, own_faces = compact(vertices, faces[group])
        bodies.append(_Body(own_vertices, own_faces, signed_volume(own_vertices, own_faces)))
    return bodies


def _without_specks(path: Path, bodies: list[_Body], diagonal: float, repairs: list[str]) -> list[_Body]:
    kept = []
    for body in bodies:
        if abs(body.volume) > THIN * diagonal * area(body.vertices, body.faces):
            kept.append(body)
        elif body.across > SPECK * diagonal:
            raise MeshError(
                f"{path}: one of its {len(bodies)} bodies is a sheet without thickness, "
                f"{body.across * 1000:.3g} mm across; give it a thickness or remove it"
            )
    if len(kept) < len(bodies):
        repairs.append(f"{_count(len(bodies) - len(kept), 'fragment', 'fragments')} without volume dropped")
    return kept


def _without_duplicates(path: Path, bodies: list[_Body], diagonal: float, repairs: list[str]) -> list[_Body]:
    seen: dict[bytes, _Body] = {}
    for body in bodies:
        seen.setdefault(_shape_key(body, 1e-7 * diagonal), body)
    if len(seen) < len(bodies):
        repairs.append(f"{_count(len(bodies) - len(seen), 'duplicate shell', 'duplicate shells')} dropped")
    return list(seen.values())


def _shape_key(body: _Body, grid: float) -> bytes:
    """The set of a body's triangles as a hash: sequence, first corner and winding play no part."""
    points = np.round(body.vertices / grid).astype(np.int64)
    _, number = np.unique(points, axis=0, return_inverse=True)
    triangles = np.sort(number.reshape(-1)[body.faces], axis=1)
    triangles = triangles[np.lexsort(triangles.T)]
    unique = np.unique(points, axis=0)
    return hashlib.sha256(unique.tobytes() + b"|" + triangles.tobytes()).digest()


def _outward(bodies: list[_Body], repairs: list[str]) -> tuple[list[_Body], list[list[_Body]]]:
    """Turn inverted bodies; what faces inward inside another body is that body's cavity.

    Returns:
        (solids, for each solid the cavities in it), every solid's volume positive.
    """
    order = sorted(range(len(bodies)), key=lambda k: -abs(bodies[k].volume))
    settled: list[tuple[_Body, bool, int | None]] = []
    inverted = 0
    solids: list[_Body] = []
    cavities: list[list[_Body]] = []
    for k in order:
        body = bodies[k]
        # The smallest body around it decides: in a file that is inside out, cavities are so with it.
        around = [s for s in settled if s[2] is not None and _inside(body, s[0])]
        container = around[-1] if around else None
        turn = body.volume < 0 if container is None else container[1]
        if turn:
            body = body.turned()
            inverted += 1
        if container is not None and body.volume < 0 and container[2] is not None:
            cavities[container[2]].append(body)
            settled.append((body, turn, None))
            continue
        if body.volume < 0:
            body = body.turned()
            inverted += 1
        settled.append((body, turn, len(solids)))
        solids.append(body)
        cavities.append([])
    if inverted:
        repairs.append(f"{_count(inverted, 'body', 'bodies')} turned inside out (the faces pointed inward)")
    return solids, cavities


def _inside(body: _Body, other: _Body) -> bool:
    """Whether a body lies within another's outer surface, judged by up to 24 of its vertices."""
    if (body.low < other.low).any() or (body.high > other.high).any():
        return False
    picked = body.vertices[np.unique(np.linspace(0, len(body.vertices) - 1, 24).astype(int))]
    return bool(_winding(picked, other).all())


def _winding(points: FloatArray, body: _Body) -> BoolArray:
    """(p,) True where a closed body winds about the point (Van Oosterom and Strackee 1983)."""
    inside = np.empty(len(points), dtype=bool)
    for k, point in enumerate(points):
        a, b, c = (body.vertices[body.faces[:, j]] - point for j in range(3))
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        over = np.einsum("ij,ij->i", a, np.cross(b, c))
        under = la * lb * lc
        under += np.einsum("ij,ij->i", a, b) * lc
        under += np.einsum("ij,ij->i", b, c) * la
        under += np.einsum("ij,ij->i", c, a) * lb
        inside[k] = abs(np.arctan2(over, under).sum()) > np.pi
    return inside


def _united(
    path: Path, solids: list[_Body], cavities: list[list[_Body]], repairs: list[str]
) -> tuple[FloatArray, IntArray] | None:
    """The union of all solids where some overlap, else None."""
    if len(solids) < 2 or not _boxes_meet(solids):
        return None
    import manifold3d

    shapes = []
    for solid, inner in zip(solids, cavities, strict=True):
        vertices, faces = _together([solid, *inner])
        shape = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
        if shape.status() != manifold3d.Error.NoError:
            raise MeshError(
                f"{path}: two of its bodies may overlap, and one has edges that more than two faces share; "
                "unite the bodies in a modelling program"
            )
        shapes.append(shape)
    union = manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add)
    total = sum(shape.volume() for shape in shapes)
    if total - union.volume() <= TOUCHING * total:
        return None
    mesh = union.to_mesh64()
    repairs.append(f"{len(solids)} overlapping bodies united")
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return vertices, np.array(mesh.tri_verts, dtype=np.int64)


def _boxes_meet(bodies: Sequence[_Body]) -> bool:
    low, high = np.array([b.low for b in bodies]), np.array([b.high for b in bodies])
    meet = (low[:, None] < high[None]).all(axis=2) & (low[None] < high[:, None]).all(axis=2)
    return bool(np.triu(meet, 1).any())


def _together(bodies: Sequence[_Body]) -> tuple[FloatArray, IntArray]:
    offsets = np.cumsum([0, *(len(b.vertices) for b in bodies)])
    faces = [body.faces + offset for body, offset in zip(bodies, offsets[:-1], strict=True)]
    return np.concatenate([b.vertices for b in bodies]), np.concatenate(faces)


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"
