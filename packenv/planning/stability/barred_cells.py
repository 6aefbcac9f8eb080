"""Cells on which nothing may lie: they rule most candidates out at once that would lie on an item that bears nothing.

A candidate lies where its lower heightmap meets the container's. Where it meets it on a barred cell, the exact
contacts would say the same, at a thousand times the price. The outermost cells of an item are not barred: an item
that stands beside it begins in the same cell.
"""

from __future__ import annotations

import numpy as np

from packenv.kernels import compiled
from packenv.planning.constraints import Trial
from packenv.planning.search.candidates import Candidates
from packenv.planning.stability.contacts import THRESHOLD
from packenv.types import BoolArray, Float32Array


def with_barred(barred: Float32Array | None, trial: Trial, shape: tuple[int, int]) -> Float32Array:
    """The heights of barred cells with those of one more item.

    Args:
        barred: (nx, ny) m, -inf elsewhere; None where no cell is barred.
        trial: the item at its place.
        shape: nx and ny.
    """
    heights = np.full(shape, -np.inf, dtype=np.float32) if barred is None else barred.copy()
    top = trial.oriented.top
    w, h = top.shape
    inner = _inner(trial.oriented.footprint)
    window = heights[trial.ix : trial.ix + w, trial.iy : trial.iy + h]
    inner, top = inner[: window.shape[0], : window.shape[1]], top[: window.shape[0], : window.shape[1]]
    np.maximum(window, np.where(inner, top + np.float32(trial.z), np.float32(-np.inf)), out=window)
    return heights


def _inner(footprint: BoolArray) -> BoolArray:
    """(w, h) the cells all four of whose neighbours belong to the footprint, too."""
    inner = np.zeros_like(footprint)
    inner[1:-1, 1:-1] = (
        footprint[1:-1, 1:-1]
        & footprint[:-2, 1:-1]
        & footprint[2:, 1:-1]
        & footprint[1:-1, :-2]
        & footprint[1:-1, 2:]
    )
    return inner


def on_barred(candidates: Candidates, barred: Float32Array) -> BoolArray:
    """(n,) candidates that lie on a barred cell by the heightmaps, to the threshold of a contact."""
    found = np.zeros(len(candidates), dtype=np.bool_)
    for index, group in enumerate(candidates.grids):
        which = np.flatnonzero(candidates.grid_index == index)
        if len(which):
            found[which] = _lie_on(
                barred,
                group.oriented.bottom,
                candidates.ix[which],
                candidates.iy[which],
                candidates.z[which],
                np.float32(THRESHOLD),
            )
    return found


@compiled
def _lie_on(barred, bottom, ix, iy, z, threshold):  # type: ignore[no-untyped-def]
    found = np.zeros(len(ix), dtype=np.bool_)
    w, h = bottom.shape
    nx, ny = barred.shape
    for k in range(len(ix)):
        for i in range(min(w, nx - ix[k])):
            for j in range(min(h, ny - iy[k])):
                if z[k] + bottom[i, j] <= barred[ix[k] + i, iy[k] + j] + threshold:
                    found[k] = True
                    break
            if found[k]:
                break
    return found
