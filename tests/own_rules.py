"""A heuristic and constraints of a user's own, found by name: ``tests.own_rules:flattest``."""

from __future__ import annotations

from typing import Any

import numpy as np

from packenv import Candidates, Constraint, Trial, Verdict

LOW = 0.05
"""No item may reach higher under :class:`LowOnly`, m."""


def flattest(candidates: Candidates, rng: np.random.Generator) -> np.ndarray:
    """The smallest height first."""
    return candidates.extents[:, 2] + candidates.z


def at_random(candidates: Candidates, rng: np.random.Generator) -> np.ndarray:
    """Any candidate."""
    return rng.random(len(candidates))


def too_few(candidates: Candidates, rng: np.random.Generator) -> np.ndarray:
    """One score is missing."""
    return np.zeros(len(candidates) + 1)


def not_numbers(candidates: Candidates, rng: np.random.Generator) -> np.ndarray:
    """Not a number each."""
    return np.full(len(candidates), np.nan)


def a_list(candidates: Candidates, rng: np.random.Generator) -> Any:
    """Not an array."""
    return [0.0] * len(candidates)


class LowOnly(Constraint):
    """Nothing may reach higher than :data:`LOW`."""

    def check(self, trial: Trial, surface: Any, state: Any) -> Verdict:
        """Ask for its top."""
        return Verdict(trial.z + trial.oriented.extents[2] <= LOW, "too-high")


class LeftThenRight(Constraint):
    """Of one order everything must lie on the left, of the next on the right, and so on."""

    def __init__(self) -> None:
        """Begin."""
        self.orders = 0

    def for_order(self, items: Any, container: Any) -> Constraint:
        """Go on to the next order."""
        self.orders += 1
        middle = container.length / 2
        return _Side(middle, left=self.orders % 2 == 1)

    def check(self, trial: Trial, surface: Any, state: Any) -> Verdict:
        """Never asked: each order has a constraint of its own."""
        raise AssertionError


class _Side(Constraint):
    def __init__(self, middle: float, *, left: bool) -> None:
        self.middle, self.left = middle, left

    def check(self, trial: Trial, surface: Any, state: Any) -> Verdict:
        return Verdict(bool(trial.corner[0] < self.middle) == self.left, "wrong-side")
