"""Laws of the agents that act on the observation alone, on observations made by hand."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import numpy as np
import pytest

from packenv import agents
from packenv.agents.planner import PlannerAgent
from packenv.env.observation import HEURISTIC_COLUMNS
from packenv.errors import InputError
from tests.agents.observations import random_observation, rank, stacked

RANKED = [name for name in agents.NAMES if name in HEURISTIC_COLUMNS]
ON_SIGHT = [name for name in agents.NAMES if name not in ("learned", "gls")]
SEEDS = range(200)


def test_every_heuristic_of_the_observation_is_an_agent() -> None:
    assert sorted(RANKED) == sorted(HEURISTIC_COLUMNS)


@pytest.mark.parametrize("name", ON_SIGHT)
def test_a_masked_action_is_never_taken(name: str) -> None:
    agent = agents.make(name)
    for seed in SEEDS:
        obs = random_observation(np.random.default_rng(seed))
        agent.reset(seed)
        assert obs["action_mask"][agent.act(obs, {})] == 1


@pytest.mark.parametrize("name", [*RANKED, "random"])
def test_heuristics_defer_only_where_nothing_else_is_valid(name: str) -> None:
    agent = agents.make(name)
    deferred = 0
    for seed in SEEDS:
        obs = random_observation(np.random.default_rng(seed))
        action, last = agent.act(obs, {}), len(obs["action_mask"]) - 1
        deferred += action == last
        assert (action == last) == (not obs["action_mask"][:last].any())
    assert 0 < deferred < len(SEEDS)


@pytest.mark.parametrize("name", RANKED)
def test_no_valid_candidate_has_a_better_rank(name: str) -> None:
    agent = agents.make(name)
    for seed in SEEDS:
        obs = random_observation(np.random.default_rng(seed))
        action = agent.act(obs, {})
        if action < len(obs["candidates"]):
            ranks = rank(obs, name)
            assert not (obs["action_mask"][:-1].astype(bool) & (ranks < ranks[action])).any()


@pytest.mark.parametrize("name", [*RANKED, "planner"])
def test_permuting_the_candidates_permutes_the_choice(name: str) -> None:
    agent = agents.make(name)
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        obs = random_observation(rng)
        k = len(obs["candidates"])
        order = rng.permutation(k)
        shuffled = {
            "candidates": obs["candidates"][order],
            "action_mask": np.append(obs["action_mask"][order], obs["action_mask"][k]),
        }
        action = agent.act(shuffled, {})
        assert agent.act(obs, {}) == (k if action == k else order[action])


@pytest.mark.parametrize("name", ON_SIGHT)
def test_the_batch_form_equals_one_after_another(name: str) -> None:
    agent = agents.make(name)
    rng = np.random.default_rng(5)
    observations = [random_observation(rng) for _ in range(50)]
    agent.reset(3)
    single = [agent.act(obs, {}) for obs in observations]
    agent.reset(3)
    batch = agent.act_batch(stacked(observations), {})
    assert batch.dtype == np.int64
    assert batch.tolist() == single


@pytest.mark.parametrize("name", ON_SIGHT)
def test_a_batch_may_hold_an_episode_that_has_ended(name: str) -> None:
    obs = stacked([random_observation(np.random.default_rng(seed)) for seed in range(3)])
    obs["action_mask"][1] = 0
    actions = agents.make(name).act_batch(obs, {})
    assert actions[1] == obs["candidates"].shape[1]
    assert all(obs["action_mask"][k, actions[k]] for k in (0, 2))


@pytest.mark.parametrize("name", ON_SIGHT)
def test_an_observation_is_left_as_it_is(name: str) -> None:
    obs = random_observation(np.random.default_rng(1))
    before = {key: value.copy() for key, value in obs.items()}
    agents.make(name).act(obs, {})
    assert all(np.array_equal(obs[key], before[key]) for key in before)


def test_chance_favours_no_valid_candidate() -> None:
    agent = agents.make("random")
    agent.reset(0)
    obs = {"action_mask": np.array([0, 1, 1, 0, 1, 1], dtype=np.int8)}
    counts = Counter(agent.act(obs, {}) for _ in range(3000))
    assert set(counts) == {1, 2, 4}
    # Six standard deviations of a share of 1/3.
    assert all(abs(n - 1000) < 6 * np.sqrt(3000 * 2 / 9) for n in counts.values())


def test_chance_is_repeated_by_its_seed_and_is_not_the_environments() -> None:
    obs = {"action_mask": np.ones(101, dtype=np.int8)}

    def draws(seed: int) -> list[int]:
        agent = agents.make("random")
        agent.reset(seed)
        return [agent.act(obs, {}) for _ in range(20)]

    assert draws(1) == draws(1) != draws(2)
    rng = np.random.default_rng(1)
    assert draws(1) != [int(rng.choice(100)) for _ in range(20)]


@pytest.mark.parametrize("heuristic", HEURISTIC_COLUMNS)
@pytest.mark.parametrize("most", [1, 30, 100])
def test_the_planner_defers_what_lies_beyond_the_candidates_that_it_checks(heuristic: str, most: int) -> None:
    agent = PlannerAgent(heuristic, most)
    places = {True: 0, False: 0}
    for seed in SEEDS:
        obs = random_observation(np.random.default_rng(seed))
        ranks = np.where(obs["action_mask"][:-1] == 1, rank(obs, heuristic), np.inf)
        action = agent.act(obs, {})
        places[action < len(ranks)] += 1
        if action < len(ranks):
            assert ranks[action] == ranks.min()
            assert ranks[action] < most or not obs["action_mask"][-1]
        else:
            assert ranks.min() >= most
    assert min(places.values()) > 0


def test_the_planner_with_no_bound_is_the_heuristic() -> None:
    for heuristic in HEURISTIC_COLUMNS:
        planner, plain = PlannerAgent(heuristic, 10**9), agents.make(heuristic)
        for seed in SEEDS:
            obs = random_observation(np.random.default_rng(seed))
            assert planner.act(obs, {}) == plain.act(obs, {})


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("dblff", {}, "agent 'dblff' is not known; did you mean 'dblf'?"),
        ("HM", {}, "did you mean 'hm'?"),
        ("", {}, "give one of hm, dblf"),
        ("hm", {"seed": 3}, "agent hm: option 'seed' is not known, it takes none"),
        ("planner", {"heuristics": "hm"}, "it takes heuristic, max_checked"),
        ("planner", {"heuristic": "random"}, "give one of hm, dblf, mta, minz, first-fit"),
        ("planner", {"max_checked": 0}, "max_checked is 0, give at least 1"),
        ("learned", {}, "agent learned: option 'weights' is missing"),
    ],
)
def test_a_mistake_is_named_in_one_line(name: str, options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError) as caught:
        agents.make(name, **options)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_agents_come_without_torch() -> None:
    use = f"[agents.make(n) for n in {ON_SIGHT}]; print('torch' in sys.modules)"
    code = f"import sys; from packenv import agents; {use}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
