"""Files of exact convex parts: those of our catalogue are, and a wrong one is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from packenv.errors import CatalogueError
from packenv.items.catalogue import open_catalogue
from packenv.items.parts_files import exact_parts, read_parts
from tests import shapes

CRATE = shapes.box(0.1, 0.08, 0.06, "crate")


def obj_text(*parts: np.ndarray) -> str:
    return "\n".join(
        line for p in parts for line in ["o part", *(f"v {x} {y} {z}" for x, y, z in p.tolist())]
    )


def halves() -> tuple[np.ndarray, np.ndarray]:
    left, right = CRATE.vertices.copy(), CRATE.vertices.copy()
    left[:, 0] = np.minimum(left[:, 0], 0.05)
    right[:, 0] = np.maximum(right[:, 0], 0.05)
    return left, right


def test_parts_come_back_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "crate.parts.obj"
    for scale in (1.0, 1e-3):
        path.write_text(obj_text(*(half / scale for half in halves())))
        for part, half in zip(read_parts(path, CRATE, scale), halves(), strict=True):
            assert np.abs(part - half).max() < 1e-12


@pytest.mark.parametrize("name", ["bowl", "mug", "pitcher", "scissors"])
def test_the_built_in_parts_fill_their_mesh(name: str) -> None:
    catalogue = open_catalogue("builtin")
    found = exact_parts(catalogue, name)
    assert found is not None
    assert (found.bulge, found.dent, found.ball) == (0.0, 0.0, None)
    item = catalogue.item(name)
    # Parts may overlap, so their volumes add up to the mesh's or more, and each is inside its hull.
    assert sum(trimesh.convex.convex_hull(p).volume for p in found.parts) >= item.volume * 0.999


def test_a_ball_of_the_catalogue_is_a_sphere() -> None:
    found = exact_parts(open_catalogue("builtin"), "baseball")
    assert found is not None
    assert found.ball is not None
    assert 0.03 < found.ball.radius < 0.045


def test_a_catalogue_without_parts_says_so(tmp_path: Path) -> None:
    trimesh.Trimesh(CRATE.vertices, CRATE.faces).export(tmp_path / "crate.ply")
    assert exact_parts(open_catalogue(tmp_path), "crate") is None


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("# nothing\nf 1 2 3\n", "holds no part"),
        ("v 0 0 0\n", "line 1"),
        ("o a\nv 0 0 zero\n", "line 2"),
        ("o a\nv 0 0\n", "line 2"),
        ("o a\nv 0 0 nan\n", "line 2"),
        (obj_text(CRATE.vertices * [1, 1, 0]), "no volume"),
        (obj_text(halves()[0]), "bounding box is 50.00 mm off"),
        (obj_text(CRATE.vertices + 0.01), "bounding box is 10.00 mm off"),
    ],
)
def test_a_wrong_file_is_refused_with_its_name(text: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / "crate.parts.obj"
    path.write_text(text)
    with pytest.raises(CatalogueError, match=word) as refused:
        read_parts(path, CRATE)
    assert "crate.parts.obj" in str(refused.value)
