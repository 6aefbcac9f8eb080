"""From an order to a plan by layouts: audited, repeatable, and never less than the planner alone places."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import packenv as rp
from packenv.errors import InputError
from packenv.execution.planning_job import PlanningJob
from packenv.planning.anytime import STOPPED, Budget
from packenv.planning.assembly import assemble
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.guided_local_search import GuidedLocalSearch
from packenv.planning.layouts.layout import Arrangement, Layout, WillDo, without_overlap
from packenv.planning.layouts.layout_packer import LayoutPacker, LayoutSearch, taken
from packenv.planning.layouts.separation import Separation
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container, Placement, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.planning.layouts.arrangements import BOX, GRID, drawn, shelf

SEARCHES = {"separate": Separation(), "gls": GuidedLocalSearch()}


def packer_of(method: str, rounds: int, box: Container = BOX, **words: object) -> LayoutPacker:
    options = PlanOptions(**{"constraints": "overlap", "grid": GRID, **words})  # type: ignore[arg-type]
    planner = assemble(options, shelf(), box)
    search: LayoutSearch = SEARCHES[method]
    return LayoutPacker(planner, planner, shelf().shapes, search, method, budget=Budget(plans=rounds))


def packed(names: list[str], method: str, rounds: int = 20, box: Container = BOX, **words: object) -> Packing:
    shelf().load(names, fields=words.get("constraints") is not None)
    return packer_of(method, rounds, box, **words).pack(names, shelf().prepared, box)


def audited(packing: Packing) -> bool:
    return audit_plan(Plan(packing.container, packing.placements, ()), shelf().items).ok


def where(placements: tuple[Placement, ...]) -> list[tuple[str, bytes, bytes]]:
    return [(p.item, p.rotation.tobytes(), p.position.tobytes()) for p in placements]


@pytest.mark.parametrize("method", SEARCHES)
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000))
def test_plans_pass_the_audit_and_place_no_less_than_the_planner(method: str, seed: int) -> None:
    names = drawn(seed, 6, 14)
    found = packed(names, method)
    assert audited(found)
    placed = [p.item for p in found.placements] + [left.item for left in found.leftovers]
    assert sorted(placed) == sorted(names)
    planner = packer_of(method, 0).planner
    assert len(found.placements) >= len(planner.pack(names, shelf().prepared, BOX).placements)


def test_a_layout_with_a_sequence_is_lowered_whole() -> None:
    """The law that makes plans of layouts: no piece comes to rest above its place in the layout."""
    lowered = 0
    for seed in range(12):
        names = drawn(seed, 6, 10)
        found = packed(names, "separate")
        routes = {p.route for p in found.placements}
        lowered += found.made_by == "separate" and routes == {"layout"} and found.complete
        assert found.made_by == "planner" or found.complete
    assert lowered >= 8


@pytest.mark.parametrize("constraints", ["stability", "robot"])
def test_constraints_are_asked_of_layouts_too(constraints: str) -> None:
    for seed in range(3):
        names = drawn(seed, 4, 6)
        found = packed(names, "separate", constraints=constraints)
        assert audited(found)
        assert all("stability" in p.details for p in found.placements)


def test_same_seed_and_rounds_same_plan() -> None:
    names = drawn(3, 10, 10)
    one, two = (packed(names, "separate") for _ in range(2))
    assert where(one.placements) == where(two.placements)
    other = packed(names, "separate", seed=1)
    assert where(one.placements) != where(other.placements)


def test_layouts_keep_off_what_lies_there() -> None:
    names = drawn(5, 4, 4)
    packer = packer_of("separate", 60)
    first = packer.pack(names, shelf().prepared, BOX)
    surface = first.surfaces[-1] if first.surfaces else None
    assert surface is not None
    blocked = taken(surface, 0.004, (35, 30, 25))
    assert blocked.any()
    heights = surface.heights
    for x, y in np.ndindex(35, 30):
        top = heights[2 * x : 2 * x + 2, 2 * y : 2 * y + 2].max()
        assert blocked[x, y].sum() == np.ceil(top / 0.004 - 1e-3)


def test_cells_that_do_not_divide_a_voxel_are_taken_whole() -> None:
    heights = np.zeros((10, 10), dtype=np.float32)
    heights[3, 7] = 0.011  # of 3 mm: from 9 to 12 and from 21 to 24 mm
    found = taken(ContainerMap(Container(0.03, 0.03, 0.03), 0.003, heights), 0.0045, (7, 7, 7))
    assert sorted(map(tuple, np.argwhere(found[:, :, 0]).tolist())) == [(2, 4), (2, 5)]
    assert found[2, 4].tolist() == [True, True, True, False, False, False, False]


@dataclasses.dataclass(eq=False)
class Stopped:
    """A separation in whose run of a given number somebody presses Ctrl-C."""

    at: int
    runs: int = 0

    def run(
        self,
        arrangement: Arrangement,
        rng: np.random.Generator,
        effort: Effort,
        will_do: WillDo = without_overlap,
    ) -> Layout:
        """A few moves, or the interrupt."""
        self.runs += 1
        if self.runs == self.at:
            raise KeyboardInterrupt
        return Separation().run(arrangement, rng, Effort(moves=40), will_do)


@pytest.mark.parametrize("at", [1, 2, 4])
def test_ctrl_c_gives_the_best_plan_so_far(at: int) -> None:
    names = ["brick"] * 40  # more than the box holds by a little: no layout becomes a whole plan
    box = Container(0.14, 0.12, 0.172)
    lines, told = list[str](), list[Packing]()
    packer = packer_of("separate", 10_000, box)
    packer = dataclasses.replace(packer, search=Stopped(at), report=lines.append, found=told.append)
    shelf().load(names)
    found = packer.pack(names, shelf().prepared, box)
    assert audited(found)
    assert lines[-1] == STOPPED
    figures = [packer.better(p) for p in told]
    assert bool(told) == (at > 1)
    assert len(lines) - 1 == sum(all(f > g for g in figures[:k]) for k, f in enumerate(figures))
    own = packer.better(packer.otherwise.pack(names, shelf().prepared, box))
    assert packer.better(found) == max([*figures, own])


@pytest.mark.parametrize("method", SEARCHES)
def test_methods_are_options(method: str) -> None:
    catalogue = rp.load_catalogue({name: shelf().items[name] for name in shelf().items})
    order = rp.Order.of("brick", "stick", "cup", "ball")
    plan = rp.plan(order, BOX, catalogue, method=method, budget=5, constraints="stability")
    assert plan.complete
    assert plan.made_by == method
    assert rp.verify(plan, catalogue).ok
    again = rp.plan(order, BOX, catalogue, dataclasses.replace(plan.made_with or PlanOptions(), budget=0.0))
    assert again.made_by != method  # no time for a layout
    with pytest.raises(InputError, match="method is 'seperate', give one of auto, search, separate, gls"):
        PlanOptions(method="seperate")  # type: ignore[arg-type]


def test_a_box_that_is_partly_filled_takes_a_layout() -> None:
    catalogue = rp.load_catalogue({name: shelf().items[name] for name in shelf().items})
    first = rp.plan(rp.Order.of("brick", "cup"), BOX, catalogue, constraints="overlap")
    whole = rp.plan(
        rp.Order.of("brick", "stick"), None, catalogue, first.made_with, start=first, method="separate"
    )
    assert whole.complete
    assert [p.route for p in whole.placements[2:]] == ["layout"] * 2
    assert rp.verify(whole, catalogue).ok


def test_the_planner_that_packs_boxes_is_asked_for_layouts() -> None:
    job = PlanningJob(shelf(), PlanOptions(method="gls", grid=GRID, budget=3.0))
    packer = job.packer(BOX)
    assert isinstance(packer, LayoutPacker)
    assert (packer.name, packer.budget) == ("gls", Budget(3.0))
