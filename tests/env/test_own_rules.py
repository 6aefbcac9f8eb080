"""Heuristics and constraints of a user's own in the environment, and its plans in closed loop."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence

import packenv as rp
from packenv.cli import main
from packenv.env.observation import FEATURES
from packenv.planning.search.candidates import grid_search
from tests import own_rules
from tests.env_samples import CONFIG, ITEMS, ORDER, best_action, make_env, random_action, run_episode

FLATTEST, RANDOM, LOW = (f"tests.own_rules:{name}" for name in ("flattest", "at_random", "LowOnly"))
OWN: dict[str, Any] = {"mask": "legal", "heuristics": [FLATTEST, RANDOM], "own_constraints": [LOW]}


def registered(**changes: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make("RobotPack-v0", config={**CONFIG, **OWN, **changes}, order_generator=ORDER)


@pytest.mark.parametrize(("mask", "physics"), [("legal", False), ("robot", False), ("legal", True)])
def test_gymnasiums_checker_has_nothing_to_say(mask: str, physics: bool) -> None:
    env = registered(mask=mask, physics=physics)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_the_specification_survives_json() -> None:
    env = registered()
    spec = env.unwrapped.spec
    assert spec is not None
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    twin = gymnasium.make(again)
    assert data_equivalence(env.reset(seed=4), twin.reset(seed=4), exact=True)
    config = env.unwrapped.config  # type: ignore[attr-defined]
    assert rp.PackConfig.from_mapping(json.loads(json.dumps(config.to_mapping()))) == config


@pytest.mark.parametrize("after", [0, 2])
def test_a_pickled_environment_goes_on_like_its_original(after: int) -> None:
    env = make_env(**OWN)
    rng = np.random.default_rng(0)
    obs, _ = env.reset(seed=11)
    for _ in range(after):
        obs, *_ = env.step(random_action(obs["action_mask"], rng))
    twin = pickle.loads(pickle.dumps(env))
    for _ in range(2):
        action = random_action(env.action_masks(), rng)
        assert data_equivalence(env.step(action), twin.step(action), exact=True)
    assert data_equivalence(env.reset(), twin.reset(), exact=True)


def test_a_function_and_an_object_will_do_and_pickle() -> None:
    named = make_env(**OWN)
    given = make_env(
        **{
            **OWN,
            "heuristics": [own_rules.flattest, own_rules.at_random],
            "own_constraints": [own_rules.LowOnly()],
        }
    )
    config = given.config.to_mapping()
    assert (config["heuristics"], config["own_constraints"]) == ([FLATTEST, RANDOM], ["<own>"])
    twin = pickle.loads(pickle.dumps(given))
    rolled = [list(run_episode(e, np.random.default_rng(1), seed=5)) for e in (named, given, twin)]
    assert data_equivalence(rolled[0], rolled[1], exact=True)
    assert data_equivalence(rolled[0], rolled[2], exact=True)


def test_columns_of_own_heuristics_are_the_last() -> None:
    env = make_env(**{**OWN, "own_constraints": [], "candidates": 40})
    features = env._observer.features
    own = [f"score_{FLATTEST}", f"score_{RANDOM}", f"rank_{FLATTEST}", f"rank_{RANDOM}"]
    assert list(features) == [*FEATURES, *own]
    assert env.observation_space["candidates"].shape == (40, len(FEATURES) + 4)
    plain = make_env(mask="legal", candidates=40)
    obs, _ = env.reset(seed=0)
    assert env.observation_space.contains(obs)
    assert plain.observation_space["candidates"].shape == (40, len(FEATURES))
    for _ in range(3):
        episode = env._episode
        assert episode is not None
        assert episode.current is not None
        surface = episode.arrangement.pile.surface
        candidates = grid_search(surface, episode.current.orientations, 5)
        table = obs["candidates"][obs["candidates"][:, 0] == 1]
        told = dict(zip(features, table.T, strict=True))
        scores = own_rules.flattest(candidates, np.random.default_rng(0))
        ranks = np.empty(len(scores), dtype=int)
        ranks[np.argsort(scores, kind="stable")] = np.arange(len(scores))
        offered = episode.offered
        assert offered is not None
        np.testing.assert_array_equal(told[f"rank_{FLATTEST}"], ranks[offered.chosen])
        chosen = scores[offered.chosen]
        spread = np.ptp(chosen) or 1.0
        np.testing.assert_allclose(told[f"score_{FLATTEST}"], (chosen - chosen.min()) / spread, atol=1e-6)
        assert told[f"rank_{FLATTEST}"].min() == 0
        assert told[f"rank_{RANDOM}"].min() == 0
        obs, *_ = env.step(best_action(obs))


def test_an_agent_can_follow_an_own_heuristic_as_the_planner_does() -> None:
    items = {"kind": "list", "items": list(ITEMS[:4])}
    env = make_env(**{**OWN, "mask": "stable", "heuristics": [FLATTEST], "order_generator": items})
    column = env._observer.features.index(f"rank_{FLATTEST}")
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        mask = obs["action_mask"]
        ranks = np.where(mask[:-1] == 1, obs["candidates"][:, column], np.inf)
        action = int(ranks.argmin()) if ranks.min() < 10 else len(ranks)
        obs, _, ended, _, _ = env.step(action)
    options = env.config.plan_options().changed({"heuristic": own_rules.flattest})
    order = rp.Order.of(*ITEMS[:4])
    planned = rp.plan(order, rp.Container(0.16, 0.12, 0.10), options=options)
    found = env.plan()
    assert [(p.item, p.instance) for p in found.placements] == [
        (p.item, p.instance) for p in planned.placements
    ]
    for one, other in zip(found.placements, planned.placements, strict=True):
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.rotation, other.rotation)


@pytest.mark.parametrize("mask", ["legal", "stable", "robot"])
def test_the_mask_obeys_an_own_constraint(mask: str) -> None:
    items = {"kind": "list", "items": list(ITEMS[:4])}
    env = make_env(**{**OWN, "mask": mask, "order_generator": items})
    free = make_env(mask=mask, order_generator=items)
    features = env._observer.features
    refused = 0
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        rows = obs["candidates"]
        top = rows[:, features.index("z")] + rows[:, features.index("height")]
        valid = obs["action_mask"][:-1] == 1
        assert (top[valid] <= own_rules.LOW + 1e-6).all()
        refused += int((top[(rows[:, 0] == 1) & ~valid] > own_rules.LOW).sum())
        obs, _, ended, _, _ = env.step(best_action(obs))
    assert refused > 0
    plan = env.plan()
    assert all(p.corner[2] + p.extents[2] <= own_rules.LOW + 1e-9 for p in plan.placements)
    assert plan.settings["own_constraints"] == [LOW]
    assert rp.verify(plan).unchecked == (LOW,)
    obs, _ = free.reset(seed=0)
    ended = False
    while not ended:
        obs, _, ended, _, _ = free.step(best_action(obs))
    assert any(p.corner[2] + p.extents[2] > own_rules.LOW for p in free.plan().placements)


def test_every_order_asks_an_own_constraint_anew() -> None:
    env = make_env(mask="legal", candidates=400, own_constraints=[own_rules.LeftThenRight()])
    sides = []
    for _ in range(4):
        obs, _ = env.reset(options={"order": ["golf_ball"]})
        env.step(best_action(obs))
        sides.append(bool(env.plan().placements[0].corner[0] < 0.08))
    assert sides == [True, False, True, False]


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("too_few", "of shape"),
        ("not_numbers", "finite"),
        ("a_list", "[0.0"),
    ],
)
def test_an_own_heuristic_that_returns_something_else_is_one_line(name: str, word: str) -> None:
    env = make_env(mask="legal", heuristics=[f"tests.own_rules:{name}"])

    def planned() -> None:
        rp.plan(rp.Order.of("golf_ball"), "0.2x0.2x0.2", heuristic=getattr(own_rules, name))

    for act in (env.reset, planned):
        with pytest.raises(rp.InputError) as problem:
            act()
        assert "\n" not in str(problem.value)
        for part in (name, word, "one for each candidate"):
            assert part in str(problem.value)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"heuristics": "tests.own_rules:flattest"}, "list"),
        ({"heuristics": ["flatest"]}, "flatest"),
        ({"heuristics": ["tests.own_rules:flatest"]}, "did you mean 'flattest'"),
        ({"heuristics": ["no_such_module_here:x"]}, "no_such_module_here"),
        ({"own_constraints": ["LowOnly"]}, "my_module:MyRule"),
        ({"own_constraints": ["tests.own_rules:flattest"]}, "flattest"),
        ({"own_constraints": ["tests.own_rules:LOW"]}, "packenv.Constraint"),
        ({"own_constraints": [7]}, "7"),
    ],
)
def test_a_wrong_rule_is_told_in_one_line(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(rp.InputError) as problem:
        make_env(mask="legal", **changes).reset()
    assert word in str(problem.value)
    assert "\n" not in str(problem.value)


# ------------------------------------------------------------------------------- plans of the environment


@pytest.mark.parametrize("mask", ["legal", "robot"])
def test_a_plan_of_the_environment_is_carried_out_in_closed_loop(
    mask: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    items = {"kind": "list", "items": list(ITEMS[:4])}
    env = make_env(mask=mask, containers=[[0.2, 0.16, 0.12]], order_generator=items)
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        obs, _, ended, _, _ = env.step(best_action(obs))
    plan = env.plan()
    assert plan.made_by == "agent"
    assert len(plan.placements) + len(plan.leftovers) == 4
    assert rp.verify(plan).ok
    executed = rp.execute(plan, closed_loop=True)
    assert executed.success
    assert len(executed.execution.final) == 4
    first, second, *others = plan.placements
    inside = replace(second, position=second.position + first.corner - second.corner, corner=first.corner)
    again = rp.execute(replace(plan, placements=(first, inside, *others)), closed_loop=True)
    assert again.success
    assert again.plans is not None
    assert again.plans > 1
    path = tmp_path / "p.json"
    rp.save_plan(plan, path)
    assert json.loads(path.read_text())["made_by"] == "agent"
    assert main(["execute", str(path), "--closed-loop", "--json"]) == 0
    printed = capsys.readouterr()
    told, mine = json.loads(printed.out), executed.to_json()
    for key in ("success", "cause", "loop", "placed", "planned", "plans"):
        assert told[key] == mine[key]
    assert (told["loop"], told["placed"]) == ("closed", 4)
    for one, other in zip(told["items"], mine["items"], strict=True):
        assert (one["item"], one["instance"]) == (other["item"], other["instance"])
        assert one["planned"]["position"] == pytest.approx(other["planned"]["position"], abs=1e-9)
    assert ("ideal hand" in printed.err) is (mask == "legal")
    assert main(["verify", str(path)]) == 0
