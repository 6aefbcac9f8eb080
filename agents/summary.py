"""What many episodes say of an agent: means with 95 % intervals, as a table and as JSON."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from .running import EpisodeRecord


@dataclass(frozen=True)
class Estimate:
    """A mean with its 95 % interval.

    Attributes:
        mean: over the episodes.
        low: lower end; None where one episode tells nothing of the spread.
        high: upper end, likewise.
    """

    mean: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class AgentSummary:
    """One line of the table.

    Attributes:
        agent: its name.
        episodes: how many were run.
        complete: share of the orders that were packed whole (Wilson's interval).
        packed_share: share of an order's items that were placed (this and what follows: Student's interval).
        utilization: volume of the placed items as a share of the container's.
        total_reward: undiscounted return.
        steps: actions of an episode.
        steps_per_s: all steps by the wall time of all choices and steps, resets not counted.
    """

    agent: str
    episodes: int
    complete: Estimate
    packed_share: Estimate
    utilization: Estimate
    total_reward: Estimate
    steps: Estimate
    steps_per_s: float


def summarize(agent: str, records: Sequence[EpisodeRecord]) -> AgentSummary:
    """Sum up the episodes of one agent; at least one."""
    seconds = sum(record.seconds for record in records)
    return AgentSummary(
        agent=agent,
        episodes=len(records),
        complete=proportion(sum(record.complete for record in records), len(records)),
        packed_share=mean([record.packed / record.items for record in records]),
        utilization=mean([record.utilization for record in records]),
        total_reward=mean([record.total_reward for record in records]),
        steps=mean([float(record.steps) for record in records]),
        steps_per_s=sum(record.steps for record in records) / seconds,
    )


def proportion(hits: int, trials: int) -> Estimate:
    """A share with Wilson's score interval, which stays inside 0 to 1 even at the ends."""
    from scipy.stats import binomtest

    interval = binomtest(hits, trials).proportion_ci(method="wilson")
    return Estimate(hits / trials, float(interval.low), float(interval.high))


def mean(values: Sequence[float]) -> Estimate:
    """A mean with Student's interval."""
    middle = statistics.fmean(values)
    if len(values) == 1:
        return Estimate(middle, None, None)
    from scipy.special import stdtrit

    half = float(stdtrit(len(values) - 1, 0.975)) * statistics.stdev(values) / math.sqrt(len(values))
    return Estimate(middle, middle - half, middle + half)


def table(summaries: Sequence[AgentSummary]) -> str:
    """One line an agent, under a heading."""
    rows = [("agent", "episodes", "packed whole", "packed", "utilization", "return", "steps", "steps/s")]
    rows += [
        (
            s.agent,
            str(s.episodes),
            f"{s.complete.mean:.1%} ({s.complete.low:.1%} to {s.complete.high:.1%})",
            _with_half(s.packed_share, "{:.1%}"),
            _with_half(s.utilization, "{:.1%}"),
            _with_half(s.total_reward, "{:.3f}"),
            _with_half(s.steps, "{:.1f}"),
            f"{s.steps_per_s:.1f}",
        )
        for s in summaries
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(_line(row, widths) for row in rows)


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    """The name to the left, figures to the right."""
    figures = (f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True))
    return "  ".join((f"{row[0]:<{widths[0]}}", *figures))


def _with_half(estimate: Estimate, form: str) -> str:
    middle = form.format(estimate.mean)
    if estimate.high is None:
        return middle
    return f"{middle} ± {form.format(estimate.high - estimate.mean)}"
