"""The benchmark of nesting instances: what it reads, and what its methods may claim."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.exchange.binvox import export_binvox

from benchmarks.nesting import METHODS, loaded, put_down, read_instances


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two arches and a bar that fits under them, and that goes there from above before them alone."""
    arch, bar = (np.zeros((8, 8, 8), dtype=np.bool_) for _ in range(2))
    arch[:6, :3, :6] = True
    arch[2:4, :3, :3] = False
    bar[3:5, 1:7, 4:7] = True  # in a margin
    for name, grid in (("arch", arch), ("bar", bar)):
        (tmp_path / f"{name}.binvox").write_bytes(export_binvox(trimesh.voxel.VoxelGrid(grid)))
    (tmp_path / "instances.csv").write_text(
        "instance,length,width,unit_per_voxel,file,quantity\n"
        "arches,3,6.1,0.5,arch.binvox,2\narches,3,6.1,0.5,bar.binvox,1\n"
    )
    return tmp_path


def test_instances_are_read(folder: Path) -> None:
    instance = read_instances(folder)["arches"]
    assert instance.floor == (6, 12)
    assert [piece.grid.grid.shape for piece in instance.pieces] == [(6, 3, 6)] * 2 + [(2, 6, 3)]
    assert [piece.grid.count for piece in instance.pieces] == [90, 90, 36]


def lowest(full: np.ndarray, grid: np.ndarray, x: int, y: int) -> int:
    """The least z that a grid comes to at (x, y), straight down onto voxels."""
    w, d, h = grid.shape
    met = [z for z in range(30) if (full[x : x + w, y : y + d, z : z + h] & grid).any()]
    return max(met, default=-1) + 1


@pytest.mark.parametrize("corner", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_piece_comes_to_lie_as_low_as_it_can(folder: Path, corner: tuple[int, int]) -> None:
    """Place by place: nothing overlaps on the way down, one voxel lower something does."""
    instance = read_instances(folder)["arches"]
    arch, _, bar = instance.pieces
    heights = np.random.default_rng(0).integers(0, 5, instance.floor).astype(np.float32)
    for piece in (arch, bar, arch):
        grid = piece.grid.grid
        w, d, h = grid.shape
        full = np.arange(40) < heights[:, :, None]

        spots = [(x, y) for x in range(heights.shape[0] - w + 1) for y in range(heights.shape[1] - d + 1)]
        place, before = np.zeros(3, dtype=np.int64), heights.copy()
        put_down(heights, *piece.columns, np.array(corner), place)
        x, y, z = place.tolist()
        assert z == lowest(full, grid, x, y)
        best = min(
            2 * lowest(full, grid, *spot) + corner[0] * spot[0] + corner[1] * spot[1] for spot in spots
        )
        assert 2 * z + corner[0] * x + corner[1] * y == best
        full[x : x + w, y : y + d, z : z + h] |= grid
        tops = 40 - full[:, :, ::-1].argmax(axis=2)
        assert np.array_equal(heights, np.where(full.any(axis=2), tops, before))


@pytest.mark.parametrize("seed", range(4))
def test_loaded_pieces_overlap_nothing(folder: Path, seed: int) -> None:
    instance = read_instances(folder)["arches"]
    rng = np.random.default_rng(seed)
    height, places = loaded(instance, rng.permutation(3).tolist(), rng.choice([-1, 1], (3, 2)))
    whole = np.zeros((*instance.floor, height), dtype=int)
    for piece, (x, y, z) in zip(instance.pieces, places.tolist(), strict=True):
        w, d, h = piece.grid.grid.shape
        whole[x : x + w, y : y + d, z : z + h] += piece.grid.grid
    assert whole.max() == 1


def test_report(folder: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "benchmarks.nesting",
        "--instances",
        str(folder),
        "--budget",
        "2",
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)["instances"]["arches"]
    assert tuple(found) == METHODS
    assert all(set(entry) == {"height", "seconds"} for entry in found.values())
    assert found["search"]["height"] <= found["one-pass"]["height"]
    assert (
        found["separate"]["height"] == found["gls"]["height"] == 3.0
    )  # an arch's height: the least there is
