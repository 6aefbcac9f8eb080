"""Positioning heuristics as scores of candidates: lower is better (paper Sec. IV-B and V).

A heuristic is a function of the candidates and a random generator; it returns one float64 for each
candidate. Equal scores keep the order of the candidates. An own one is such a function, too::

    def flattest(candidates, rng):
        return candidates.extents[:, 2]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from packenv.planning.search.candidates import CandidateGroup, Candidates
from packenv.types import FloatArray

Heuristic: TypeAlias = Callable[[Candidates, np.random.Generator], FloatArray]
"""Candidates and a generator, for those that draw, to (n,) float64 scores."""

PAPER_CONSTANT = 1.0
"""c of the paper's HM and DBLF, with X and Y in metres."""


def _gather(candidates: Candidates, evaluate: Callable[[CandidateGroup], FloatArray]) -> FloatArray:
    """Evaluate the legal candidates of every orientation, in candidate order."""
    return np.concatenate([evaluate(group) for group in candidates.grids] or [np.empty(0)])


@dataclass(frozen=True)
class HeightmapMinimization:
    """HM (paper eq. 11): c · (X + Y) + Σ H'_c, the sum in metres over all cells of the container.

    Attributes:
        c: weight of X + Y, in metres: with the paper's 1 a tie-break, for the sum is over thousands of cells.
    """

    c: float = PAPER_CONSTANT

    def __call__(self, candidates: Candidates, rng: np.random.Generator) -> FloatArray:
        """(n,) scores, m."""
        if not candidates.grids:
            return np.empty(0)
        before = candidates.grids[0].surface.source.total
        return self.c * candidates.xy_sum + (before + _gather(candidates, lambda group: group.raised()))


@dataclass(frozen=True)
class DeepestBottomLeft:
    """DBLF (paper eq. 8): Z + c · (X + Y), in metres.

    Attributes:
        c: weight of X + Y. With the paper's 1 and all three in metres it is no tie-break: X + Y outweighs Z,
            and items are stacked in a corner. The default packs most (docs/decisions.md).
    """

    c: float = 0.01

    def __call__(self, candidates: Candidates, rng: np.random.Generator) -> FloatArray:
        """(n,) scores, m."""
        return candidates.z.astype(np.float64) + self.c * candidates.xy_sum


def maximum_touching_area(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """MTA (Wang et al. 2010): minus the area that touches items, walls and floor, m².

    On heightmaps, a footprint cell touches from above where its bottom is within half a cell of the
    container heightmap, and counts with the cell's area. A side of a footprint cell whose neighbour is
    outside the footprint touches over the height that it shares with the filled column, or the wall, in
    that neighbour, and counts with that height times the cell size.
    """
    return -_gather(candidates, lambda group: group.touched_area())


def lowest_center_of_mass(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """MinZ, the rule of HAPE3D (Liu et al. 2015): height of the item's centre of mass, m."""
    heights = np.array([grid.oriented.com[2] for grid in candidates.grids])
    total: FloatArray = candidates.z.astype(np.float64) + heights[candidates.grid_index]
    return total


def first_fit(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """FirstFit: the first legal candidate in the order of Alg. 2."""
    return np.arange(len(candidates), dtype=np.float64)


def uniform_random(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """Random: every legal candidate is equally likely to be best."""
    return rng.random(len(candidates))


HEURISTICS: Mapping[str, Heuristic] = MappingProxyType(
    {
        "hm": HeightmapMinimization(),
        "dblf": DeepestBottomLeft(),
        "mta": maximum_touching_area,
        "minz": lowest_center_of_mass,
        "first-fit": first_fit,
        "random": uniform_random,
    }
)
"""Every built-in heuristic by its name on the command line."""


def heuristic_named(name: str, c: float | None = None) -> Heuristic:
    """A built-in heuristic.

    Args:
        name: one of ``HEURISTICS``.
        c: weight of X + Y in ``hm`` and ``dblf``; None takes that of the heuristic itself. The others have
            no such constant.
    """
    found = HEURISTICS[name]
    if c is not None and isinstance(found, HeightmapMinimization | DeepestBottomLeft):
        return replace(found, c=c)
    return found


def name_of(heuristic: Heuristic) -> str:
    """The name of a built-in heuristic, whatever its constant; of any other, ``own``."""
    for name, built_in in HEURISTICS.items():
        if heuristic is built_in or heuristic == built_in:
            return name
        if isinstance(heuristic, HeightmapMinimization | DeepestBottomLeft) and type(heuristic) is type(
            built_in
        ):
            return name
    return "own"
