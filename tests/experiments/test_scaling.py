"""The queue simulation: laws of sharing work out, and a real run that it foretells."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from packenv.backends import imap_unordered
from packenv.errors import InputError
from packenv.experiments.scaling import (
    WORKERS,
    Costs,
    drawn,
    job_times,
    least_wall,
    queue,
    shards,
    simulate,
    worth,
)
from tests.conftest import REPO

FREE = Costs(0.0, 0.0, 0.0, 0.0)
seconds = st.floats(0.001, 1000.0)
job_lists = st.lists(seconds, min_size=1, max_size=60)
order_lists = st.lists(st.tuples(seconds, seconds, seconds), min_size=1, max_size=30)
numbers = st.integers(1, 40)
some_costs = st.builds(Costs, *[st.floats(0.0, 10.0)] * 4)
EXACT = {"rel": 1e-9}


def _greedy(times: list[float], workers: int) -> float:
    """List scheduling as the textbooks have it: the next job goes to whoever is free first."""
    free = [0.0] * workers
    for t in times:
        free[free.index(min(free))] += t
    return max(free)


@given(job_lists, some_costs)
def test_one_worker_takes_the_sum_of_all(times: list[float], costs: Costs) -> None:
    n = len(times)
    total = costs.begin + costs.start + sum(times) + n * costs.row + (n - 1) * costs.wait
    assert queue(times, 1, costs).wall_s == pytest.approx(total, **EXACT)


@given(order_lists, some_costs)
def test_one_shard_takes_the_sum_of_all(orders: list[tuple[float, ...]], costs: Costs) -> None:
    total = costs.begin + costs.start + sum(map(sum, orders)) + 3 * len(orders) * costs.row
    assert shards(orders, 1, costs).wall_s == pytest.approx(total, **EXACT)


@given(job_lists, numbers)
def test_a_queue_without_costs_is_list_scheduling(times: list[float], workers: int) -> None:
    assert queue(times, workers, FREE).wall_s == pytest.approx(_greedy(times, workers), **EXACT)


@given(job_lists, numbers)
def test_a_queue_keeps_grahams_bound(times: list[float], workers: int) -> None:
    """Graham, Bounds for certain multiprocessing anomalies, 1966: at most 2 - 1/N of the best."""
    wall, least = queue(times, workers, FREE).wall_s, least_wall(times, workers)
    assert least * (1 - 1e-9) <= wall <= (2 - 1 / workers) * least * (1 + 1e-9)


@given(job_lists, numbers)
def test_more_workers_are_never_slower_where_nothing_else_costs(times: list[float], workers: int) -> None:
    fewer, more = (queue(times, n, FREE).wall_s for n in (workers, workers + 1))
    assert more <= fewer * (1 + 1e-9)


@given(order_lists, numbers, some_costs)
def test_nothing_beats_the_least_wall_time(
    orders: list[tuple[float, ...]], workers: int, costs: Costs
) -> None:
    times = [t for order in orders for t in order]
    least = (costs.begin + costs.start + least_wall(times, workers)) * (1 - 1e-9)
    assert queue(times, workers, costs).wall_s >= least
    assert shards(orders, workers, costs).wall_s >= least


@given(job_lists, numbers, some_costs)
def test_the_driver_writes_one_row_after_another(times: list[float], workers: int, costs: Costs) -> None:
    least = costs.begin + costs.start + min(times) + len(times) * costs.row
    assert queue(times, workers, costs).wall_s >= least * (1 - 1e-9)


@given(order_lists, numbers, some_costs)
def test_efficiency_is_the_share_of_machine_time_in_jobs(
    orders: list[tuple[float, ...]], workers: int, costs: Costs
) -> None:
    times = [t for order in orders for t in order]
    for found in (queue(times, workers, costs), shards(orders, workers, costs)):
        assert found.efficiency == pytest.approx(sum(times) / found.machine_s, **EXACT)
        assert 0.0 < found.efficiency <= 1.0 + 1e-9
        assert found.machine_s <= workers * found.wall_s * (1 + 1e-9)


def test_graham_worst_case_is_reached() -> None:
    """N (N - 1) jobs of 1 and one of N at the end: 2 N - 1 where N would do."""
    n = 5
    times = [1.0] * (n * (n - 1)) + [float(n)]
    assert queue(times, n, FREE).wall_s == 2 * n - 1
    assert queue(sorted(times, reverse=True), n, FREE).wall_s == n == least_wall(times, n)


def test_it_foretells_a_real_run() -> None:
    times = [0.02 * (1 + k * 7 % 11) for k in range(24)]
    start = time.perf_counter()
    done = imap_unordered(
        _wait, times, backend="pebble", workers=3, timeout=60, prepare=_nothing, arguments=()
    )
    seconds = [outcome.seconds for outcome in done]
    wall = time.perf_counter() - start
    assert len(seconds) == len(times)
    foretold = queue(times, 3, FREE).wall_s
    assert foretold <= wall <= 1.3 * foretold + 0.5


def _wait(seconds: float) -> dict[str, Any]:
    time.sleep(seconds)
    return {}


def _nothing() -> None:
    pass


def _rows(folder: Path) -> Path:
    head = {"constraints": "overlap", "setting": "default", "items": "all"}
    rows = [
        {"key": "a", "status": "ok", "method": "hm", "seconds": 9.0, **head},
        {"key": "b", "status": "ok", "method": "hm", "seconds": 2.0, **head},
        {"key": "c", "status": "ok", "method": "gls", "seconds": 5.0, **head},
        {"key": "d", "status": "timeout", "method": "gls", "seconds": 1800.0, **head},
        {"key": "a", "status": "ok", "method": "hm", "seconds": 1.0, **head},  # done again
    ]
    folder.mkdir()
    (folder / "planning.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def test_times_are_the_last_ones_of_jobs_that_went_well(tmp_path: Path) -> None:
    times = job_times([_rows(tmp_path / "run")])
    assert list(times.values()) == [[1.0, 2.0], [5.0]]
    orders = drawn(times, 500)
    assert {order[0] for order in orders} == {1.0, 2.0}
    assert {order[1] for order in orders} == {5.0}
    assert orders == drawn(times, 500) != drawn(times, 500, seed=1)
    assert drawn(times, 500, scale=2.0) == [(2 * a, 2 * b) for a, b in orders]
    with pytest.raises(InputError, match="no row of a job that went well"):
        job_times([tmp_path / "nothing"])


def test_where_it_stops_to_be_worth_it() -> None:
    found = simulate([(1.0,)] * 8, FREE, (1, 2, 4, 8, 16, 32))
    assert found["worth"] == {"queue": 16, "longest_first": 16, "shards": 8}
    assert worth([]) == 0


def test_the_program(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    picture = tmp_path / "scaling.svg"
    words = ["-m", "packenv.experiments.scaling", str(_rows(tmp_path / "run")), "--orders", "40"]
    environment = {**os.environ, "PYTHONPATH": str(REPO)}

    def printed(*more: str) -> str:
        out = subprocess.run(
            [sys.executable, *words, *more], env=environment, check=True, capture_output=True, text=True
        )
        return out.stdout

    found = json.loads(printed("--json", "--svg", str(picture), "--row", "0.5"))
    assert found["orders"] == 40
    assert found["jobs"] == 80
    assert found["costs"]["row"] == 0.5
    assert [kind["n"] for kind in found["kinds"]] == [2, 1]
    assert [point["workers"] for point in found["queue"]] == list(WORKERS)
    assert picture.read_text().startswith("<?xml")
    assert "At least half of the time goes into jobs" in printed()
