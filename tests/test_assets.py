"""Laws of our own catalogue: exact, convex by parts, plausible, and just what the script builds."""

from __future__ import annotations

import csv
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import manifold3d
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from tests.conftest import NO_BULLET

ASSETS = Path(__file__).resolve().parents[1] / "assets"
CATALOGUE = ASSETS / "catalogue"

#: Items made of flat faces, which need few vertices.
FLAT = {"cracker_box", "sugar_box", "pudding_box", "gelatin_box", "milk_carton"}
FLAT |= {"wood_block", "sponge", "foam_brick", "book", "puzzle_cube"}


@dataclass(frozen=True, eq=False)
class Loaded:
    """One item as it lies on disk: the table's row, the mesh as written, the parts as (vertices, faces)."""

    row: dict[str, str]
    mesh: trimesh.Trimesh
    parts: list[tuple[np.ndarray, np.ndarray]]


def read_rows() -> dict[str, dict[str, str]]:
    with (CATALOGUE / "objects.csv").open(encoding="utf-8", newline="") as stream:
        return {row["name"]: row for row in csv.DictReader(stream)}


def read_parts(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    vertices: list[list[float]] = []
    groups: list[list[list[int]]] = []
    for line in path.read_text(encoding="ascii").splitlines():
        word, *rest = line.split()
        if word == "o":
            groups.append([])
        elif word == "v":
            vertices.append([float(x) for x in rest])
        elif word == "f":
            groups[-1].append([int(x) - 1 for x in rest])
    points = np.array(vertices)
    parts = []
    for group in groups:
        used, faces = np.unique(np.array(group), return_inverse=True)
        parts.append((points[used], faces.reshape(-1, 3)))
    return parts


def as_manifold(vertices: np.ndarray, faces: np.ndarray) -> manifold3d.Manifold:
    """A solid in micrometres, so that the library's absolute tolerances do not matter."""
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.ascontiguousarray(vertices * 1e6), np.ascontiguousarray(faces.astype(np.uint64)))
    )
    assert solid.status() == manifold3d.Error.NoError
    return solid


ROWS = read_rows()
NAMES = sorted(ROWS)


@pytest.fixture(scope="module", params=NAMES)
def item(request: pytest.FixtureRequest) -> Loaded:
    row = ROWS[request.param]
    mesh = trimesh.load(CATALOGUE / row["file"], process=False)
    return Loaded(row, mesh, read_parts(CATALOGUE / row["parts_file"]))


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    sys.path.insert(0, str(ASSETS))
    try:
        import build_items
    finally:
        sys.path.remove(str(ASSETS))
    return build_items


def test_mesh_is_one_watertight_solid(item: Loaded) -> None:
    mesh = item.mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert mesh.body_count == 1


def test_no_triangle_is_degenerate(item: Loaded) -> None:
    edges = np.linalg.norm(np.roll(item.mesh.triangles, -1, axis=1) - item.mesh.triangles, axis=2)
    heights = 2.0 * item.mesh.area_faces / edges.max(axis=1)
    # Loaders weld vertices within 1e-8 m: what is thinner than that would open the mesh.
    assert edges.min() > 1e-7
    assert heights.min() > 2e-8
    welded = trimesh.Trimesh(item.mesh.vertices, item.mesh.faces, process=True)
    assert welded.is_watertight
    assert len(welded.faces) == len(item.mesh.faces)


def test_curved_items_have_enough_vertices_and_none_has_too_many(item: Loaded) -> None:
    count = len(item.mesh.vertices)
    assert count <= 10_000
    assert count >= (8 if item.row["name"] in FLAT else 1000)
    assert len(item.parts) <= 100


def test_parts_are_convex(item: Loaded) -> None:
    for vertices, faces in item.parts:
        part = trimesh.Trimesh(vertices, faces, process=False)
        assert part.is_watertight
        hull = ConvexHull(vertices)
        assert part.volume == pytest.approx(hull.volume, rel=1e-6)
        # Closed form of convexity: no vertex lies outside of any face's plane.
        normals = part.face_normals
        offsets = np.einsum("ij,ij->i", normals, part.triangles[:, 0])
        assert (normals @ vertices.T - offsets[:, None]).max() < 2e-7


def test_mesh_is_the_union_of_its_parts(item: Loaded) -> None:
    solid = as_manifold(np.asarray(item.mesh.vertices), np.asarray(item.mesh.faces))
    union = manifold3d.Manifold.batch_boolean(
        [as_manifold(*part) for part in item.parts], manifold3d.OpType.Add
    )
    assert union.volume() == pytest.approx(solid.volume(), rel=1e-6)
    outside = (union - solid).volume() + (solid - union).volume()
    assert outside < 1e-6 * solid.volume()
    assert np.allclose(union.bounding_box(), solid.bounding_box(), atol=1.0)


def test_table_holds_the_figures_of_the_mesh(item: Loaded) -> None:
    row, mesh = item.row, item.mesh
    for axis, length in zip("xyz", mesh.extents, strict=True):
        assert float(row[f"extents_{axis}"]) == pytest.approx(length, abs=1e-5)
    hull = ConvexHull(mesh.vertices).volume
    assert float(row["volume_m3"]) == pytest.approx(mesh.volume, rel=1e-5)
    assert float(row["hull_volume_m3"]) == pytest.approx(hull, rel=1e-5)
    assert float(row["convexity"]) == pytest.approx(mesh.volume / hull, abs=1e-4)


def test_item_rests_on_the_origin_of_its_frame(item: Loaded) -> None:
    low, high = item.mesh.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    assert np.allclose((low + high)[:2], 0.0, atol=3e-6)


def test_size_and_mass_are_those_of_household_items(item: Loaded) -> None:
    size = np.sort(item.mesh.extents)
    assert size[0] >= 0.010
    assert size[2] <= 0.33
    assert 0.005 <= float(item.row["mass_kg"]) <= 2.5
    # Foam is the lightest and brass the heaviest stuff there is here; a hollow ball is lighter than it looks.
    density = float(item.row["mass_kg"]) / item.mesh.volume
    assert 45.0 <= density <= 9000.0
    assert item.row["source"]
    assert item.row["licence"] == "CC0-1.0"


def test_stated_sizes_are_the_built_ones() -> None:
    checked = 0
    for name, row in ROWS.items():
        extents = [1000.0 * float(row[f"extents_{axis}"]) for axis in "xyz"]
        stated = re.search(r"\d+(?:\.\d+)?(?: x \d+(?:\.\d+)?)* mm", row["source"])
        if stated is None or "grid" in row["source"]:
            continue
        for text in stated.group().removesuffix(" mm").split(" x "):
            checked += 1
            miss = min(abs(float(text) - length) for length in extents)
            assert miss <= max(2.0, 0.02 * float(text)), f"{name}: {text} mm is stated, built are {extents}"
    assert checked > 100


def test_catalogue_is_varied() -> None:
    assert len(ROWS) >= 40
    assert sum(float(row["convexity"]) < 0.8 for row in ROWS.values()) >= 20
    sizes = np.array(
        [sorted((float(row[f"extents_{a}"]) for a in "xyz"), reverse=True) for row in ROWS.values()]
    )
    median = np.median(sizes, axis=0)
    assert np.all(median >= (0.09, 0.06, 0.03))
    assert np.all(median <= (0.20, 0.12, 0.09))
    assert (sizes[:, 0] > 0.25).sum() <= 0.15 * len(sizes)
    assert sum(path.stat().st_size for path in CATALOGUE.iterdir()) < 12e6


def test_files_and_table_agree() -> None:
    wanted = {row[column] for row in ROWS.values() for column in ("file", "parts_file")} | {"objects.csv"}
    assert {path.name for path in CATALOGUE.iterdir()} == wanted
    assert all(name == name.lower() and name.replace("_", "").isalnum() for name in ROWS)


def load_solid(name: str) -> manifold3d.Manifold:
    mesh = trimesh.load(CATALOGUE / ROWS[name]["file"], process=False)
    return as_manifold(np.asarray(mesh.vertices), np.asarray(mesh.faces))


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_each_cup_nests_in_the_next_larger_one(number: int) -> None:
    inner, outer = load_solid(f"nesting_cup_{number}"), load_solid(f"nesting_cup_{number + 1}")
    floor = 3000.0
    raised = inner.translate((0.0, 0.0, floor + 1.0))
    assert (raised ^ outer).volume() == 0.0
    # Turned by half a facet, and pushed 2 mm aside: there is room on every side.
    for angle in (7.5, 20.0):
        assert (raised.rotate((0.0, 0.0, angle)).translate((1414.0, 1414.0, 0.0)) ^ outer).volume() == 0.0
    rim = raised.bounding_box()[5] - outer.bounding_box()[5]
    assert -2000.0 < rim < 15000.0
    # It rests on the floor: a hair lower and the two overlap.
    assert (inner.translate((0.0, 0.0, floor - 10.0)) ^ outer).volume() > 0.0


def test_party_cups_stack() -> None:
    cup = load_solid("party_cup")
    height = cup.bounding_box()[5]
    assert (cup.translate((0.0, 0.0, 20_000.0)) ^ cup).volume() == 0.0
    assert (cup.translate((0.0, 0.0, 5_000.0)) ^ cup).volume() > 0.0
    assert height == pytest.approx(120_000.0, abs=2.0)


@pytest.mark.parametrize(("name", "floor"), [("mug", 0.005), ("bowl", 0.0082), ("nesting_cup_3", 0.003)])
def test_physics_keeps_the_hollow_open(name: str, floor: float) -> None:
    pybullet = pytest.importorskip("pybullet", reason=NO_BULLET)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        path = str(CATALOGUE / ROWS[name]["parts_file"])
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=path, physicsClientId=client)
        pybullet.createMultiBody(0.0, shape, physicsClientId=client)
        hit = pybullet.rayTest((0.003, 0.001, 1.0), (0.003, 0.001, -1.0), physicsClientId=client)[0]
        assert hit[0] >= 0
        assert hit[3][2] == pytest.approx(floor, abs=1.5e-3)
    finally:
        pybullet.disconnect(client)


@pytest.mark.parametrize("path", sorted((ASSETS / "orders").iterdir()), ids=lambda path: path.name)
def test_orders_name_items_of_the_catalogue(path: Path) -> None:
    if path.suffix == ".json":
        lines = json.loads(path.read_text(encoding="utf-8"))["items"]
    else:
        with path.open(encoding="utf-8", newline="") as stream:
            lines = list(csv.DictReader(stream))
        assert {"item", "qty"} == set(lines[0])
    assert all(line["item"] in ROWS and int(line["qty"]) >= 1 for line in lines)
    pieces = sum(int(line["qty"]) for line in lines)
    assert pieces == {"small.csv": 4, "ten.csv": 10, "ten_kitchen.csv": 10}.get(path.name, pieces)


def test_boxes() -> None:
    with (ASSETS / "boxes.csv").open(encoding="utf-8", newline="") as stream:
        boxes = {row["box_id"]: row for row in csv.DictReader(stream)}
    assert list(boxes) == ["A1", "1AD", "1A5", "1B2", "K3", "S32"]
    s32 = tuple(float(boxes["S32"][key]) for key in ("length_m", "width_m", "height_m"))
    assert s32 == (0.32, 0.32, 0.30)


@pytest.mark.parametrize("name", ["mug", "scissors", "tennis_ball", "cracker_box", "toy_brick_2x2"])
def test_rebuilding_an_item_gives_the_same_bytes(builder: ModuleType, name: str) -> None:
    row, files = builder.build_item(builder.recipes()[name])
    assert row == ROWS[name]
    for file_name, data in files.items():
        assert (CATALOGUE / file_name).read_bytes() == data


@pytest.mark.slow
def test_rebuilding_everything_gives_the_same_bytes(builder: ModuleType) -> None:
    assert builder.differences(CATALOGUE) == []
