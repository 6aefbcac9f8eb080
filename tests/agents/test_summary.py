"""Intervals against tables and another library; the table's lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from packenv.agents.running import EpisodeRecord
from packenv.agents.summary import mean, proportion, summarize, table


def record(packed: int, reward: float, *, agent: str = "hm", steps: int = 10) -> EpisodeRecord:
    return EpisodeRecord(
        agent=agent,
        episode=0,
        seed=0,
        container="0.32x0.32x0.3",
        items=10,
        packed=packed,
        left_over=("apple",) * (10 - packed),
        utilization=packed / 40,
        total_reward=reward,
        steps=steps,
        invalid_actions=0,
        truncated=False,
        seconds=0.5,
    )


@pytest.mark.parametrize(("hits", "trials"), [(0, 5), (5, 5), (1, 20), (17, 20), (150, 300)])
def test_a_share_has_wilsons_interval(hits: int, trials: int) -> None:
    """Its ends are the shares that lie 1.96 of their own standard deviations off the one that was found."""
    ours = proportion(hits, trials)
    assert ours.mean == hits / trials
    assert 0.0 <= ours.low <= ours.mean <= ours.high <= 1.0
    for end in (ours.low, ours.high):
        if end != ours.mean:
            off = stats.norm.ppf(0.975) * np.sqrt(end * (1 - end) / trials)
            assert abs(end - ours.mean) == pytest.approx(off, abs=1e-12)


@pytest.mark.parametrize("n", [2, 5, 40])
def test_a_mean_has_students_interval(n: int) -> None:
    values = np.random.default_rng(n).normal(3, 2, n)
    ours = mean(values.tolist())
    theirs = stats.ttest_1samp(values, 0.0).confidence_interval()
    assert ours.mean == pytest.approx(values.mean())
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high))


def test_one_episode_tells_nothing_of_the_spread() -> None:
    assert (mean([3.0]).low, mean([3.0]).high) == (None, None)
    lines = table([summarize("hm", [record(10, 2.2)])]).splitlines()
    assert "±" not in lines[1]


def test_figures_are_those_of_the_records() -> None:
    found = summarize("hm", [record(10, 2.0, steps=10), record(5, 1.0, steps=30)])
    assert found.episodes == 2
    assert found.complete.mean == 0.5
    assert found.packed_share.mean == 0.75
    assert found.utilization.mean == pytest.approx(15 / 80)
    assert found.total_reward.mean == 1.5
    assert found.steps.mean == 20
    assert found.steps_per_s == 40  # 40 steps in 2 × 0.5 s


def test_columns_of_the_table_stand_under_each_other() -> None:
    rows = [
        summarize("hm", [record(10, 2.0), record(9, 1.0)]),
        summarize("first-fit", [record(10, -10.0), record(1, 100.0)]),
    ]
    lines = table(rows).splitlines()
    assert len(lines) == 3
    assert len({len(line) for line in lines}) == 1
    assert [line.split()[0] for line in lines] == ["agent", "hm", "first-fit"]


def test_a_record_survives_its_row() -> None:
    import json

    from packenv.agents.running import record_row

    before = record(7, 1.5)
    row = json.loads(json.dumps(record_row("k", before)))
    assert row["key"] == "k"
    assert EpisodeRecord.of_row(row) == before
    assert math.isclose(EpisodeRecord.of_row(row).seconds, before.seconds)
