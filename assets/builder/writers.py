"""Files of the catalogue: binary PLY, OBJ with one group a part, objects.csv; the same bytes every time."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .union import Geometry, Solid

COLUMNS = (
    "name",
    "file",
    "parts_file",
    "category",
    "extents_x",
    "extents_y",
    "extents_z",
    "volume_m3",
    "hull_volume_m3",
    "convexity",
    "mass_kg",
    "source",
    "licence",
)


def ply_bytes(mesh: Solid) -> bytes:
    """Binary little-endian PLY with float64 vertices in metres."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(mesh.faces), dtype=[("n", "u1"), ("v", "<i4", (3,))])
    rows["n"] = 3
    rows["v"] = mesh.faces
    return header.encode("ascii") + mesh.vertices.astype("<f8").tobytes() + rows.tobytes()


def obj_bytes(parts: Sequence[Solid], name: str) -> bytes:
    """OBJ in metres, one ``o`` group a convex part; six decimals name its vertices exactly."""
    lines = [f"# {name}: convex parts, metres"]
    base = 1
    for number, part in enumerate(parts):
        lines.append(f"o part_{number:03d}")
        lines += ["v " + " ".join(_number(x) for x in vertex) for vertex in part.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in (part.faces + base).tolist()]
        base += len(part.vertices)
    return ("\n".join(lines) + "\n").encode("ascii")


def _number(value: float) -> str:
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def csv_bytes(rows: Sequence[dict[str, str]]) -> bytes:
    """The table of the catalogue."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue().encode("utf-8")


def write(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(data)
    partial.replace(path)


def row(geometry: Geometry, **text: str) -> dict[str, str]:
    """Figures of one item as the table spells them; ``text`` fills the other columns."""
    mesh = geometry.mesh
    volume = volume_of(mesh)
    hull = hull_volume_of(mesh)
    size = mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)
    figures = {
        "extents_x": f"{size[0]:.5f}",
        "extents_y": f"{size[1]:.5f}",
        "extents_z": f"{size[2]:.5f}",
        "volume_m3": f"{volume:.6e}",
        "hull_volume_m3": f"{hull:.6e}",
        "convexity": f"{volume / hull:.4f}",
    }
    return {column: (figures | text)[column] for column in COLUMNS}


def volume_of(mesh: Solid) -> float:
    """Volume of a closed mesh, m3, by the divergence theorem."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def area_of(mesh: Solid) -> float:
    """Surface area, m2."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def hull_volume_of(mesh: Solid) -> float:
    """Volume of the convex hull, m3."""
    import manifold3d

    return float(manifold3d.Manifold.hull_points(mesh.vertices * 1e6).volume()) / 1e18
