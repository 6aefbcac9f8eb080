"""Constraints and heuristics of the user's own, under every rule, beside the built-in ones and alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.execution.physics_planner import make_planner
from packenv.planning.assembly import assemble
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.options import Constraints, PlanOptions, StabilityRule
from packenv.planning.own_rules import OwnHeuristic
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import DeepestBottomLeft
from packenv.types import Container, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.planning import own_rules
from tests.planning.own_rules import Always, Apart, Low, Never
from tests.shelf_samples import FOUR_BOXES, shelf_of
from tests.sim.bodies import convex

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=3, n_yaws=2)
BOX = Container(0.24, 0.24, 0.16)
SHELF = shelf_of(FOUR_BOXES, GRID)
PHYSICS = {name: convex(item) for name, item in FOUR_BOXES.items()}
NAMES = list(FOUR_BOXES)
HERE = "tests.planning.own_rules"
RULES: tuple[StabilityRule, ...] = ("paper", "cautious", "margin", "physics")


def planner(*own: str | Constraint, **given: Any) -> Planner:
    return make_planner(PlanOptions(own_constraints=own, **given, grid=GRID), SHELF, BOX, PHYSICS)


def packed(*own: str | Constraint, names: Sequence[str] = NAMES, **given: Any) -> Packing:
    with planner(*own, **given) as made:
        return made.pack(names, SHELF.prepared, BOX)


def where(packing: Packing) -> list[tuple[Any, ...]]:
    return [
        (p.item, p.instance, p.route, p.score, p.rotation.tolist(), p.position.tolist())
        for p in packing.placements
    ]


def centres(packing: Packing) -> np.ndarray:
    return np.array([p.rotation @ FOUR_BOXES[p.item].com + p.position for p in packing.placements])


def holds(packing: Packing, distance: float) -> None:
    """The rule of :class:`Apart`, from the poses alone, and that nothing overlaps."""
    at = centres(packing)[:, :2]
    for k, one in enumerate(at):
        assert all(np.linalg.norm(one - other) >= distance for other in at[:k])
    assert audit_plan(Plan(BOX, packing.placements, ()), FOUR_BOXES).ok


# --------------------------------------------------------------------------- own constraints: where


@pytest.mark.parametrize("clearance", [0.0, 0.008])
@pytest.mark.parametrize("search", ["3d", "5d"])
@pytest.mark.parametrize("stability", RULES)
def test_an_own_constraint_holds_under_every_stability_rule(
    stability: StabilityRule, search: str, clearance: float
) -> None:
    apart = Apart(0.06)
    packing = packed(apart, constraints="stability", stability=stability, search=search, clearance=clearance)
    assert packing.complete
    holds(packing, 0.06)
    for placement in packing.placements:
        own = placement.details["Apart"]
        assert isinstance(own, dict)
        assert own["least_m"] >= 0.06
        assert "stability" in placement.details
        assert ("physics" in placement.details) == (stability == "physics")
        assert ("clearance_m" in placement.details) == bool(clearance)
    assert (packing.placements[0].route == "5d") == (search == "5d")


@pytest.mark.parametrize("stability", RULES)
def test_an_own_constraint_holds_with_the_robot(stability: StabilityRule) -> None:
    packing = packed(Apart(0.06), stability=stability, names=NAMES[:3])
    assert packing.complete
    holds(packing, 0.06)
    assert all(p.path is not None for p in packing.placements)


@pytest.mark.parametrize("search", ["3d", "5d"])
@pytest.mark.parametrize("stability", ["paper", "cautious", "margin"])
def test_an_own_constraint_holds_alone(stability: StabilityRule, search: str) -> None:
    free = packed(constraints="overlap", stability=stability, search=search)
    packing = packed(Apart(0.06), constraints="overlap", stability=stability, search=search)
    assert packing.complete
    holds(packing, 0.06)
    assert {name for p in packing.placements for name in p.details} == {"Apart"}
    assert where(packing) != where(free)


@pytest.mark.parametrize("stability", RULES)
@pytest.mark.parametrize("clearance", [0.0, 0.008])
def test_one_that_refuses_nothing_changes_nothing(clearance: float, stability: StabilityRule) -> None:
    given: dict[str, Any] = {"constraints": "stability", "stability": stability, "clearance": clearance}
    assert where(packed(Always(), **given)) == where(packed(**given))


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
@pytest.mark.parametrize("stability", RULES)
def test_one_that_refuses_everything_leaves_everything_over(
    stability: StabilityRule, constraints: Constraints
) -> None:
    if stability == "physics" and constraints == "overlap":
        pytest.skip("refused, see test_options")
    packing = packed(
        Never(), constraints=constraints, stability=stability, clearance=0.008, max_checked=4, names=NAMES[:2]
    )
    assert not packing.placements
    assert [left.item for left in packing.leftovers] == NAMES[:2]
    for left in packing.leftovers:
        assert left.reason == "no-packable-candidate"
        assert left.rejections["never"] > 0
        assert f"{left.rejections['never']} never" in left.detail
    if constraints == "overlap":
        assert set(packing.leftovers[0].rejections) == {"never"}


def test_an_own_constraint_alone_has_the_paper_s_fallback() -> None:
    """Under overlap alone heights only grow; an own rule may like a later pile better, or a tilted item."""

    class Later(Constraint):
        def start(self, resting: Any = ()) -> int:
            return 0

        def check(self, trial: Trial, surface: ContainerMap, state: int) -> Verdict:
            ok = trial.oriented.item != "slab" or state > 0
            return Verdict(ok, "too-early", state + 1)

    class Tilted(Constraint):
        def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
            return Verdict(bool(np.abs(trial.oriented.rotation).max(axis=0).min() < 0.98), "level")

    given: dict[str, Any] = {"constraints": "overlap", "restarts": 0, "max_checked": 3}
    packing = packed(Later(), **given, names=["slab", "brick"])
    assert [(p.item, p.route) for p in packing.placements] == [("brick", "first-pass"), ("slab", "later")]
    (placement,) = packed(Tilted(), **given, names=["cube"]).placements
    assert placement.route == "5d"


@pytest.mark.parametrize("stability", RULES)
def test_restarts_begin_with_what_an_own_constraint_left_over(stability: StabilityRule) -> None:
    class CubeFirst(Constraint):
        def start(self, resting: Any = ()) -> int:
            return 0

        def check(self, trial: Trial, surface: ContainerMap, state: int) -> Verdict:
            return Verdict(trial.oriented.item != "cube" or state == 0, "too-late", state + 1)

    given: dict[str, Any] = {"constraints": "stability", "stability": stability, "max_checked": 5}
    without = packed(CubeFirst(), **given, restarts=0)
    assert [left.item for left in without.leftovers] == ["cube"]
    assert "too-late" in without.leftovers[0].rejections
    packing = packed(CubeFirst(), **given, restarts=1)
    assert packing.complete
    assert packing.placements[0].item == "cube"


def test_own_constraints_are_asked_after_the_built_in_ones_and_in_their_sequence() -> None:
    made = planner(Low(), Always(), stability="physics")
    names = [constraint.name for constraint in made.constraints]
    assert names == ["stability", "manipulation", "Low", "always", "physics"]
    for tier in (*made.strategy.first, *(t for tiers in made.strategy.fallback or () for t in tiers)):
        assert [rule.name for rule in tier.rules(made.constraints)] == names
        assert tier.rules(made.constraints)[2:4] == made.constraints[2:4]
    made.close()


def test_an_own_constraint_is_never_asked_twice_of_a_candidate_of_one_item() -> None:
    """Whatever the tiers of care."""
    apart = Apart(0.5)
    given: dict[str, Any] = {"constraints": "overlap", "clearance": 0.012, "restarts": 0, "max_checked": 6}
    made = planner(apart, **given)
    made.pack(["slab", "brick"], SHELF.prepared, BOX)
    first_pass = apart.asked[1 : 1 + 6 * len(made.strategy.first)]
    assert len(made.strategy.first) == 3
    assert len(set(first_pass)) == len(first_pass)


# ----------------------------------------------------------------------- own constraints: how given


@pytest.mark.parametrize("given", [Low(), f"{HERE}:Low"])
def test_by_object_or_by_name_is_the_same(given: str | Constraint) -> None:
    more: dict[str, Any] = {"constraints": "stability", "names": ["slab", "block", "cube"]}
    packing = packed(given, **more)
    assert where(packing) == where(packed(Low(), **more))
    assert packing.complete
    assert all(p.extents[2] < 0.051 for p in packing.placements)


def test_two_own_constraints_both_hold() -> None:
    packing = packed(Apart(0.06), f"{HERE}:Low", constraints="stability", names=["slab", "block", "cube"])
    assert packing.complete
    holds(packing, 0.06)
    assert all(p.extents[2] < 0.051 for p in packing.placements)


class Stability(Constraint):
    """Of the name of a built-in one."""

    name = "stability"

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        return Verdict(True)


class Physics(Stability):
    """Likewise."""

    name = "physics"


@pytest.mark.parametrize(
    ("own", "name"),
    [((Low(), Low()), "Low"), ((Low(), f"{HERE}:Low"), "Low"), ((Stability(),), "stability")],
)
def test_two_constraints_of_one_name_are_refused_in_one_line(
    own: tuple[str | Constraint, ...], name: str
) -> None:
    with pytest.raises(InputError) as caught:
        planner(*own)
    assert f"two constraints are named '{name}'" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_name_physics_is_taken_where_physics_is_asked() -> None:
    with pytest.raises(InputError, match="two constraints are named 'physics'"):
        planner(Physics(), stability="physics")
    assert planner(Physics()).constraints[-1].name == "physics"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (f"{HERE}:Loow", "did you mean 'Low'"),
        (f"{HERE}:deepest", "cannot be made without arguments"),
        (f"{HERE}:Container", "cannot be made without arguments"),
        (f"{HERE}:Counter", "has no 'Counter'"),
        (f"{HERE}:dataclass.nothing", "has no 'nothing'"),
        ("collections:Counter", "an object of a class that is derived from packenv.Constraint"),
        ("no_such_module:Low", "there is no module 'no_such_module'"),
        ("a b:c", "is no name of own code"),
        ("<own>", "give the constraint again"),
    ],
)
def test_a_name_that_leads_to_no_constraint_is_told_in_one_line(given: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        planner(given)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("stability", RULES)
def test_a_constraint_is_told_of_order_and_container_and_closed_at_the_end(stability: StabilityRule) -> None:
    apart = Apart()
    with planner(apart, constraints="stability", stability=stability, clearance=0.008) as made:
        made.pack(NAMES, SHELF.prepared, BOX)
        ((items, container),) = apart.told
        assert container is BOX
        assert all(items[name] is SHELF.shapes[name] for name in NAMES)
        assert apart.closed == 0
    assert apart.closed == 1
    # It can be used again.
    assert where(made.pack(NAMES, SHELF.prepared, BOX)) == where(made.pack(NAMES, SHELF.prepared, BOX))
    made.close()


def test_the_constraint_for_an_order_may_be_another_one() -> None:
    class Maker(Constraint):
        def for_order(self, items: Any, container: Container) -> Constraint:
            return Apart(container.length / 4)

        def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
            raise AssertionError

    packing = packed(Maker(), constraints="stability")
    assert packing.complete
    holds(packing, BOX.length / 4)


def test_a_class_without_check_is_no_constraint() -> None:
    with pytest.raises(TypeError, match="abstract"):
        Constraint()  # type: ignore[abstract]


def test_the_least_constraint_has_defaults_for_all_else() -> None:
    low, oriented = Low(), SHELF.prepared["cube"].orientations[0]
    assert (low.name, low.start(), low.objection(oriented)) == ("Low", None, None)
    assert low.for_order({}, BOX) is low
    low.close()
    low.close()


# ------------------------------------------------------------------------------------ own heuristics


@pytest.mark.parametrize("search", ["3d", "5d"])
@pytest.mark.parametrize("given", [own_rules.deepest, f"{HERE}:deepest", DeepestBottomLeft(0.01)])
def test_an_own_heuristic_plans_as_the_built_in_one_that_it_equals(given: Any, search: str) -> None:
    for stability in ("paper", "cautious"):
        more: dict[str, Any] = {"constraints": "stability", "stability": stability, "search": search}
        assert where(packed(heuristic=given, **more)) == where(packed(heuristic="dblf", **more))
    assert where(packed(heuristic=given)) != where(packed(heuristic="hm"))


@pytest.mark.parametrize("given", [own_rules.drawn, f"{HERE}:drawn"])
def test_an_own_heuristic_draws_from_the_generator_that_it_is_given(given: Any) -> None:
    more: dict[str, Any] = {"constraints": "stability", "restarts": 0, "places": "grid"}
    for seed in (0, 3):
        own = packed(heuristic=given, **more, seed=seed)
        assert where(own) == where(packed(heuristic="random", **more, seed=seed))
    assert where(packed(heuristic=given, **more)) != where(own)


def test_a_heuristic_as_an_object_has_its_own_constant() -> None:
    more: dict[str, Any] = {"constraints": "stability"}
    own = packed(heuristic=DeepestBottomLeft(1.0), tie_break=0.01, **more)
    assert where(own) == where(packed(heuristic="dblf", tie_break=1.0, **more))
    assert where(own) != where(packed(heuristic="dblf", **more))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (f"{HERE}:deeepest", "did you mean 'deepest'"),
        (f"{HERE}:__name__", "is no function of candidates and a random generator"),
        ("<own>", "give the heuristic again"),
        ("no_such_module:rule", "there is no module 'no_such_module'"),
    ],
)
def test_a_name_that_leads_to_no_heuristic_is_told_in_one_line(given: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        planner(heuristic=given)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_own_heuristic_and_an_own_constraint_together() -> None:
    options = PlanOptions(
        heuristic=own_rules.flattest,
        own_constraints=[Apart(0.05)],
        constraints="stability",
        clearance=0.008,
        grid=GRID,
    )
    with assemble(options, SHELF, BOX) as made:
        packing = made.pack(NAMES, SHELF.prepared, BOX)
    assert packing.complete
    holds(packing, 0.05)
    assert isinstance(made.heuristic, OwnHeuristic)
    assert made.heuristic.rule is own_rules.flattest
