"""Plans that experiments share: made once, kept as files that a user can carry out."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from typing import Any

import pytest

from packenv import api
from packenv.cli import main
from packenv.experiments import execution
from packenv.experiments.plan_store import PlanStore, fingerprints
from packenv.experiments.shelf import open_shelf
from packenv.io.plans import plan_to_json
from packenv.planning.options import PlanOptions
from packenv.types import Container
from tests.mesh_samples import write_three
from tests.sim.bodies import brick, by_hand, carried_out

ORDER = ("brick", "book", "can")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> PlanStore:
    """An empty store of plans of three items."""
    folder = tmp_path_factory.mktemp("store")
    write_three(folder)
    return PlanStore(folder / "plans", open_shelf(str(folder), "parts"), Container(0.2, 0.2, 0.12))


def test_a_plan_is_made_once_and_read_from_then_on(store: PlanStore, monkeypatch: pytest.MonkeyPatch) -> None:
    first = store.plan(ORDER, PlanOptions())
    assert first.plan.complete
    assert first.cpu_s > 0.0

    def never(*_: object, **__: object) -> None:
        raise AssertionError("planned again")

    monkeypatch.setattr(api, "plan", never)
    again = store.plan(ORDER, PlanOptions())
    assert plan_to_json(again.plan) == plan_to_json(first.plan)
    assert again.cpu_s == first.cpu_s
    for other in (PlanOptions(clearance=0.01), PlanOptions(seed=1)):
        with pytest.raises(AssertionError, match="planned again"):
            store.plan(ORDER, other)
    with pytest.raises(AssertionError, match="planned again"):
        store.plan(ORDER[::-1], PlanOptions())


def test_a_stored_plan_is_one_that_users_can_check_and_carry_out(
    store: PlanStore, capsys: pytest.CaptureFixture[str]
) -> None:
    store.plan(ORDER, PlanOptions(heuristic="dblf"))
    path = max(store.folder.glob("*.json"), key=lambda p: p.stat().st_mtime_ns)
    assert main(["verify", str(path)]) == 0
    capsys.readouterr()
    assert main(["execute", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["placed"] == 3


def row(column: str, index: int, *, planned: bool = True, success: bool = True) -> dict[str, Any]:
    """A row of experiments.execution."""
    found = {
        "success": success,
        "cause": None if success else "collision",
        "drop_m": [0.01, 0.03],
        "shift_m": [0.0, 0.004],
        "plans": 1,
        "cpu_s": 2.0,
    }
    rest = {"nominal": found, "disturbed": found} if planned else {}
    return {"column": column, "index": index, "planned": planned, "plan_cpu_s": 1.0, **rest}


def test_columns_are_compared_on_the_orders_that_all_of_them_planned() -> None:
    rows = [row("paper", 0), row("paper", 1, success=False), row("paper", 2), row("paper", 3, planned=False)]
    rows += [
        row("rehearsed", 0),
        row("rehearsed", 1),
        row("rehearsed", 2, planned=False),
        row("rehearsed", 3),
    ]
    columns = execution.summarize(rows)
    assert {name: c["n"] for name, c in columns.items()} == {"paper": 2, "rehearsed": 2}
    assert (columns["paper"]["success"], columns["rehearsed"]["success"]) == (0.5, 1.0)
    assert columns["paper"]["causes"] == {"collision": 1}
    assert columns["paper"]["planned"] == 0.75
    assert columns["paper"]["drop_cm"] == pytest.approx(2.0)
    assert columns["paper"]["disturbed"]["shift_cm"] == pytest.approx(0.2)


def test_no_rows_tell_nothing() -> None:
    assert execution.summarize([]) == {}


def test_another_mass_is_another_plan(store: PlanStore) -> None:
    shapes = store.shelf.shapes
    heavy = {name: replace(item, mass=2.0 * item.mass) for name, item in shapes.items()}
    assert fingerprints(heavy, ORDER) != fingerprints(shapes, ORDER)


def test_what_collided_counts_in_no_mean() -> None:
    """The robot that holds it has stopped: it neither fell nor slid."""
    tasks = [by_hand(brick(name="first"), (0.1, 0.1, 0.0)), by_hand(brick(name="second"), (0.15, 0.1, 0.0))]
    kept = execution.figures(carried_out(tasks))
    assert kept["cause"] == "collision"
    assert kept["drop_m"] == pytest.approx([0.01], abs=3e-4)
    assert len(kept["shift_m"]) == 1
    assert execution.mean_moves([kept])["drop_cm"] == pytest.approx(1.0, abs=0.03)
    nothing = execution.figures(carried_out([by_hand(brick(), (-0.05, 0.1, 0.0))]))
    assert execution.mean_moves([nothing]) == {"drop_cm": None, "shift_cm": None}


def test_jobs_take_every_order_in_every_column_and_no_plan_twice_at_once(store: PlanStore) -> None:
    columns = [execution.COLUMNS[name] for name in ("default", "rehearsed", "closed-loop")]
    orders = [ORDER] * 20
    jobs = list(execution.in_turn(columns, orders, store.shelf.shapes))
    assert {(job.column.name, job.index) for job in jobs} == {(c.name, k) for c in columns for k in range(20)}
    assert len({job.key for job in jobs}) == len(jobs) == 60
    for a, b in itertools.pairwise(jobs):
        assert a.index != b.index
