"""What an action is worth: named terms whose sum is the reward, the default ones or a user's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from packenv.errors import InputError, is_number
from packenv.extensions import load_extension
from packenv.types import Float32Array, Placement


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one action.

    Attributes:
        invalid: the action was not valid; nothing changed.
        placed: pieces that were packed: 1 or 0.
        placed_volume: of these, as a share of the container's volume.
        outside: pieces that stick out of the container now and did not before, less those that came back.
        outside_volume: of these, as a share of the container's volume.
        collided: the robot or the held item met something: the robot has stopped.
        left_over: pieces that were given up.
        ended: the episode has terminated.
        complete: it has, with every piece packed and none outside.
        pieces: pieces of the order.
        placements: of the episode so far, in packing sequence, as planned. Copies: what is written into them
            changes nothing.
        heights: (nx, ny) float32, container heightmap after the action, m; a copy, too.
    """

    invalid: bool
    placed: int
    placed_volume: float
    outside: int
    outside_volume: float
    collided: bool
    left_over: int
    ended: bool
    complete: bool
    pieces: int
    placements: tuple[Placement, ...]
    heights: Float32Array


RewardFn: TypeAlias = Callable[[Outcome], float | Mapping[str, float]]
"""The reward of an outcome: a number, or named terms whose sum it is, with the same names every time."""

Terms: TypeAlias = Callable[[Outcome], Mapping[str, float]]
"""The named terms of an outcome, each a finite number."""

WEIGHTS: Final[Mapping[str, float]] = {
    "packed": 1.0,
    "utilization": 1.0,
    "complete": 1.0,
    "outside": 1.0,
    "collision": 1.0,
    "left_over": 0.0,
    "invalid": 0.1,
}
"""Weights of the default terms."""


@dataclass(frozen=True)
class WeightedReward:
    """The default terms, weighted.

    =============  ============================================================================
    term           before its weight
    =============  ============================================================================
    packed         the share of the order's pieces that was placed now
    utilization    the share of the container's volume that was placed now
    complete       1 at the end of an episode in which every piece was packed and stayed inside
    outside        minus both shares of pieces that now stick out of the container
    collision      -1 where the robot or the held item met something
    left_over      minus the share of the order's pieces that was given up now
    invalid        -1 for an invalid action
    =============  ============================================================================

    With the default weights the sum over an episode without invalid actions is the share of pieces packed,
    plus the utilization, plus 1 for a complete order: 0 to 3.

    Attributes:
        weights: by term.
    """

    weights: tuple[tuple[str, float], ...] = tuple(WEIGHTS.items())

    def __call__(self, outcome: Outcome) -> dict[str, float]:
        """The terms of an outcome."""
        n = max(outcome.pieces, 1)
        raw = {
            "packed": outcome.placed / n,
            "utilization": outcome.placed_volume,
            "complete": float(outcome.ended and outcome.complete),
            "outside": -(outcome.outside / n + outcome.outside_volume),
            "collision": -float(outcome.collided),
            "left_over": -outcome.left_over / n,
            "invalid": -float(outcome.invalid),
        }
        return {name: weight * raw[name] + 0.0 for name, weight in self.weights}


@dataclass(frozen=True)
class OwnReward:
    """The terms of a user's own function; a number that stands alone is the term ``custom``.

    Attributes:
        function: what the user gave.
    """

    function: RewardFn

    def __call__(self, outcome: Outcome) -> dict[str, float]:
        """The terms of an outcome.

        Raises:
            InputError: the function returned something else than finite numbers.
        """
        returned: object = self.function(outcome)
        if not isinstance(returned, Mapping):
            number = _finite(returned)
            if number is None:
                raise InputError(
                    f"reward_fn returned {returned!r:.60}, give a finite number, or finite numbers by name "
                    "such as {'packed': 1.0}"
                )
            return {"custom": number}
        terms: dict[str, float] = {}
        for name, value in returned.items():
            number = _finite(value)
            if number is None or not isinstance(name, str):
                raise InputError(
                    f"reward_fn returned {value!r:.60} as its term {name!r:.60}, give finite numbers by name "
                    "such as {'packed': 1.0}"
                )
            terms[name] = number
        return terms


def make_reward(choice: RewardFn | Mapping[str, Any] | str | None) -> Terms:
    """The reward that a choice names.

    Args:
        choice: a function of the outcome, or its name as ``my_module:my_reward``; or weights by term, what is
            left out keeping its default; or None.

    Raises:
        InputError: an unknown term, a weight that is no number, or no such function.
    """
    if isinstance(choice, str):
        found = load_extension(choice, "reward_fn")
        if not callable(found):
            raise InputError(f"reward_fn {choice}: is {found!r:.60}, name a function of the outcome")
        return OwnReward(found)
    if callable(choice):
        return OwnReward(choice)
    if choice is not None and not isinstance(choice, Mapping):
        raise InputError(
            f"reward_fn is {choice!r:.60}, give weights by term, a function of the outcome, or its name as "
            "my_module:my_reward"
        )
    weights = dict(WEIGHTS)
    for name, weight in (choice or {}).items():
        if name not in weights:
            raise InputError(f"reward_fn has no term {name!r:.60}, it has {', '.join(WEIGHTS)}")
        if not is_number(weight) or not abs(weight) < 1e6:
            raise InputError(f"reward_fn: the weight of {name} is {weight!r:.60}, give a finite number")
        weights[name] = float(weight)
    return WeightedReward(tuple(weights.items()))


def _finite(value: object) -> float | None:
    """A finite number; None for anything else, True and False included."""
    return float(value) if is_number(value) else None
