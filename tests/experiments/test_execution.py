"""Experiments on executions: their jobs, what a row keeps, and what rows say."""

from __future__ import annotations

import itertools
import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from packenv.cli import main
from packenv.errors import InputError
from packenv.execution.execute import ExecutedPlan
from packenv.experiments import execution
from packenv.experiments.columns import COLUMNS, USUAL, chosen
from packenv.experiments.execution_jobs import (
    WORLDS,
    carry_out,
    figures,
    plan_again,
    planned,
    prepare,
    work,
)
from packenv.experiments.execution_tables import Paper, Way, moves, table
from packenv.experiments.spec import RunSpec
from packenv.sim.engines import is_there
from tests.mesh_samples import write_three
from tests.sim.bodies import brick, by_hand, carried_out


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> RunSpec:
    """One order of three items, in this process."""
    folder = tmp_path_factory.mktemp("run")
    write_three(folder)
    asked = RunSpec(
        str(folder),
        orders=1,
        items=3,
        container=(0.2, 0.2, 0.12),
        columns=("paper", "cautious"),
        engine="mujoco",
    )
    prepare(asked, str(folder))
    return asked


def without_time(row: dict[str, Any]) -> dict[str, Any]:
    return {
        name: without_time(value) if isinstance(value, dict) else value
        for name, value in row.items()
        if name not in ("cpu_s", "plan_cpu_s")
    }


def test_a_row_is_the_same_after_json_and_from_whoever_makes_it(spec: RunSpec) -> None:
    for job in execution.jobs(spec):
        row = work(job)
        assert row["planned"]
        assert json.loads(json.dumps(row)) == row
        assert without_time(work(job)) == without_time(row)
        plan = Path(spec.catalogue) / row["plan"]
        assert json.loads(plan.read_text())["steps"]


def test_a_job_is_shown_in_the_world_in_which_it_fails(spec: RunSpec) -> None:
    for job in execution.jobs(spec):
        row, shown = work(job), plan_again(job)
        assert isinstance(shown, ExecutedPlan)
        failed = [world for world in WORLDS if not row[world]["success"]]
        assert shown.success is not bool(failed)
        assert (shown.disturbance is None) is (failed[:1] == ["nominal"])
        assert shown.verdict == (
            "success" if not failed else f"{row[failed[0]]['cause']}: {row[failed[0]]['detail']}"
        )


def test_from_the_command_line_the_second_run_does_nothing_and_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_three(tmp_path)
    words = ["--catalogue", str(tmp_path), "--orders", "1", "--items", "2", "--container", "0.2x0.2x0.12"]
    words += ["--columns", "paper", "cautious", "--engine", "mujoco", "--backend", "serial", "--no-report"]
    told = []
    for _ in range(2):
        assert main(["bench", "execution", *words, "--out", str(tmp_path / "run"), "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1]
    assert [(line["method"], line["world"], line["n"]) for line in told[0]["rows"]] == [
        (column, world, 1) for world in WORLDS for column in ("paper", "cautious")
    ]
    assert len((tmp_path / "run" / "execution.jsonl").read_text().splitlines()) == 2


def test_the_world_of_an_order_is_the_same_in_all_columns(spec: RunSpec) -> None:
    (job, *_) = execution.jobs(spec)
    _, plan = planned(job)
    once = carry_out(job, plan, "disturbed")
    assert without_time(carry_out(replace(job, method="other"), plan, "disturbed")) == without_time(once)
    other = replace(job, index=job.index + 1)
    assert carry_out(other, plan, "disturbed")["shift_m"] != once["shift_m"]
    assert carry_out(other, plan, "nominal")["shift_m"] == carry_out(job, plan, "nominal")["shift_m"]


def test_jobs_take_every_order_in_every_column_and_no_plan_twice_at_once(spec: RunSpec) -> None:
    columns = ("rehearsed", "guarded", "closed-loop")
    jobs = execution.jobs(replace(spec, orders=20, columns=columns))
    assert {(job.method, job.index) for job in jobs} == set(itertools.product(columns, range(20)))
    assert len({job.key for job in jobs}) == len(jobs) == 60
    for a, b in itertools.pairwise(jobs):
        assert a.index != b.index


def test_a_row_tells_the_engine_that_auto_stands_for(spec: RunSpec) -> None:
    jobs = execution.jobs(replace(spec, engine="auto", columns=("guarded", "pack")))
    named = "bullet" if is_there("bullet") else "mujoco"
    assert {job.engine for job in jobs} == {named}
    assert jobs[0].options.engine == named


def test_a_column_that_is_named_twice_is_one() -> None:
    assert [column.name for column in chosen(("script", "paper", "script"))] == ["script", "paper"]


def test_usual_columns_are_compared_with_columns_that_are_run() -> None:
    assert [column.name for column in chosen(())] == list(USUAL)
    for name in USUAL:
        assert COLUMNS[name].against in ("", *USUAL)
    with pytest.raises(InputError, match=r"'closedloop'.*closed-loop"):
        chosen(["closedloop"])


def row(
    column: str, index: int, *, planned: bool = True, success: bool = True, **more: Any
) -> dict[str, Any]:
    """A row as the runner writes it."""
    found = {
        "success": success,
        "cause": "" if success else "collision",
        "detail": "" if success else "mug meets bowl",
        "drop_m": [0.01, 0.03],
        "shift_m": [0.0, 0.004],
        "ends_m": [[0.1, 0.1, 0.0], [0.2, 0.1, 0.0]],
        "plans": 1,
        "cpu_s": 2.0,
    }
    head = {"method": column, "constraints": "robot", "setting": "", "items": "all", "index": index}
    told = {"planned": planned, "plan_cpu_s": 1.0, "left_over": [] if planned else [["mug", "overlap"]]}
    rest = {"nominal": found, "disturbed": found} if planned else {}
    return {"key": f"{column} {index}", "status": "ok", "revision": "1", **head, **told, **rest, **more}


def broken(column: str, index: int) -> dict[str, Any]:
    kept = ("key", "revision", "method", "constraints", "setting", "items", "index")
    return {
        **{name: value for name, value in row(column, index).items() if name in kept},
        "status": "timeout",
        "error": "took 1800 s",
    }


def test_columns_are_compared_on_the_orders_that_all_of_them_planned() -> None:
    rows = [row("paper", 0), row("paper", 1, success=False), row("paper", 2), row("paper", 3, planned=False)]
    rows += [row("cautious", 0), row("cautious", 1), row("cautious", 2, planned=False), row("cautious", 3)]
    rows += [row("paper", 4), broken("cautious", 4)]
    result = execution.summarize(RunSpec(columns=("paper", "cautious")), rows)
    lines = {(line.method, line.world): line for line in result.lines}
    assert {line.n for line in result.lines} == {2}
    assert {name: line.success for name, line in lines.items()} == {
        ("paper", "nominal"): 0.5,
        ("paper", "disturbed"): 0.5,
        ("cautious", "nominal"): 1.0,
        ("cautious", "disturbed"): 1.0,
    }
    nominal = lines["paper", "nominal"]
    assert nominal.paper_success == 0.791
    assert lines["paper", "disturbed"].paper_success is None
    assert nominal.figures["planned, %"] == pytest.approx(80.0)
    assert nominal.figures["drop, cm"] == pytest.approx(2.0)
    assert lines["paper", "disturbed"].figures["shift, cm"] == pytest.approx(0.2)
    assert nominal.figures["failures"] == "collision 1"
    assert [(c.a, c.b, c.n, c.a_only, c.b_only, c.world) for c in result.comparisons] == [
        ("cautious", "paper", 2, 1, 0, "nominal"),
        ("cautious", "paper", 2, 1, 0, "disturbed"),
    ]
    assert nominal.figures["paper: drop, cm"] == 1.36
    assert "paper: drop, cm" not in lines["cautious", "nominal"].figures
    assert result.broken == 1
    why: dict[tuple[str, int], list[str]] = defaultdict(list)
    for failure in result.failures:
        why[failure.method, failure.index].append(failure.why)
    assert why == {
        ("paper", 1): ["nominal: collision, mug meets bowl", "disturbed: collision, mug meets bowl"],
        ("paper", 3): ["left over: mug (overlap)"],
        ("cautious", 2): ["left over: mug (overlap)"],
        ("cautious", 4): ["job timeout: took 1800 s"],
    }
    json.dumps(result.to_json(), allow_nan=False)


def test_orders_of_unseen_items_are_lines_of_their_own() -> None:
    rows = [row("paper", 0), row("paper", 0, success=False, items="unseen")]
    result = execution.summarize(RunSpec(columns=("paper",)), rows)
    nominal = [line for line in result.lines if line.world == "nominal"]
    assert [(line.items, line.success) for line in nominal] == [("all", 1.0), ("unseen", 0.0)]


def test_where_nothing_is_common_there_is_no_line() -> None:
    rows = [row("paper", 0), row("cautious", 0, planned=False)]
    for found in ([], rows):
        assert not execution.summarize(RunSpec(columns=("paper", "cautious")), found).lines


def test_a_column_that_is_not_begun_keeps_no_other_from_its_line() -> None:
    asked = RunSpec(columns=("paper", "cautious"))
    result = execution.summarize(asked, [row("paper", 0), broken("cautious", 0)])
    assert [(line.method, line.n) for line in result.lines] == [("paper", 1), ("paper", 1)]
    assert result.broken == 1


def test_the_table_does_not_depend_on_the_sequence_of_rows() -> None:
    ways = [Way("a", [row("a", k, success=k % 3 > 0) for k in range(9)], paper=Paper(1.0, 1.0, 1.0))]
    ways += [Way("b", [row("b", k, success=k % 2 > 0) for k in range(9)], "a")]
    turned = [replace(way, rows=way.rows[::-1]) for way in ways]
    one, two = (table("t", "T", RunSpec(), way).to_json() for way in (ways, turned))
    assert one["rows"] == two["rows"]
    assert one["comparisons"] == two["comparisons"]


def test_what_collided_counts_in_no_mean() -> None:
    """The robot that holds it has stopped: it neither fell nor slid."""
    first, second = brick(name="first"), brick(name="second")
    tasks = [by_hand(first, (0.1, 0.1, 0.0)), by_hand(second, (0.15, 0.1, 0.0))]
    kept = figures(carried_out(tasks), {"first": first, "second": second})
    assert kept["cause"] == "collision"
    assert kept["drop_m"] == pytest.approx([0.01], abs=3e-4)
    assert len(kept["shift_m"]) == 1
    assert len(kept["ends_m"]) == 2
    assert moves([kept])["drop, cm"] == pytest.approx(1.0, abs=0.03)
    nothing = figures(carried_out([by_hand(brick(), (-0.05, 0.1, 0.0))]), {"brick": brick()})
    assert moves([nothing]) == {"drop, cm": None, "shift, cm": None}
