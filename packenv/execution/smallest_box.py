"""One order, one of several boxes: the smallest one that is found to take all items (``--container auto``)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from packenv.execution.planning_job import PlanningJob
from packenv.planning.packing import Packing
from packenv.types import Container


def pack_smallest(job: PlanningJob, boxes: Sequence[Container], sequence: Sequence[str]) -> Packing:
    """The packing in the smallest container that is found to take all, else in the largest.

    Without a budget it is the first one, from the smallest on, whose plan has all items. With one the goal is searched
    for there; where that is all items, or the smallest box, smaller ones are searched.

    Args:
        job: packs; its items are loaded.
        boxes: the smallest first, at least one.
        sequence: item names, a name as often as the order has it.
    """
    options = job.options
    rest = _Rest(options.budget, options.plans)
    if len(boxes) == 1 or options.method not in ("auto", "search") or not rest.given:
        return job.smallest_for_all(boxes[:-1], sequence) or job.pack(boxes[-1], sequence)
    first = job.smallest_for_all(boxes, sequence)
    if options.goal in ("height", "robust"):
        return job.pack(boxes[-1] if first is None else first.container, sequence)
    best = first or rest.half(job).pack(boxes[-1], sequence)
    if not best.complete:
        return best
    volume = sum(job.shelf.prepared[name].volume for name in sequence)
    smaller = [box for box in boxes if volume <= box.volume < best.container.volume]
    while smaller:
        box = smaller.pop()
        found = (rest.half(job) if smaller else rest.all(job)).pack(box, sequence)
        if found.complete:
            best = found
            told = "takes all"
        else:
            told = f"does not take all: {len(found.placements)} of {len(sequence)} items is the most that was found"
        job.watcher.remark(f"box {box.full_label} {told}")
    return best


@dataclass(eq=False)
class _Rest:
    """What is left of a budget.

    Attributes:
        seconds: as in :class:`packenv.planning.anytime.Budget`.
        plans: likewise.
    """

    seconds: float | None
    plans: int | None

    def __post_init__(self) -> None:
        self._began = time.monotonic()

    @property
    def given(self) -> bool:
        """Whether there is a budget."""
        return self.seconds is not None or self.plans is not None

    def half(self, job: PlanningJob) -> PlanningJob:
        """The job with half of it; what it takes no time for stays."""
        plans = None if self.plans is None else self.plans // 2
        self.plans = None if self.plans is None or plans is None else self.plans - plans
        return self._job(job, 0.5, plans)

    def all(self, job: PlanningJob) -> PlanningJob:
        """The job with all of it."""
        plans, self.plans = self.plans, 0
        return self._job(job, 1.0, plans)

    def _job(self, job: PlanningJob, share: float, plans: int | None) -> PlanningJob:
        spent = time.monotonic() - self._began
        seconds = None if self.seconds is None else share * max(0.0, self.seconds - spent)
        return replace(job, options=replace(job.options, restarts=0, budget=seconds, plans=plans, goal="box"))
