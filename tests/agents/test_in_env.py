"""Agents in the environment, against the planner and its scores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pytest

from packenv import agents
from packenv.agents.planner import PlannerAgent
from packenv.agents.protocol import Agent
from packenv.config import GridConfig
from packenv.env.config import PackConfig
from packenv.env.observation import FEATURES, HEURISTIC_COLUMNS
from packenv.env.pack_env import PackEnv
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import by_box_volume
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.types import Container
from tests.shelf_samples import shelf_of

# Coarse, with few yaws, few candidates, and items of few faces: the laws do not depend on it, and it costs a
# hundredth.
GRID = GridConfig(cell_size=0.005, grid_step=0.02, n_poses=2, n_yaws=2)
K = 8
SIMPLE = (
    *("c_clamp", "cracker_box", "foam_brick", "gelatin_box", "medium_clamp", "milk_carton"),
    *("padlock", "pudding_box", "sugar_box", "toy_car", "wood_block"),
)
MORE = (
    *("adjustable_wrench", "bowl", "dumbbell", "hammer", "mug"),
    *("mustard_bottle", "power_drill", "skillet", "storage_tray"),
)
Level = Literal["overlap", "stability", "robot"]
MASKS: dict[Level, str] = {"overlap": "legal", "stability": "stable", "robot": "robot"}


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return make_shelf(SIMPLE)


def make_shelf(names: Sequence[str]) -> ItemShelf:
    catalogue = open_catalogue("builtin")
    return shelf_of({name: catalogue.item(name) for name in names}, GRID)


def make_env(box: Container, **settings: Any) -> PackEnv:
    return PackEnv(
        PackConfig(containers=(box.size,), grid=GRID, candidates=K, **settings),
        order_generator={"kind": "list", "items": SIMPLE[:1]},
    )


def play(env: PackEnv, agent: Agent, order: Sequence[str]) -> tuple[dict[str, Any], int]:
    """The last info and the number of deferred items."""
    obs, info = env.reset(seed=0, options={"order": list(order)})
    ended, deferred = False, 0
    while not ended:
        assert np.array_equal(obs["action_mask"], info["action_mask"])
        action = agent.act(obs, info)
        deferred += action == env.config.candidates
        obs, _, ended, truncated, info = env.step(action)
        assert not info["invalid_action"]
        assert not truncated
    return info, deferred


def placed(what: Any) -> list[tuple[object, ...]]:
    """What is placed how, in packing sequence."""
    return [
        (p.item, p.instance, p.route, p.pose_index, p.yaw, *p.position.tolist(), *p.rotation.ravel().tolist())
        for p in what.placements
    ]


def planned(shelf: ItemShelf, options: PlanOptions, box: Container, order: Sequence[str]) -> Packing:
    sequence = by_box_volume(order, shelf.prepared)
    return assemble(options, shelf, box).pack(sequence, shelf.prepared, box)


def compare(
    shelf: ItemShelf,
    level: Level,
    heuristic: str,
    box: Container,
    checked: int,
    *,
    orders: int,
    size: int,
    own: tuple[str, ...] = (),
) -> Counter[str]:
    """Routes and leftovers of both, which must agree."""
    options = PlanOptions(
        heuristic,
        constraints=level,
        own_constraints=own,
        max_checked=checked,
        restarts=0,
        stability="paper",
        heights="map",  # the environment's default
        places="grid",
        grid=GRID,
    )
    env = make_env(box, mask=MASKS[level], max_checked=checked, own_constraints=own)
    agent = PlannerAgent(heuristic, checked)
    rng = np.random.default_rng(7)
    seen: Counter[str] = Counter()
    for _ in range(orders):
        order = [str(name) for name in rng.choice(sorted(shelf.items), size)]
        theirs = planned(shelf, options, box, order)
        info, deferred = play(env, agent, order)
        assert placed(env.unwrapped.plan()) == placed(theirs)
        assert Counter(info["left_over"]) == Counter(p.item for p in theirs.leftovers)
        assert info["utilization"] == pytest.approx(theirs.utilization)
        seen.update(p.route for p in theirs.placements)
        seen.update({"left-over": len(theirs.leftovers), "deferred": deferred})
    env.close()
    return seen


FLAT, TALL = Container(0.24, 0.24, 0.14), Container(0.24, 0.24, 0.2)
NARROW = Container(0.2, 0.2, 0.14)


@pytest.mark.parametrize(
    ("level", "heuristic", "box", "checked", "happens"),
    [
        ("overlap", "hm", FLAT, 100, {"left-over"}),
        ("overlap", "mta", FLAT, 100, {"left-over"}),
        ("stability", "mta", FLAT, 2, {"5d", "left-over"}),
        ("robot", "hm", FLAT, 5, {"5d", "left-over"}),
        ("robot", "dblf", NARROW, 2, {"later", "5d", "left-over", "deferred"}),
        ("robot", "minz", TALL, 2, {"later", "5d"}),
    ],
)
def test_the_planner_agent_places_as_the_planner(
    shelf: ItemShelf, level: Level, heuristic: str, box: Container, checked: int, happens: set[str]
) -> None:
    seen = compare(shelf, level, heuristic, box, checked, orders=3, size=8)
    assert seen["first-pass"] > 10
    assert all(seen[what] > 0 for what in happens), seen


@pytest.mark.parametrize("level", ["overlap", "stability", "robot"])
def test_with_an_own_constraint_too_it_places_as_the_planner(shelf: ItemShelf, level: Level) -> None:
    """Told by the mask alone: an agent knows nothing of it."""
    own = ("tests.planning.own_rules:Apart",)
    seen = compare(shelf, level, "hm", NARROW, 3, orders=3, size=7, own=own)
    assert seen["first-pass"] > 8
    assert seen["left-over"] > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("level", "heuristic", "height", "checked"),
    [("stability", "minz", 0.2, 100), ("robot", "hm", 0.14, 100), ("robot", "hm", 0.2, 2)],
)
def test_the_planner_agent_places_as_the_planner_on_many_shapes(
    level: Level, heuristic: str, height: float, checked: int
) -> None:
    box = Container(0.28, 0.28, height)
    seen = compare(make_shelf([*SIMPLE, *MORE]), level, heuristic, box, checked, orders=6, size=9)
    assert seen["first-pass"] > 20
    assert seen["later"] + seen["5d"] + seen["left-over"] > 0


@pytest.mark.parametrize("heuristic", HEURISTIC_COLUMNS)
def test_a_heuristic_takes_what_its_score_ranks_first(shelf: ItemShelf, heuristic: str) -> None:
    env, agent, rng = make_env(FLAT, mask="legal"), agents.make(heuristic), np.random.default_rng(3)
    draws = np.random.default_rng(0)
    placements = 0
    for _ in range(3):
        surface = ContainerMap.empty(FLAT, GRID.cell_size)
        obs, info = env.reset(seed=0, options={"order": rng.choice(SIMPLE, 8).tolist()})
        ended = False
        while not ended:
            legal = grid_search(surface, shelf.prepared[info["item"]].orientations, GRID.step_cells)
            best = int(np.argmin(HEURISTICS[heuristic](legal, draws)))
            oriented = legal.grids[legal.grid_index[best]].oriented
            action = agent.act(obs, info)
            row = obs["candidates"][action]
            wanted = {
                "x": legal.ix[best] * GRID.cell_size,
                "y": legal.iy[best] * GRID.cell_size,
                "z": legal.z[best],
                "yaw": oriented.yaw,
                "pose": oriented.pose_index,
            }
            found = {name: row[FEATURES.index(name)] for name in wanted}
            assert found == pytest.approx(wanted, abs=1e-6)
            surface = surface.with_item(
                oriented, int(legal.ix[best]), int(legal.iy[best]), float(legal.z[best])
            )
            obs, _, ended, _, info = env.step(action)
            placements += 1
    assert placements > 12
    env.close()


ALL = [name for name in agents.NAMES if name != "learned"]


@pytest.mark.parametrize(
    ("name", "mask"),
    [*((name, "legal") for name in ALL), *((name, "robot") for name in ("hm", "random", "planner"))],
)
def test_no_agent_takes_an_invalid_action_in_an_episode(name: str, mask: str) -> None:
    env = make_env(TALL, mask=mask, max_checked=5)
    rng = np.random.default_rng(1)
    info, _ = play(env, agents.make(name), rng.choice(SIMPLE, 6).tolist())
    assert info["packed_items"] + len(info["left_over"]) == 6
    env.close()
