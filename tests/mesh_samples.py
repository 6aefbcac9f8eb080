"""Small mesh files for tests, written without the readers under test, and how the product reads them."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from packenv.geometry.mesh_files import file_bytes, parsed_mesh
from packenv.geometry.meshes import LoadedMesh, check_unit, solid_mesh


def load_mesh(path: Path, *, unit: str | None = None) -> LoadedMesh:
    """Read, check and mend a mesh file, nothing cached."""
    check_unit(unit)
    return solid_mesh(Path(path), parsed_mesh(Path(path), file_bytes(Path(path))), unit)


def block(
    x: float = 0.1, y: float = 0.06, z: float = 0.04, at: tuple[float, float, float] = (0, 0, 0)
) -> trimesh.Trimesh:
    """A box of 12 faces about a point."""
    mesh = trimesh.creation.box(extents=(x, y, z))
    mesh.apply_translation(at)
    return mesh


def ball(
    radius: float = 0.05, at: tuple[float, float, float] = (0, 0, 0), subdivisions: int = 3
) -> trimesh.Trimesh:
    """A sphere about a point."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    mesh.apply_translation(at)
    return mesh


def cup() -> trimesh.Trimesh:
    """A thick-walled open cup: not convex, one body."""
    profile = [(0, 0), (0.03, 0), (0.04, 0.1), (0.035, 0.1), (0.027, 0.005), (0, 0.005)]
    return trimesh.creation.revolve(np.array(profile, dtype=float), sections=32)


def arrays(*meshes: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of several meshes in one, nothing merged."""
    vertices, faces, base = [], [], 0
    for mesh in meshes:
        vertices.append(np.array(mesh.vertices))
        faces.append(np.array(mesh.faces) + base)
        base += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Text PLY with every digit."""
    lines = [
        "ply", "format ascii 1.0", f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header",
        *(" ".join(repr(float(x)) for x in v) for v in vertices),
        *(f"{len(f)} " + " ".join(str(int(i)) for i in f) for f in faces),
    ]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def write_mesh(path: Path, *meshes: trimesh.Trimesh) -> Path:
    """Text PLY of several meshes in one."""
    return write_ply(path, *arrays(*meshes))


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Plain OBJ."""
    text = [" ".join(["v", *(repr(float(x)) for x in v)]) for v in vertices]
    text += [" ".join(["f", *(str(int(i) + 1) for i in f)]) for f in faces]
    path.write_text("\n".join(text) + "\n")
    return path


def object_3mf(number: int, mesh: trimesh.Trimesh) -> str:
    points = "".join(
        f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in np.array(mesh.vertices).tolist()
    )
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.array(mesh.faces).tolist())
    mesh_text = f"<vertices>{points}</vertices><triangles>{corners}</triangles>"
    return f'<object id="{number}"><mesh>{mesh_text}</mesh></object>'


def model_3mf(unit: str, objects: Sequence[str], items: Sequence[str]) -> str:
    return (
        f'<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" unit="{unit}">'
        f"<resources>{''.join(objects)}</resources><build>{''.join(items)}</build></model>"
    )


def write_3mf(path: Path, model: str, **others: str) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {"3D/3dmodel.model": model, **others}.items():
            archive.writestr(name, text)
    return path


def write_three(folder: Path) -> None:
    """Meshes of three items that fit a small box: brick.ply, book.ply and can.ply."""
    trimesh.creation.box((0.08, 0.06, 0.04)).export(folder / "brick.ply")
    trimesh.creation.box((0.10, 0.08, 0.05)).export(folder / "book.ply")
    trimesh.creation.cylinder(0.02, 0.06, sections=24).export(folder / "can.ply")
