"""Heuristics and constraints of the user's own, behind a guard.

What they are given they cannot change, for it is what the planner works on; what they raise or return by
mistake is one line that names them, the cause, and the line of their file.
"""

from __future__ import annotations

import json
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packenv.errors import InputError, RobotPackError
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.search.candidates import Candidates
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import Heuristic
from packenv.planning.search.measured import Resting
from packenv.types import Container, FloatArray, Item, OrientedItem

Kind = TypeVar("Kind", bound=np.generic)


@dataclass(frozen=True)
class OwnHeuristic:
    """A heuristic of the user's own.

    Attributes:
        rule: the user's.
        label: what messages call it.
    """

    rule: Heuristic
    label: str = field(compare=False)

    def __call__(self, candidates: Candidates, rng: np.random.Generator) -> FloatArray:
        """(n,) scores.

        Raises:
            InputError: it raised, or did not return one finite number for each candidate.
        """
        shown = replace(
            candidates,
            grid_index=_read_only(candidates.grid_index),
            ix=_read_only(candidates.ix),
            iy=_read_only(candidates.iy),
            z=_read_only(candidates.z),
        )
        what = f"heuristic {self.label}"
        with _guarded(what):
            scores = self.rule(shown, rng)
        right = f"give an array of {len(candidates)} finite numbers, one for each candidate"
        if not isinstance(scores, np.ndarray) or scores.shape != (len(candidates),):
            found = (
                f"an array of shape {scores.shape}" if isinstance(scores, np.ndarray) else f"{scores!r:.40}"
            )
            raise InputError(f"{what}: returned {found}, {right}")
        if scores.dtype.kind not in "fiu" or np.ma.isMaskedArray(scores) or not np.isfinite(scores).all():
            raise InputError(f"{what}: returned {scores.dtype} that are not all finite numbers, {right}")
        return scores.astype(np.float64)


class OwnConstraint(Constraint):
    """A constraint of the user's own."""

    def __init__(self, rule: Constraint, label: str) -> None:
        """Guard a constraint.

        Args:
            rule: the user's.
            label: what messages call it.
        """
        self.rule = rule
        self._label = label
        self._what = f"constraint {label}"
        self._shown: tuple[ContainerMap, ContainerMap] | None = None
        with _guarded(self._what):
            self._name = str(rule.name)

    @property
    def name(self) -> str:
        """That of the user's."""
        return self._name

    def for_order(self, items: Mapping[str, Item], container: Container) -> OwnConstraint:
        """As the user's."""
        with _guarded(self._what):
            rule = self.rule.for_order(items, container)
        if not isinstance(rule, Constraint):
            raise InputError(f"{self._what}: for_order returned {rule!r:.60}, give a packenv.Constraint")
        return OwnConstraint(rule, self._label)

    def start(self, resting: Sequence[Resting] = ()) -> Any:
        """As the user's."""
        with _guarded(self._what):
            return self.rule.start(resting)

    def objection(self, oriented: OrientedItem) -> str | None:
        """As the user's."""
        with _guarded(self._what):
            word = self.rule.objection(_shown(oriented))
        if word is not None and (not isinstance(word, str) or not word):
            raise InputError(f"{self._what}: objection returned {word!r:.60}, give a word, or None")
        return word

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """As the user's.

        Raises:
            InputError: it raised, or did not return a verdict that a plan can hold.
        """
        if self._shown is None or self._shown[0] is not surface:
            shown = ContainerMap(surface.container, surface.cell_size, _read_only(surface.heights))
            self._shown = surface, shown
        with _guarded(self._what):
            verdict = self.rule.check(replace(trial, oriented=_shown(trial.oriented)), self._shown[1], state)
        if not isinstance(verdict, Verdict):
            raise InputError(f"{self._what}: check returned {verdict!r:.60}, give a packenv.Verdict")
        if not isinstance(verdict.reason, str):
            raise InputError(f"{self._what}: its reason is {verdict.reason!r:.60}, give a word")
        if verdict.ok and verdict.details:
            try:
                json.dumps(dict(verdict.details), allow_nan=False)
            except (TypeError, ValueError) as problem:
                raise InputError(
                    f"{self._what}: its details cannot be written to a plan ({problem!s:.80}), give numbers, text "
                    "and lists"
                ) from None
        return verdict

    def close(self) -> None:
        """As the user's."""
        with _guarded(self._what):
            self.rule.close()


def _read_only(array: NDArray[Kind]) -> NDArray[Kind]:
    view = array.view()
    view.flags.writeable = False
    return view


def _shown(oriented: OrientedItem) -> OrientedItem:
    return replace(
        oriented,
        rotation=_read_only(oriented.rotation),
        offset=_read_only(oriented.offset),
        extents=_read_only(oriented.extents),
        com=_read_only(oriented.com),
        top=_read_only(oriented.top),
        bottom=_read_only(oriented.bottom),
    )


@contextmanager
def _guarded(what: str) -> Iterator[None]:
    """Turn what the user's code raises into one line."""
    try:
        yield
    except RobotPackError:
        raise
    except (Exception, SystemExit) as problem:
        frames = traceback.extract_tb(problem.__traceback__)
        at = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        raise InputError(f"{what}: {type(problem).__name__}: {problem!s:.200}{at}") from problem
