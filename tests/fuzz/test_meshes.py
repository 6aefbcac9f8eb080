"""Damaged mesh files of every format: a closed surface with mass, or one line."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest
import trimesh

from packenv.geometry.mesh_files import EXTENSIONS
from packenv.geometry.meshes import make_item
from packenv.geometry.topology import is_solid
from tests.conftest import REPO
from tests.fuzz.mutations import damaged
from tests.fuzz.runner import MakeOne, Reads, check, fuzz
from tests.mesh_samples import (
    arrays,
    ball,
    block,
    cup,
    load_mesh,
    model_3mf,
    object_3mf,
    write_3mf,
    write_mesh,
    write_obj,
)

IDENTITY = "1 0 0 0 1 0 0 0 1"


def samples(folder: Path) -> list[Path]:
    """Sound mesh files of every format that is read, small ones for speed, written by trimesh or by hand."""
    shapes = {"block": block(), "ball": ball(subdivisions=1), "cup": cup()}
    for name, mesh in shapes.items():
        for kind in EXTENSIONS:
            # A 3MF of trimesh is in millimetres.
            written = mesh.copy().apply_scale(1000) if kind == ".3mf" else mesh
            (folder / f"{name}{kind}").write_bytes(_bytes(written.export(file_type=kind[1:])))
        (folder / f"{name}_text.stl").write_bytes(_bytes(mesh.export(file_type="stl_ascii")))
        (folder / f"{name}_text.ply").write_bytes(_bytes(mesh.export(file_type="ply", encoding="ascii")))
        write_obj(folder / f"{name}_plain.obj", *arrays(mesh))
    two = (block(), block(at=(0.04, 0.01, 0.02)))
    write_mesh(folder / "two.ply", *two)
    (folder / "corners.obj").write_text(_polygons())
    scene = trimesh.Scene(list(two))
    scene.graph.update("high", matrix=trimesh.transformations.scale_matrix(0.5), geometry="geometry_0")
    (folder / "scene.glb").write_bytes(_bytes(scene.export(file_type="glb")))
    parts = [object_3mf(k, mesh) for k, mesh in enumerate(two, 1)]
    places = f'<component objectid="1"/><component objectid="2" transform="{IDENTITY} 0.01 0 0"/>'
    held = f'<object id="3"><components>{places}</components></object>'
    model = model_3mf("meter", [*parts, held], ['<item objectid="3"/>'])
    roles = '<config><object id="3"><part id="2" subtype="negative_part"/></object></config>'
    write_3mf(folder / "held.3mf", model, **{"Metadata/model_settings.config": roles})
    own = ("wood_block", "milk_carton", "sponge", "mug", "bowl")
    return [*sorted(folder.iterdir()), *(REPO / "assets" / "catalogue" / f"{name}.ply" for name in own)]


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _polygons() -> str:
    """A box of six rectangles, its corners counted from the end, with texture and normals."""
    corners = [(x, y, z) for x in (0, 0.1) for y in (0, 0.06) for z in (0, 0.04)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["mtllib none.mtl", "o box", *(f"v {x} {y} {z}" for x, y, z in corners), "vt 0 0", "vn 0 0 1"]
    lines += ["usemtl red", *("f " + " ".join(f"{k - 8}/1/1" for k in face) for face in faces)]
    return "\n".join(lines) + "\n"


def one_mesh(folder: Path) -> MakeOne:
    """How a damaged mesh file is made, and read."""
    (folder / "sound").mkdir()
    sound = [(path, path.read_bytes()) for path in samples(folder / "sound")]
    for path, _ in sound:
        _read(path, None)

    def one(rng: Random) -> tuple[str, Reads]:
        path, data = rng.choice(sound)
        unit = rng.choice((None, None, None, None, "cm", "in"))
        target = folder / f"damaged{path.suffix}"
        target.write_bytes(damaged(path.suffix, data, rng))
        return path.name, lambda: _read(target, unit)

    return one


def _read(path: Path, unit: str | None) -> None:
    """Read a mesh as an item is read; what comes back is a closed surface with mass."""
    mesh = load_mesh(path, unit=unit)
    assert is_solid(mesh.faces)[0]
    item = make_item("it", mesh, file=path.name, mass=None)
    assert np.isfinite(item.vertices).all()
    assert np.isfinite(item.inertia).all()
    assert 0 < item.mass < np.inf
    assert 0 < item.volume < np.inf


@pytest.mark.parametrize("count", [150, pytest.param(10_000, marks=pytest.mark.slow)])
def test_a_damaged_mesh_is_sound_or_one_line(count: int) -> None:
    check(fuzz(one_mesh, count, count), count, least_read=0.1)
