"""Intervals and tests of experiments, against closed forms and published examples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from packenv.experiments.statistics import (
    Group,
    Trial,
    compare,
    line,
    mcnemar,
    mean_interval,
    wilson,
)

GROUP = Group("overlap", "default")


@pytest.mark.parametrize(
    ("hits", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),  # Newcombe 1998, Table I, method 3
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_intervals_of_shares_are_those_that_newcombe_published(
    hits: int, n: int, low: float, high: float
) -> None:
    assert wilson(hits, n) == pytest.approx((low, high), abs=5e-5)


def test_of_no_trials_nothing_is_known() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("a", "b"), [(0, 0), (1, 0), (5, 1), (12, 3), (7, 7), (0, 6)])
def test_mcnemar_is_the_two_sided_tail_of_a_fair_coin(a: int, b: int) -> None:
    n, k = a + b, min(a, b)
    tail = 2 * sum(math.comb(n, i) for i in range(k + 1)) / 2**n
    assert mcnemar(a, b) == pytest.approx(min(1.0, tail))
    assert mcnemar(a, b) == mcnemar(b, a)


def test_the_bootstrap_agrees_with_the_normal_interval_of_many_orders() -> None:
    values = np.random.default_rng(1).normal(0.3, 1.0, 400)
    low, high = mean_interval(values)
    half = 1.96 * values.std() / 20.0
    assert (low + high) / 2 == pytest.approx(values.mean(), abs=0.1 * half)
    assert (high - low) / 2 == pytest.approx(half, rel=0.05)


def test_a_mean_of_equal_values_has_no_width() -> None:
    assert mean_interval(np.zeros(5)) == (0.0, 0.0)
    assert mean_interval(np.array([0.4])) == (0.4, 0.4)


def _trials(successes: str, cpu_s: float = 1.0) -> dict[int, Trial]:
    return {k: Trial(c == "1", cpu_s * (1 + k)) for k, c in enumerate(successes)}


def test_methods_are_compared_on_the_orders_that_both_have() -> None:
    a, b = _trials("11101", 2.0), _trials("10011", 1.0)
    del b[4]
    found = compare("a", "b", GROUP, a, b)
    assert found is not None
    assert (found.n, found.a_only, found.b_only, found.difference) == (4, 2, 1, 0.25)
    assert found.time_ratio == pytest.approx(2.0)
    assert found.time_ratio_ci95 == pytest.approx((2.0, 2.0))
    assert found.difference_ci95[0] <= found.difference <= found.difference_ci95[1]


def test_a_comparison_turned_round_says_the_same() -> None:
    a, b = _trials("110111010111", 1.5), _trials("100111110001", 1.0)
    one, other = compare("a", "b", GROUP, a, b), compare("b", "a", GROUP, b, a)
    assert one is not None
    assert other is not None
    assert one.p == other.p
    assert one.difference == -other.difference
    assert one.time_ratio == pytest.approx(1 / other.time_ratio)


def test_methods_without_a_common_order_are_not_compared() -> None:
    assert compare("a", "b", GROUP, {0: Trial(True, 1.0)}, {1: Trial(True, 1.0)}) is None


def test_a_line_sums_up_its_orders() -> None:
    found = line("hm", GROUP, [Trial(True, 1.0), Trial(False, 3.0), Trial(True, 8.0)], paper_success=0.9)
    assert (found.n, found.success, found.paper_success) == (3, pytest.approx(2 / 3), 0.9)
    assert (found.cpu_s_median, found.cpu_s_mean, found.cpu_s_max) == (3.0, 4.0, 8.0)
    assert found.ci95 == wilson(2, 3)
