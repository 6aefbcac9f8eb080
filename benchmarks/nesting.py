"""Public instances of 3D nesting as voxels: ``python -m benchmarks.nesting --instances FOLDER --json``.

All pieces into a container of a given floor, at the orientation that they are given in; the lowest height wins. The
folder has an ``instances.csv`` (instance, length, width, unit_per_voxel, file, quantity) and the files, ``.binvox``.

``one-pass``: the largest piece first, each straight down from above to the lowest place. ``search``: the same in other
sequences and into other corners, while there is time. ``gls`` and ``separate``: overlap and containment alone count;
from the height of the one pass on, the box is made lower by one voxel whenever nothing overlaps. These are not loaded
from above.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import csv
import json
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from trimesh.exchange.binvox import load_binvox

from packenv.geometry.voxels import Voxels
from packenv.kernels import compiled, compiled_in_any_sequence
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.guided_local_search import GuidedLocalSearch
from packenv.planning.layouts.layout import Arrangement
from packenv.planning.layouts.layout_packer import LayoutSearch
from packenv.planning.layouts.separation import Separation
from packenv.types import Float32Array, IntArray

METHODS = ("one-pass", "search", "gls", "separate")


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece at its one orientation, voxels of side 1."""

    grid: Voxels

    @cached_property
    def columns(self) -> tuple[Float32Array, Float32Array]:
        """(w, d) bottoms and tops of its columns."""
        low, high = self.grid.runs
        return low.min(axis=0), high.max(axis=0)

    @property
    def orientations(self) -> Sequence[object]:
        """The one."""
        return (None,)

    def voxels(self, kind: int, pitch: float) -> Voxels:
        """The piece."""
        return self.grid


@dataclass(frozen=True, eq=False)
class Instance:
    """Pieces and a floor.

    Attributes:
        pieces: of it.
        floor: length and width, voxels.
        unit: of heights, per voxel.
    """

    pieces: tuple[Piece, ...]
    floor: tuple[int, int]
    unit: float


def read_instances(folder: Path) -> dict[str, Instance]:
    """Every instance of a folder, by name."""
    rows: dict[str, list[dict[str, str]]] = {}
    with (folder / "instances.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["instance"], []).append(row)
    found = {}
    for name, own in rows.items():
        unit = float(own[0]["unit_per_voxel"])
        x, y = (int(float(own[0][side]) / unit + 1e-6) for side in ("length", "width"))
        shapes = [(Piece(read_piece(folder / row["file"])), int(row["quantity"])) for row in own]
        pieces = [piece for piece, quantity in shapes for _ in range(quantity)]
        found[name] = Instance(tuple(pieces), (x, y), unit)
    return found


def read_piece(path: Path) -> Voxels:
    """The voxels of a file, without a margin."""
    with path.open("rb") as file:
        full = np.asarray(load_binvox(file).matrix, dtype=np.bool_)
    low, high = (f(np.argwhere(full), axis=0) for f in (np.min, np.max))
    grid = np.ascontiguousarray(full[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))])
    return Voxels(grid, np.array(grid.shape, dtype=np.float64), 1.0)


@compiled_in_any_sequence
def rest_levels(heights, bottoms, levels):  # type: ignore[no-untyped-def]
    """How low a piece comes at every place, straight down: the highest of what its columns meet.

    Args:
        heights: (x, y) float32 of the pile, voxels.
        bottoms: (w, d) float32 of the piece's columns; beyond any height where there is none.
        levels: (x - w + 1, y - d + 1) float32, overwritten.
    """
    levels[:] = 0.0
    for i in range(bottoms.shape[0]):
        for j in range(bottoms.shape[1]):
            bottom = bottoms[i, j]
            for x in range(levels.shape[0]):
                below, line = heights[x + i, j : j + levels.shape[1]], levels[x]
                for y in range(levels.shape[1]):
                    level = below[y] - bottom
                    line[y] = level if level > line[y] else line[y]


@compiled
def put_down(heights, bottoms, tops, corner, place):  # type: ignore[no-untyped-def]
    """Let a piece down where it comes to lie lowest, and of equally low places in a corner.

    Args:
        heights: (x, y) float32 of the pile, changed.
        bottoms: as for :func:`rest_levels`.
        tops: (w, d) float32 of the piece's columns.
        corner: (2,) 1 where small x, or y, is preferred, -1 where large.
        place: (3,) int64, overwritten: x, y and z.
    """
    w, d = bottoms.shape
    levels = np.empty((heights.shape[0] - w + 1, heights.shape[1] - d + 1), dtype=np.float32)
    rest_levels(heights, bottoms, levels)
    best = np.inf
    for x in range(levels.shape[0]):
        for y in range(levels.shape[1]):
            aside = 2.0 * levels[x, y] + corner[0] * x + corner[1] * y
            if aside < best:
                best = aside
                place[0], place[1], place[2] = x, y, levels[x, y]
    for i in range(w):
        for j in range(d):
            at = place[0] + i, place[1] + j
            heights[at] = max(heights[at], np.float32(place[2] + tops[i, j]))


def loaded(
    instance: Instance, sequence: Sequence[int], corners: IntArray | None = None
) -> tuple[int, IntArray]:
    """Height of the pile, and each piece's place (n, 3), where pieces come straight down in a sequence.

    Args:
        instance: what is loaded.
        sequence: numbers of its pieces.
        corners: (n, 2) of each piece, see :func:`put_down`; None is 1.
    """
    heights = np.zeros(instance.floor, dtype=np.float32)
    places = np.zeros((len(instance.pieces), 3), dtype=np.int64)
    corners = np.ones((len(places), 2), dtype=np.int64) if corners is None else corners
    for k in sequence:
        put_down(heights, *instance.pieces[k].columns, corners[k], places[k])
    return int(heights.max()), places


def largest_first(instance: Instance) -> list[int]:
    """Numbers of the pieces by falling volume of their bounding boxes."""
    return sorted(range(len(instance.pieces)), key=lambda k: -instance.pieces[k].grid.grid.size)


def sequences(instance: Instance, effort: Effort, rng: np.random.Generator) -> Iterator[tuple[int, float]]:
    """Heights of better and better sequences, and when they were found.

    One piece at a time goes elsewhere in the sequence, changes places in it with another one, or prefers another
    corner.
    """
    best, (height, _) = largest_first(instance), loaded(instance, largest_first(instance))
    n, corners = len(best), np.ones((len(best), 2), dtype=np.int64)
    yield height, effort.elapsed
    while effort.left():
        trial, turned = list(best), corners
        a, b = rng.integers(n, size=2).tolist()
        match int(rng.integers(3)):
            case 0:
                trial.insert(b, trial.pop(a))
            case 1:
                trial[a], trial[b] = trial[b], trial[a]
            case _:
                turned = corners.copy()
                turned[a] = rng.choice([-1, 1], 2)
        found, _ = loaded(instance, trial, turned)
        if found <= height:
            best, corners = trial, turned
        if found < height:
            height = found
            yield height, effort.elapsed


def squeezed(
    instance: Instance, search: LayoutSearch, effort: Effort, rng: np.random.Generator
) -> Iterator[tuple[int, float]]:
    """Heights at which nothing overlaps, lower and lower, and when they were found."""
    height, places = loaded(instance, largest_first(instance))
    yield height, effort.elapsed
    while effort.left():
        arrangement = Arrangement(instance.pieces, (*map(float, instance.floor), float(height - 1)), 1.0)
        last = [arrangement.places(k, 0) for k in range(len(instance.pieces))]
        if any(min(n) < 1 for n in last):
            return
        for k, at in enumerate(places):
            arrangement.move(k, 0, np.minimum(at, np.array(last[k]) - 1))
        if search.run(arrangement, rng, effort).overlap:
            return
        places = arrangement.at.copy()
        height = max(
            int(z) + piece.grid.grid.shape[2] for z, piece in zip(places[:, 2], instance.pieces, strict=True)
        )
        yield height, effort.elapsed


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--instances", type=Path, required=True, help="folder with instances.csv")
    parser.add_argument("--only", nargs="+", help="names of instances (default: all)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument(
        "--budget", type=float, default=60.0, help="CPU-seconds for each (default: %(default)g)"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()
    report: dict[str, dict[str, dict[str, float]]] = {}
    for name, instance in read_instances(arguments.instances).items():
        if arguments.only and name not in arguments.only:
            continue
        report[name] = {}
        for method in arguments.methods:
            effort = Effort(arguments.budget, clock=time.process_time)
            rng = np.random.default_rng(arguments.seed)
            if method in ("one-pass", "search"):
                found = sequences(instance, effort, rng)
            else:
                found = squeezed(
                    instance, GuidedLocalSearch(restarts=1) if method == "gls" else Separation(), effort, rng
                )
            height, seconds = next(found) if method == "one-pass" else deque(found, maxlen=1)[0]
            report[name][method] = {"height": round(height * instance.unit, 4), "seconds": round(seconds, 2)}
            if not arguments.json:
                print(f"{name:<8}{method:<10}{height * instance.unit:8.2f} after {seconds:.1f} s", flush=True)
    if arguments.json:
        print(json.dumps({"instances": report}, indent=1))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
