"""Plans that experiments share: made once, kept as files that a user can carry out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from packenv import api
from packenv.cli import main
from packenv.experiments.columns import CAUTIOUS
from packenv.experiments.plan_store import PlanStore, fingerprints
from packenv.io.plans import plan_to_json
from packenv.items.plan_items import shelf_for
from packenv.planning.options import PlanOptions
from packenv.types import Container
from tests.mesh_samples import write_three

ORDER = ("brick", "book", "can")
BOX = (Container(0.2, 0.2, 0.12),)
REHEARSED = PlanOptions(rehearse=2, engine="mujoco")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> PlanStore:
    """An empty store of plans of three items."""
    folder = tmp_path_factory.mktemp("store")
    write_three(folder)
    return PlanStore(folder / "plans", api.load_catalogue(folder), "1")


def test_a_plan_is_made_once_and_read_from_then_on(store: PlanStore, monkeypatch: pytest.MonkeyPatch) -> None:
    first = store.plan(ORDER, BOX, PlanOptions())
    assert first.plan.complete
    assert first.cpu_s > 0.0

    def never(*_: object, **__: object) -> None:
        raise AssertionError("planned again")

    monkeypatch.setattr(api, "plan", never)
    again = store.plan(ORDER, BOX, PlanOptions())
    assert plan_to_json(again.plan) == plan_to_json(first.plan)
    assert again.cpu_s == first.cpu_s
    for other in (PlanOptions(clearance=0.01), PlanOptions(seed=1)):
        with pytest.raises(AssertionError, match="planned again"):
            store.plan(ORDER, BOX, other)
    for order, boxes in ((ORDER[::-1], BOX), (ORDER, (*BOX, Container(0.3, 0.3, 0.3)))):
        with pytest.raises(AssertionError, match="planned again"):
            store.plan(order, boxes, PlanOptions())
    with pytest.raises(AssertionError, match="planned again"):
        replace(store, revision="2").plan(ORDER, BOX, PlanOptions())


@pytest.mark.parametrize("as_packed", [False, True])
@pytest.mark.parametrize(
    "options", [PlanOptions(heuristic="hm"), CAUTIOUS, REHEARSED], ids=["hm", "cautious", "rehearsed"]
)
def test_whichever_worker_makes_it_a_plan_is_the_same(
    store: PlanStore, options: PlanOptions, as_packed: bool, tmp_path: Path
) -> None:
    other = PlanStore(tmp_path, api.load_catalogue(store.catalogue.folder), "1")
    found = (plan_to_json(s.plan(ORDER, BOX, options, as_packed=as_packed).plan) for s in (store, other))
    one, two = ({**plan, "metrics": {**plan["metrics"], "plan_cpu_s": 0.0}} for plan in found)
    assert one == two


def test_a_stored_plan_is_one_that_users_can_check_and_carry_out(
    store: PlanStore, capsys: pytest.CaptureFixture[str]
) -> None:
    path = store.plan(ORDER, BOX, PlanOptions(heuristic="dblf")).plan.source
    assert path is not None
    assert main(["verify", str(path)]) == 0
    capsys.readouterr()
    assert main(["execute", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["placed"] == 3


def test_the_column_pack_is_what_robotpack_pack_gives(
    store: PlanStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item,qty\n" + "".join(f"{name},1\n" for name in ORDER))
    words = [str(order), "--catalogue", str(store.catalogue.folder), "--container", BOX[0].label, "--json"]
    capsys.readouterr()
    main(["pack", *words])
    given = json.loads(capsys.readouterr().out)
    stored: dict[str, Any] = plan_to_json(store.plan(ORDER, BOX, PlanOptions(), as_packed=True).plan)
    assert stored["settings"] == given["settings"]
    for mine, theirs in zip(stored["steps"], given["steps"], strict=True):
        assert (mine["item"], mine["position"]) == (theirs["item"], theirs["position"])
    for name in ("rehearsal_worlds", "rehearsal_survived", "rehearsal_plans"):
        assert stored["metrics"][name] == given["metrics"][name]


def test_another_mass_is_another_plan(store: PlanStore) -> None:
    shapes = shelf_for(store.catalogue, CAUTIOUS).shapes
    heavy = {name: replace(shapes[name], mass=2.0 * shapes[name].mass) for name in ORDER}
    assert fingerprints(heavy, ORDER) != fingerprints(shapes, ORDER)
