"""One item on one pile: its candidates are put to the constraints, and one of them is placed (paper Alg. 3).

The planner and the environment's episodes both go this way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.packing import Pile
from packenv.planning.search.candidates import Candidates
from packenv.planning.sequence import Piece
from packenv.types import BoolArray, OrientedItem, Placement

ORIENTATION = "orientation-"
"""Prefix of the reasons that rule out whole orientations; such candidates were never checked."""

Question: TypeAlias = tuple[bytes, int, int]
"""A candidate of one item on one pile: its rotation, and its smallest x and y in µm."""


def question(trial: Trial) -> Question:
    """What a candidate is remembered by: its lowest z follows from these."""
    x, y, _ = trial.corner.tolist()
    return trial.oriented.rotation.tobytes(), round(x * 1e6), round(y * 1e6)


@dataclass(frozen=True, eq=False)
class Answer:
    """What the constraints say of a candidate.

    Attributes:
        ok: whether it may be placed.
        reason: the first objection, a word for programs; empty where there is none.
        verdicts: one for each constraint, in their order; empty unless ``ok``, and where the answer was
            remembered from another pile of the same kind.
    """

    ok: bool
    reason: str
    verdicts: tuple[Verdict, ...]


class Memory:
    """Objections to candidates on one pile that comes again and again, such as the empty container."""

    def __init__(self) -> None:
        """Remember nothing yet."""
        self._reasons: WeakKeyDictionary[OrientedItem, dict[tuple[int, int], str]] = WeakKeyDictionary()

    def of(self, oriented: OrientedItem) -> dict[tuple[int, int], str]:
        """Why a translation, in cells, is no valid candidate; an empty word where it is one. May grow."""
        return self._reasons.setdefault(oriented, {})


class Inquiry:
    """Puts the candidates of one item on one pile to the constraints; nothing is asked twice.

    Attributes:
        constraints: all of them, in the order in which they are asked.
        pile: what the container holds.
        rejections: how many candidates, and orientations, were rejected, by reason.
        asked: candidates that were put to the constraints.
    """

    def __init__(
        self,
        constraints: Sequence[Constraint],
        pile: Pile,
        *,
        rejections: Mapping[str, int] | None = None,
        memory: Memory | None = None,
    ) -> None:
        """Ask nothing yet.

        Args:
            constraints: a candidate must pass all.
            pile: what the container holds.
            rejections: counts to go on from.
            memory: of this pile, where it comes again and again.
        """
        self.constraints = tuple(constraints)
        self.pile = pile
        self.rejections = Counter(rejections or {})
        self.asked = 0
        self._memory = memory
        # By identity: an own constraint may be a dataclass, which has no hash.
        self._known: dict[int, tuple[Constraint, dict[Question, Verdict]]] = {}
        self._answers: dict[Question, Answer] = {}
        self._objected: dict[bytes, bool] = {}

    def objected(self, oriented: OrientedItem) -> bool:
        """Whether a constraint rules the whole orientation out: its candidates are then not checked."""
        rotation = oriented.rotation.tobytes()
        known = self._objected.get(rotation)
        if known is None:
            reason = objection(self.constraints, oriented)
            if reason is not None:
                self.rejections[f"{ORIENTATION}{reason}"] += 1
            known = self._objected[rotation] = reason is not None
        return known

    def was_objected(self, oriented: OrientedItem) -> bool:
        """Whether an orientation was asked about and ruled out."""
        return self._objected.get(oriented.rotation.tobytes(), False)

    def possible(self, orientations: Iterable[OrientedItem]) -> list[OrientedItem]:
        """The orientations that no constraint rules out wherever the item would lie."""
        if not self.constraints:
            return list(orientations)
        return [oriented for oriented in orientations if not self.objected(oriented)]

    def screened(self, candidates: Candidates) -> BoolArray:
        """(n,) candidates that are worth a question; the others are counted as rejected."""
        open_ = np.ones(len(candidates), dtype=np.bool_)
        for constraint, state in zip(self.constraints, self.pile.states, strict=True):
            refused = constraint.refused(candidates, state)
            if refused is not None and (count := int((open_ & refused).sum())):
                self.rejections[constraint.refusal] += count
                open_ &= ~refused
        return open_

    def ask(self, trial: Trial, rules: Sequence[Constraint] | None = None) -> Answer:
        """Whether a candidate passes.

        Args:
            trial: the candidate.
            rules: asked in place of the constraints, one for each, on the same states; None asks those.
        """
        if rules is not None:
            return self._ask(trial, rules)
        asked = question(trial)
        known = self._answers.get(asked)
        if known is None:
            known = self._answers[asked] = self._remembered(trial)
            self.asked += 1
        return known

    def verdicts(self, trial: Trial) -> tuple[Verdict, ...]:
        """What each constraint says of a candidate that passes.

        Raises:
            ValueError: it does not pass.
        """
        answer = self.ask(trial)
        if answer.ok and len(answer.verdicts) < len(self.constraints):
            answer = self._ask(trial, self.constraints)
        if not answer.ok:
            raise ValueError(f"the candidate at {trial.corner.tolist()} does not pass all constraints")
        return answer.verdicts

    def refused(self, rules: Sequence[Constraint]) -> Iterator[Question]:
        """The candidates that one of these has refused."""
        for rule in dict.fromkeys(map(id, rules)):
            known = self._known[rule][1] if rule in self._known else {}
            yield from (asked for asked, verdict in known.items() if not verdict.ok)

    def _remembered(self, trial: Trial) -> Answer:
        if self._memory is None:
            return self._ask(trial, self.constraints)
        reasons, place = self._memory.of(trial.oriented), (trial.ix, trial.iy)
        if place in reasons:
            if reasons[place]:
                self.rejections[reasons[place]] += 1
            return Answer(not reasons[place], reasons[place], ())
        answer = self._ask(trial, self.constraints)
        reasons[place] = answer.reason
        return answer

    def _ask(self, trial: Trial, rules: Sequence[Constraint]) -> Answer:
        asked = question(trial)
        verdicts: list[Verdict] = []
        for rule, state in zip(rules, self.pile.states, strict=True):
            _, known = self._known.setdefault(id(rule), (rule, {}))
            verdict = known.get(asked)
            if verdict is None:
                verdict = known[asked] = rule.check(trial, self.pile.surface, state)
                if not verdict.ok:
                    self.rejections[verdict.reason or rule.name] += 1
            if not verdict.ok:
                return Answer(False, verdict.reason or rule.name, ())
            verdicts.append(verdict)
        return Answer(True, "", tuple(verdicts))


def objection(constraints: Iterable[Constraint], oriented: OrientedItem) -> str | None:
    """The first constraint's word against a whole orientation; None where there is none."""
    found = (constraint.objection(oriented) for constraint in constraints)
    return next((reason for reason in found if reason is not None), None)


def barrier(constraints: Iterable[Constraint], items: Iterable[PreparedItem]) -> str | None:
    """Why a constraint lets none of some items into the empty container; None where none says so."""
    # A box's diagonal is as tall as anything in it can be.
    sizes = [float(np.linalg.norm(item.orientations[0].extents)) for item in items]
    found = (constraint.barrier(max(sizes, default=0.0)) for constraint in constraints)
    return next((why for why in found if why is not None), None)


def place(
    piece: Piece,
    trial: Trial,
    inquiry: Inquiry,
    verdicts: Sequence[Verdict],
    *,
    score: float,
    candidates: int,
    route: str,
    checked: int,
    notes: Mapping[str, object] | None = None,
) -> tuple[Placement, Pile]:
    """Place a candidate that passes.

    Args:
        piece: of the order.
        trial: the candidate.
        inquiry: what was asked about it.
        verdicts: what each constraint said of it.
        score: the heuristic's.
        candidates: number of legal candidates that were compared.
        route: as in :class:`packenv.types.Placement`.
        checked: likewise.
        notes: further details.

    Returns:
        the placement, and the pile with it.
    """
    surface = next((v.surface for v in reversed(verdicts) if v.surface is not None), None)
    if surface is None:
        surface = inquiry.pile.surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z)
    figures = {
        c.name: dict(v.details) for c, v in zip(inquiry.constraints, verdicts, strict=True) if v.details
    }
    oriented = trial.oriented
    placement = Placement(
        item=piece.item,
        instance=piece.instance,
        rotation=oriented.rotation,
        position=trial.position,
        corner=trial.corner,
        extents=oriented.extents,
        pose_index=oriented.pose_index,
        yaw=oriented.yaw,
        score=score,
        candidates=candidates,
        route=route,
        checked=checked,
        rejections=dict(inquiry.rejections),
        details={**figures, **(notes or {})},
        path=next((v.path for v in verdicts if v.path is not None), None),
    )
    return placement, Pile(surface, tuple(verdict.state for verdict in verdicts))
