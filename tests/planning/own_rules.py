"""Constraints and heuristics as a user writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.search.candidates import Candidates
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.types import Container, FloatArray, Item, OrientedItem


class Low(Constraint):
    """Nothing stands taller than 5 cm; the least that one has to write."""

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        return Verdict(bool(trial.oriented.extents[2] < 0.051), "too-tall")


class Never(Constraint):
    """Refuses everything."""

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        return Verdict(False, "never")


class Always(Constraint):
    """Refuses nothing."""

    name = "always"

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        return Verdict(True)


@dataclass
class Apart(Constraint):
    """Centres of mass keep apart sideways: knows what lies by its state, and is told of order and end.

    Attributes:
        distance: m.
        told: what :meth:`for_order` was given.
        closed: how often it was closed.
        asked: where it was asked, in sequence.
    """

    distance: float = 0.03
    told: list[tuple[Mapping[str, Item], Container]] = field(default_factory=list)
    closed: int = 0
    asked: list[tuple[bytes, int, int]] = field(default_factory=list)

    def for_order(self, items: Mapping[str, Item], container: Container) -> Apart:
        self.told.append((items, container))
        return self

    def start(self, resting: Sequence[Resting] = ()) -> tuple[FloatArray, ...]:
        return tuple(r.rotation @ r.item.com + r.position for r in resting)

    def objection(self, oriented: OrientedItem) -> str | None:
        return "too-long" if oriented.extents[:2].max() > 0.15 else None

    def check(self, trial: Trial, surface: ContainerMap, state: tuple[FloatArray, ...]) -> Verdict:
        self.asked.append((trial.oriented.rotation.tobytes(), trial.ix, trial.iy))
        least = min((float(np.linalg.norm((trial.com - com)[:2])) for com in state), default=1.0)
        details = {"least_m": round(least, 6)}
        return Verdict(least >= self.distance, "too-near", (*state, trial.com), details)

    def close(self) -> None:
        self.closed += 1


def deepest(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """What DBLF is by default."""
    return candidates.z.astype(np.float64) + 0.01 * candidates.xy_sum


def drawn(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """What ``random`` is."""
    return rng.random(len(candidates))


def flattest(candidates: Candidates, rng: np.random.Generator) -> FloatArray:
    """The lowest top, then the nearest to the corner."""
    top: FloatArray = candidates.z + candidates.extents[:, 2]
    return np.round(top, 4) + 1e-3 * candidates.xy_sum
