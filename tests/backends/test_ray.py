"""Jobs on Ray, on one of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path

import psutil
import pytest

from packenv.backends import imap_unordered, ray_pool
from packenv.errors import InputError, RobotPackError
from tests.backends.samples import (
    TIMEOUT,
    Job,
    endless_run,
    prepare,
    processes_of,
    run,
    run_with_one_killed,
    told,
    until,
    work,
)
from tests.conftest import REPO

pytest.importorskip("ray", reason="Ray is not installed")


@pytest.fixture(scope="class")
def shared_ray() -> Iterator[None]:
    """One Ray for several tests: it takes seconds to start."""
    ray_pool.load()
    with ray_pool.connected(3, None):
        yield


@pytest.mark.usefixtures("shared_ray")
class TestOnOneRay:
    @pytest.mark.parametrize("workers", [1, 2, 3])
    def test_the_outcomes_are_those_of_one_process(self, workers: int) -> None:
        acts = ["square", "raise", "square", "hang", "square", "square", "raise"]
        jobs = [Job(k, act) for k, act in enumerate(acts)]
        assert told(run("ray", jobs, workers)) == told(run("serial", jobs))

    def test_a_job_that_takes_its_process_down_costs_its_own_row_alone(
        self, capfd: pytest.CaptureFixture[str]
    ) -> None:
        acts = ["square", "die", "square", "crash", "square", "exit", "square", "hang", "square"]
        outcomes = run("ray", [Job(k, act) for k, act in enumerate(acts)])
        bad = {1: "died", 3: "died", 5: "failed", 7: "timeout"}
        assert [o.status for o in outcomes] == [bad.get(k, "ok") for k in range(len(acts))]
        assert outcomes[1].error == "its process died"
        assert outcomes[5].error == "SystemExit: enough"
        assert all(o.row == {"square": o.job.number**2} for o in outcomes if o.job.number not in bad)
        assert capfd.readouterr() == ("", "")

    def test_time_counts_from_the_start_of_a_job(self) -> None:
        outcomes = run("ray", [Job(k, "nap") for k in range(4)], 1)
        assert {o.status for o in outcomes} == {"ok"}
        assert all(0.6 * TIMEOUT <= o.seconds < TIMEOUT for o in outcomes)

    def test_a_slow_consumer_costs_no_row(self) -> None:
        done = imap_unordered(
            work,
            [Job(k) for k in range(4)],
            backend="ray",
            workers=2,
            timeout=0.3,
            prepare=prepare,
            arguments=(),
        )
        statuses = []
        for outcome in done:
            statuses.append(outcome.status)
            time.sleep(0.4)
        assert statuses == ["ok"] * 4

    def test_a_worker_that_is_killed_from_outside_costs_one_row(self, tmp_path: Path) -> None:
        outcomes = run_with_one_killed("ray", tmp_path)
        assert [o.status for o in outcomes] == ["ok", "died", "ok", "ok"]

    def test_every_process_is_prepared_once_before_its_first_job_and_has_one_thread(self) -> None:
        outcomes = run("ray", [*(Job(k, "who") for k in range(20)), Job(20, "threads")], 3)
        assert {o.row["prepared"] for o in outcomes[:-1] if o.row} == {1}
        assert outcomes[-1].row == {"threads": "1"}

    @pytest.mark.parametrize(
        ("act", "error", "message"),
        [
            ("refuse", InputError, "^there is no such catalogue$"),
            ("raise", RobotPackError, "a worker could not be prepared: KeyError: 'catalogue'"),
            ("die", RobotPackError, "die before their first job"),
        ],
    )
    def test_a_worker_that_cannot_be_prepared_is_told_of(
        self, act: str, error: type[RobotPackError], message: str
    ) -> None:
        with pytest.raises(error, match=message):
            run("ray", [Job(k) for k in range(5)], arguments=(act,))

    def test_more_workers_than_there_is_room_for_cost_nothing(self) -> None:
        jobs = [Job(k) for k in range(12)]
        assert told(run("ray", jobs, 7)) == told(run("serial", jobs))

    def test_jobs_are_taken_as_they_are_needed_and_workers_end_with_the_generator(self) -> None:
        taken, pids = 0, set()

        def jobs() -> Iterator[Job]:
            nonlocal taken
            for k in range(10**9):
                taken += 1
                yield Job(k, "who")

        done = imap_unordered(
            work, jobs(), backend="ray", workers=2, timeout=60, prepare=prepare, arguments=()
        )
        with closing(done):
            pids = {outcome.row["pid"] for outcome in islice(done, 50) if outcome.row}
            assert taken <= 50 + 4
        until(lambda: not any(map(psutil.pid_exists, pids)))

    def test_a_cluster_is_joined_and_left_as_it_was(self) -> None:
        import ray

        address = ray.get_runtime_context().gcs_address
        environment = {**os.environ, "PYTHONPATH": str(REPO)}
        out = subprocess.run(
            [sys.executable, "-c", JOINING, address],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
        assert out.stdout == "[0, 1, 4, 9]\n"
        assert ray.is_initialized()
        assert told(run("ray", [Job(0)])) == told(run("serial", [Job(0)]))


JOINING = """
import sys
from tests.backends.samples import Job, prepare, work
from packenv.backends import imap_unordered

options = dict(workers=None, timeout=60.0, prepare=prepare, arguments=(), ray_address=sys.argv[1])
done = imap_unordered(work, [Job(k) for k in range(4)], backend="ray", **options)
print(sorted(outcome.row["square"] for outcome in done))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_who_is_stopped_takes_all_of_ray_along(tmp_path: Path, number: signal.Signals) -> None:
    with endless_run("ray", tmp_path) as parent:
        parent.send_signal(number)
        assert parent.wait(30.0) != 0
        until(lambda: processes_of(tmp_path) == [])


def test_a_ray_of_our_own_ends_with_the_run() -> None:
    handler, before = signal.getsignal(signal.SIGTERM), _children()
    assert told(run("ray", [Job(k) for k in range(3)])) == told(run("serial", [Job(k) for k in range(3)]))
    assert signal.getsignal(signal.SIGTERM) is handler
    until(lambda: _children() <= before)


def _children() -> set[psutil.Process]:
    return set(psutil.Process().children(recursive=True))


@pytest.mark.parametrize("address", ["127.0.0.1:1", "head"])
def test_a_cluster_that_is_not_there_is_named(address: str) -> None:
    done = imap_unordered(
        work,
        [Job(0)],
        backend="ray",
        workers=1,
        timeout=60,
        prepare=prepare,
        arguments=(),
        ray_address=address,
    )
    with pytest.raises(InputError, match=f"no Ray cluster can be joined at '{address}'"):
        next(done)


@pytest.mark.slow
def test_on_a_cluster_that_shrinks_and_grows_work_goes_on() -> None:
    from ray.cluster_utils import Cluster

    ray_pool.load()
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    lost = cluster.add_node(num_cpus=1)
    jobs = [Job(k, "node") for k in range(80)]
    done = imap_unordered(
        work,
        jobs,
        backend="ray",
        workers=3,
        timeout=30,
        prepare=prepare,
        arguments=(),
        ray_address=cluster.address,
    )
    try:
        outcomes = []
        for outcome in done:
            outcomes.append(outcome)
            if len(outcomes) == 15:
                cluster.remove_node(lost, allow_graceful=False)
            if len(outcomes) == 25:
                cluster.add_node(num_cpus=2)
    finally:
        done.close()
        cluster.shutdown()
    assert {outcome.job for outcome in outcomes} == set(jobs)
    assert len(outcomes) == len(jobs)
    assert sum(outcome.status == "died" for outcome in outcomes) <= 1
    assert len({outcome.row["node"] for outcome in outcomes if outcome.row}) == 3
