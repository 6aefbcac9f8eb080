"""What rows prove: intervals, and differences between methods that got the same orders.

Wilson's interval for a share, McNemar's exact test for two methods on the same orders, and percentile bootstrap
over the orders for the sizes of differences; distributions and resampling are SciPy's.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from packenv.agents.summary import proportion
from packenv.types import FloatArray

from .results import Comparison, Interval, Line

RESAMPLES = 9999
_SEED = 0
_BATCH = 500


class Trial(NamedTuple):
    """One order by one method.

    Attributes:
        success: whether it was packed whole, or carried out.
        cpu_s: CPU-seconds that it took.
    """

    success: bool
    cpu_s: float


@dataclass(frozen=True)
class Group:
    """What lines are told apart by, but for their method.

    Attributes:
        constraints: as in :class:`~packenv.experiments.results.Line`, as all that follow.
        setting: likewise.
        items: likewise.
        world: likewise.
    """

    constraints: str
    setting: str
    items: str = "all"
    world: str = ""


def wilson(hits: int, n: int) -> Interval:
    """The 95 % interval of a share; of no trials it is 0 to 1."""
    if n == 0:
        return 0.0, 1.0
    found = proportion(hits, n)
    assert found.low is not None
    assert found.high is not None
    return found.low, found.high


def mcnemar(a_only: int, b_only: int) -> float:
    """McNemar's exact test, two-sided.

    Args:
        a_only: orders in which the first method alone succeeds.
        b_only: orders in which the second alone does.

    Returns:
        The chance of numbers at least as unlike if both were equally good; 1 where the methods never differ.
    """
    from scipy.stats import binomtest

    return float(binomtest(a_only, a_only + b_only).pvalue) if a_only + b_only else 1.0


def mean_interval(values: FloatArray) -> Interval:
    """The 95 % percentile bootstrap interval of a mean.

    Args:
        values: (n,), one of each order; n ≥ 1. Where all are equal both ends are that value.
    """
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    from scipy.stats import bootstrap

    found = bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        batch=_BATCH,
        method="percentile",
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    return float(found.low), float(found.high)


def line(method: str, group: Group, trials: Sequence[Trial], **others: Any) -> Line:
    """A line of a table.

    Args:
        method: its name.
        group: what it belongs to.
        trials: one of each order, at least one.
        others: further fields of :class:`~packenv.experiments.results.Line`.
    """
    seconds = [trial.cpu_s for trial in trials]
    hits = sum(trial.success for trial in trials)
    return Line(
        method=method,
        constraints=group.constraints,
        setting=group.setting,
        items=group.items,
        world=group.world,
        n=len(trials),
        success=hits / len(trials),
        ci95=wilson(hits, len(trials)),
        cpu_s_median=statistics.median(seconds),
        cpu_s_mean=statistics.fmean(seconds),
        cpu_s_max=max(seconds),
        **others,
    )


def compare(
    a: str, b: str, group: Group, of_a: Mapping[int, Trial], of_b: Mapping[int, Trial]
) -> Comparison | None:
    """Two methods on the orders that both have; None where there are none.

    Args:
        a: name of the first.
        b: name of the second.
        group: what both belong to.
        of_a: trials of the first by the order's index.
        of_b: those of the second.
    """
    both = sorted(of_a.keys() & of_b.keys())
    if not both:
        return None
    pairs = [(of_a[k], of_b[k]) for k in both]
    a_only = sum(x.success and not y.success for x, y in pairs)
    b_only = sum(y.success and not x.success for x, y in pairs)
    wins = np.array([float(x.success) - float(y.success) for x, y in pairs])
    # The clock has ticks: a time of 0 would have no logarithm.
    times = np.array([math.log(max(x.cpu_s, 1e-6) / max(y.cpu_s, 1e-6)) for x, y in pairs])
    low, high = mean_interval(times)
    return Comparison(
        a=a,
        b=b,
        constraints=group.constraints,
        setting=group.setting,
        items=group.items,
        world=group.world,
        n=len(both),
        a_only=a_only,
        b_only=b_only,
        p=mcnemar(a_only, b_only),
        difference=float(wins.mean()),
        difference_ci95=mean_interval(wins),
        time_ratio=math.exp(float(times.mean())),
        time_ratio_ci95=(math.exp(low), math.exp(high)),
    )
