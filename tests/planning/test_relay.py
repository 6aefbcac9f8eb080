"""Search and layouts by turns: never worse than a plan alone, repeatable, and stopped at any time."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.config import GridConfig
from packenv.io.plans import plan_to_json
from packenv.planning.anytime import Anytime, Budget
from packenv.planning.assembly import assemble, packer
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.layouts.separation import Separation
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.relay import Relay
from packenv.types import Container
from packenv.watcher import Watcher
from tests.shapes import box
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=3, n_yaws=2)
BOX = Container(0.12, 0.12, 0.085)
_SIZES = np.random.default_rng(5).integers(3, 9, (9, 3)) * 0.01
ITEMS = {f"b{k:02}": box(*size, f"b{k:02}") for k, size in enumerate(_SIZES.tolist())}
ORDER = rp.Order.of(*ITEMS)
"""One more than one pass packs, with 87 % of the box's volume."""
WORDS: dict[str, Any] = {"grid": GRID, "restarts": 0, "constraints": "overlap"}


class Listener(Watcher):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def remark(self, text: str) -> None:
        self.lines.append(text)


def packer_of(**words: Any) -> object:
    shelf, options = shelf_of(ITEMS, GRID), PlanOptions(**WORDS, **words)
    return packer(options, assemble(options, shelf, BOX), shelf.shapes)


def test_layouts_follow_where_all_items_are_the_goal() -> None:
    assert isinstance(packer_of(plans=4), Relay)
    assert isinstance(packer_of(plans=4, goal="height"), Anytime)
    assert isinstance(packer_of(plans=4, method="search"), Anytime)
    assert isinstance(packer_of(plans=4, method="separate"), LayoutPacker)
    assert not isinstance(packer_of(), Relay | Anytime | LayoutPacker)


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_it_is_never_worse_than_a_plan_alone_and_repeatable(constraints: str) -> None:
    words = {**WORDS, "constraints": constraints}
    alone = rp.plan(ORDER, BOX, ITEMS, **words)
    both = [rp.plan(ORDER, BOX, ITEMS, plans=40, workers=n, **words) for n in (1, 2)]
    assert len(both[0].placements) >= len(alone.placements)
    assert plan_to_json(both[0]) == plan_to_json(both[1])
    assert rp.verify(both[0], ITEMS).ok


def test_what_is_packed_whole_needs_no_layouts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LayoutPacker, "pack", None)
    assert rp.plan(rp.Order.of("b00", "b01"), BOX, ITEMS, plans=4, **WORDS).complete


@pytest.mark.parametrize(
    ("constraints", "turns"),
    [("overlap", ["search", "layouts", "search"]), ("stability", ["search", "layouts"])],
)
def test_layouts_wait_for_the_search_only_under_other_constraints(
    monkeypatch: pytest.MonkeyPatch, constraints: str, turns: list[str]
) -> None:
    told: list[tuple[str, int | None]] = []

    def noted(owner: type[Any], name: str, turn: str) -> None:
        own = getattr(owner, name)

        def note(self: Any, *given: Any) -> Any:
            told.append((turn, self.budget.plans))
            return own(self, *given)

        monkeypatch.setattr(owner, name, note)

    noted(Anytime, "search", "search")
    noted(LayoutPacker, "search_layouts", "layouts")
    rp.plan(ORDER, BOX, ITEMS, plans=40, **{**WORDS, "constraints": constraints})
    assert [turn for turn, _ in told] == turns
    assert sum(plans for _, plans in told if plans is not None) == 40


def test_a_search_from_a_known_plan_is_never_worse() -> None:
    shelf, options = shelf_of(ITEMS, GRID), PlanOptions(plans=10, method="search", **WORDS)
    search = packer(options, assemble(options, shelf, BOX), shelf.shapes)
    assert isinstance(search, Anytime)
    sequence = sorted(ITEMS)
    known = replace(search, budget=Budget(plans=0)).pack(sequence, shelf.prepared, BOX)
    made: list[Packing] = []
    again = replace(search, known=known, found=made.append)
    assert search.better(again.pack(sequence, shelf.prepared, BOX)) >= search.better(known)
    assert all(search.better(packing) > search.better(known) for packing in made)
    # Nothing that is made within a budget of no plan is another one.
    assert replace(again, budget=Budget(plans=0)).pack(sequence, shelf.prepared, BOX) is known


@pytest.mark.parametrize("method", ["separate", "auto"])
def test_ctrl_c_among_layouts_gives_the_best_so_far(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    listener, calls, move = Listener(), itertools.count(), Separation.move

    def stopped(self: Separation, *given: Any) -> None:
        if next(calls) == 5:
            raise KeyboardInterrupt
        move(self, *given)

    monkeypatch.setattr(Separation, "move", stopped)
    plan = rp.plan(ORDER, BOX, ITEMS, plans=200, method=method, watcher=listener, **WORDS)
    assert plan.placements
    assert rp.verify(plan, ITEMS).ok
    assert listener.lines[-1].startswith("stopped")
    assert next(calls) == 6


def test_ctrl_c_in_the_search_is_no_start_of_layouts(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("packenv.planning.anytime._Walk.go", stopped)
    monkeypatch.setattr(LayoutPacker, "pack", None)
    assert rp.plan(ORDER, BOX, ITEMS, plans=10, **WORDS).placements
