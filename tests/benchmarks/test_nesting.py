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

from benchmarks.nesting import METHODS, loaded, read_instances


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


def test_loaded_pieces_overlap_nothing(folder: Path) -> None:
    instance = read_instances(folder)["arches"]
    height, places = loaded(instance, [0, 1, 2])
    whole = np.zeros((*instance.floor, height), dtype=int)
    for piece, (x, y, z) in zip(instance.pieces, places, strict=True):
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
