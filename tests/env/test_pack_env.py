"""The contract of ``RobotPack-v0`` with Gymnasium."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence, data_shares_objects
from gymnasium.vector import AutoresetMode

import packenv
from packenv.env.config import PackConfig
from packenv.env.pack_env import PackEnv
from packenv.env.reward import Outcome
from packenv.errors import InputError
from tests.env_samples import CONFIG, ITEMS, ORDER, Drawn, best_action, make_env, random_action, run_episode

MODES: dict[str, dict[str, Any]] = {
    "legal": {"mask": "legal"},
    "stable": {"mask": "stable"},
    "robot": {"mask": "robot"},
    "margin": {"mask": "stable", "stability": "margin"},
    "online": {"mask": "legal", "arrivals": "online", "buffer": 3},
    "terminate": {"mask": "legal", "on_infeasible": "terminate"},
    "containers": {"mask": "legal", "containers": [[0.16, 0.12, 0.10], [0.10, 0.14, 0.15]]},
    "physics": {"mask": "legal", "physics": True},
    "robot-physics": {"mask": "robot", "physics": True},
}


def registered(**kwargs: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(
        "RobotPack-v0",
        **{"config": {**CONFIG, "mask": "legal"}, "order_generator": ORDER, **kwargs},
    )


@pytest.mark.parametrize("mode", MODES)
def test_gymnasiums_checker_has_nothing_to_say(mode: str) -> None:
    env = registered(config={**CONFIG, **MODES[mode]})
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_the_passive_checker_watches_whole_episodes() -> None:
    env = registered()
    assert "PassiveEnvChecker" in str(env)
    for seed in range(3):
        obs, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            obs, _, terminated, truncated, _ = env.step(best_action(obs))
            ended = terminated or truncated
    env.close()


@pytest.mark.parametrize("mode", MODES)
def test_two_environments_roll_out_exactly_alike(mode: str) -> None:
    one, two = make_env(**MODES[mode]), make_env(**MODES[mode])
    steps = [list(run_episode(env, np.random.default_rng(1), seed=5)) for env in (one, two)]
    assert len(steps[0]) > 2
    assert data_equivalence(*steps, exact=True)
    for env in (one, two):
        env.close()


@pytest.mark.parametrize("mode", MODES)
def test_observations_and_masks_keep_their_promises(mode: str) -> None:
    env = make_env(**MODES[mode])
    rng = np.random.default_rng(2)
    obs, info = env.reset(seed=3)
    for seed in range(2):
        ended = False
        while not ended:
            assert env.observation_space.contains(obs)
            mask = info["action_mask"]
            assert mask.dtype == np.int8
            assert mask.any()
            np.testing.assert_array_equal(mask, obs["action_mask"])
            np.testing.assert_array_equal(mask.astype(bool), env.action_masks())
            before = (obs, info)
            obs, reward, terminated, truncated, info = env.step(random_action(mask, rng))
            assert type(reward) is float
            assert type(terminated) is bool
            assert type(truncated) is bool
            assert not data_shares_objects(before, (obs, info))
            assert reward == pytest.approx(sum(v for k, v in info.items() if k.startswith("reward_")))
            ended = terminated or truncated
            if not ended:
                assert info["action_mask"][:-1].any()
        assert env.observation_space.contains(obs)
        obs, info = env.reset(seed=seed)
    env.close()


def test_the_same_seed_draws_the_same_and_others_differ() -> None:
    env = make_env(mask="legal", order_generator=Drawn(), sequence="given")
    env.reset(seed=7)
    first = env.unwrapped.plan().order
    follow = [env.reset() and env.unwrapped.plan().order for _ in range(3)]
    env.reset(seed=7)
    assert env.unwrapped.plan().order == first
    assert [env.reset() and env.unwrapped.plan().order for _ in range(3)] == follow
    assert len({first, *follow}) > 2


def test_resetting_again_without_a_seed_goes_on_drawing() -> None:
    env = make_env(mask="legal", containers=[[0.16, 0.12, 0.10], [0.10, 0.14, 0.15]])
    env.reset(seed=0)
    labels = [env.reset()[1]["container"] for _ in range(12)]
    assert set(labels) == {"0.16x0.12x0.1", "0.1x0.14x0.15"}


@pytest.mark.parametrize("mode", ["robot", "online", "physics"])
@pytest.mark.parametrize("after", [None, 0, 2])
def test_a_pickled_environment_goes_on_like_its_original(mode: str, after: int | None) -> None:
    env = make_env(**MODES[mode], order_generator={"kind": "list", "items": list(ITEMS[:4])})
    rng = np.random.default_rng(0)
    if after is not None:
        obs, _ = env.reset(seed=11)
        for _ in range(after):
            obs, *_ = env.step(random_action(obs["action_mask"], rng))
        env.step(-1)
    twin = pickle.loads(pickle.dumps(env))
    if after is None:
        assert data_equivalence(env.reset(seed=1), twin.reset(seed=1), exact=True)
    np.testing.assert_array_equal(env.action_masks(), twin.action_masks())
    for _ in range(3):
        action = random_action(env.action_masks(), rng)
        assert data_equivalence(env.step(action), twin.step(action), exact=True)
    assert data_equivalence(env.reset(), twin.reset(), exact=True)
    for each in (env, twin):
        each.close()


def test_the_specification_survives_json() -> None:
    kwargs = {
        "config": {**CONFIG, "mask": "legal"},
        "order_generator": {"kind": "toy", "pieces": [2, 3], "container": [0.16, 0.12, 0.1], "step": 0.02},
        "reward_fn": {"complete": 2.0},
    }
    env = registered(**kwargs)
    spec = env.unwrapped.spec
    assert spec is not None
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    twin = gymnasium.make(again)
    assert data_equivalence(env.reset(seed=4), twin.reset(seed=4), exact=True)


@pytest.mark.parametrize("mode", list(AutoresetMode)[:2])
@pytest.mark.parametrize("kind", ["sync", "async"])
def test_vector_environments_step_like_single_ones(kind: str, mode: AutoresetMode) -> None:
    vector_kwargs = {"autoreset_mode": mode}
    envs = gymnasium.make_vec(
        "RobotPack-v0",
        num_envs=2,
        vectorization_mode=kind,
        vector_kwargs=vector_kwargs,
        config={**CONFIG, "mask": "legal"},
        order_generator=ORDER,
    )
    single = [make_env(mask="legal") for _ in range(2)]
    obs, _ = envs.reset(seed=[1, 2])
    lone = [env.reset(seed=seed)[0] for env, seed in zip(single, (1, 2), strict=True)]
    over = [False, False]
    resets = 0
    for _ in range(16):
        actions = np.array([best_action({k: v[i] for k, v in obs.items()}) for i in range(2)])
        obs, rewards, terminated, truncated, _ = envs.step(actions)
        for i, env in enumerate(single):
            if over[i] and mode == AutoresetMode.NEXT_STEP:
                lone[i], _ = env.reset()
                over[i] = False
                resets += 1
            else:
                lone[i], reward, over[i], _, _ = env.step(int(actions[i]))
                assert reward == pytest.approx(rewards[i])
                assert over[i] == bool(terminated[i])
                if over[i] and mode == AutoresetMode.SAME_STEP:
                    lone[i], _ = env.reset()
                    resets += 1
            assert data_equivalence({k: v[i] for k, v in obs.items()}, lone[i], exact=True)
    assert resets >= 2
    assert not truncated.any()
    envs.close()


def test_an_invalid_action_changes_nothing_and_in_the_end_truncates() -> None:
    env = make_env(mask="legal", max_invalid=3)
    obs, info = env.reset(seed=0)
    padding = int(np.flatnonzero(info["action_mask"] == 0)[0]) if (info["action_mask"] == 0).any() else 99
    for count, action in enumerate((padding, -1, 13), start=1):
        after, reward, terminated, truncated, info = env.step(action)
        assert info["invalid_action"] is True
        assert reward == info["reward_invalid"] == pytest.approx(-0.1)
        assert data_equivalence(obs, after, exact=True)
        assert not terminated
        assert truncated is (count == 3)


@pytest.mark.parametrize(
    "action", [1.5, 1.0, np.float64(0), "0", "a", None, float("nan"), [0], {}, 10**400, -(10**400)]
)
def test_what_is_no_whole_number_in_range_is_an_invalid_action(action: Any) -> None:
    env = make_env(mask="legal")
    obs, _ = env.reset(seed=0)
    after, reward, terminated, truncated, info = env.step(action)
    assert info["invalid_action"] is True
    assert reward == pytest.approx(-0.1)
    assert not terminated
    assert not truncated
    assert data_equivalence(obs, after, exact=True)
    assert data_equivalence(pickle.loads(pickle.dumps(env)).action_masks(), env.action_masks(), exact=True)


@pytest.mark.parametrize("kind", [int, np.int32, np.uint8, np.array])
def test_whole_numbers_of_every_kind_are_actions(kind: Any) -> None:
    env = make_env(mask="legal")
    obs, _ = env.reset(seed=0)
    *_, info = env.step(kind(best_action(obs)))
    assert info["invalid_action"] is False


def test_a_valid_action_forgives_invalid_ones() -> None:
    env = make_env(mask="legal", max_invalid=2)
    obs, _ = env.reset(seed=0)
    for _ in range(2):
        *_, truncated, info = env.step(99)
        assert not truncated
        obs, _, _, truncated, info = env.step(best_action(obs))
        assert not truncated
        assert info["invalid_action"] is False


def test_closing_twice_is_fine_and_resetting_opens_again() -> None:
    env = make_env(mask="legal", physics=True)
    env.close()
    obs, _ = env.reset(seed=0)
    env.step(best_action(obs))
    env.close()
    env.close()
    env.reset()
    env.close()


def test_a_step_without_an_episode_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        make_env().step(0)


def test_the_mask_is_what_masked_sampling_takes() -> None:
    env = make_env(mask="legal")
    _, info = env.reset(seed=0)
    for _ in range(20):
        assert info["action_mask"][env.action_space.sample(info["action_mask"])] == 1


def test_the_rewards_of_a_complete_order_add_up() -> None:
    env = make_env(mask="legal", containers=[[0.3, 0.3, 0.2]])
    obs, info = env.reset(seed=0)
    total, ended = 0.0, False
    while not ended:
        obs, reward, ended, _, info = env.step(best_action(obs))
        total += reward
    assert info["packed_items"] == len(ITEMS)
    assert info["left_over"] == []
    assert total == pytest.approx(1.0 + info["utilization"] + 1.0)
    plan = env.plan()
    volume = sum(mesh.volume for mesh in plan.meshes.values())
    assert info["utilization"] == pytest.approx(volume / plan.container.volume)


def test_a_reward_of_ones_own_names_its_terms() -> None:
    def per_item(outcome: Outcome) -> dict[str, float]:
        return {"items": float(outcome.placed)}

    env = make_env(mask="legal", reward_fn=per_item)
    obs, info = env.reset(seed=0)
    assert info["reward_items"] == 0.0
    _, reward, _, _, info = env.step(best_action(obs))
    assert reward == info["reward_items"] == 1.0
    assert [key for key in info if key.startswith("reward_")] == ["reward_items"]


def test_an_order_and_a_container_can_be_given_to_reset() -> None:
    env = make_env(mask="legal", sequence="given")
    options = {"order": ["golf_ball", "soap_bar", "golf_ball"], "container": (0.12, 0.11, 0.1)}
    _, info = env.reset(options=options)
    assert (info["item"], info["items_left"], info["container"]) == ("golf_ball", 3, "0.12x0.11x0.1")


def test_an_order_of_which_nothing_fits_ends_at_the_first_action() -> None:
    env = make_env(mask="legal", containers=[[0.02, 0.02, 0.02]])
    obs, info = env.reset(seed=0)
    assert np.flatnonzero(obs["action_mask"]).tolist() == [12]
    assert sorted(info["left_over"]) == sorted(ITEMS)
    _, reward, terminated, truncated, info = env.step(12)
    assert terminated
    assert not truncated
    assert reward == 0.0


def test_a_plan_of_an_episode_is_one_that_can_be_read_again(tmp_path: Path) -> None:
    from packenv.io.plans import read_plan, write_plan

    env = make_env(mask="robot")
    for _ in run_episode(env, np.random.default_rng(0), seed=0):
        pass
    plan = env.plan()
    assert plan.placements
    write_plan(tmp_path / "plan.json", plan)
    again = read_plan(tmp_path / "plan.json")
    assert [p.item for p in again.placements] == [p.item for p in plan.placements]
    assert plan.metrics["packed"] + len(plan.leftovers) == len(ITEMS)


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"config": {"maks": "legal"}}, "did you mean 'mask'"),
        ({"config": {"mask": "easy"}}, "mask is 'easy'"),
        ({"config": {"candidates": 0}}, "candidates is 0"),
        ({"config": {"grid": {"n_poses": 1.5}}}, "grid: n_poses is 1.5, give a whole number"),
        ({"config": {"containers": [[0.3, 0.3]]}}, "containers has"),
        ({"config": {"containers": [[0.3, 0.3, 9.0]]}}, "out of range"),
        ({"config": {"catalogue": "/no/such/folder"}}, "no such folder"),
        ({"reward_fn": {"speed": 1.0}}, "no term 'speed'"),
        ({"reward_fn": {"packed": "much"}}, "weight of packed"),
        ({"render_mode": "ascii"}, "render_mode is 'ascii'"),
        ({"order_generator": {"kind": "list", "items": ["no such item"]}}, "no such item"),
    ],
)
def test_a_wrong_setting_is_told_in_one_line(kwargs: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError) as told:
        PackEnv(**kwargs)
    assert word in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"order": ["nothing"]}, "asks for 'nothing'"),
        ({"order": "mug"}, "order is 'mug', give a list"),
        ({"order": 3}, "order is 3, give a list"),
        ({"order": ["mug", 3]}, "has 3, give item names"),
        ({"container": (0.5, 0.1, 0.1)}, "larger than"),
        ({"container": (0.5, 0.1)}, "three lengths"),
        ({"container": "0.1x0.1x0.1"}, "three lengths"),
        ({"container": (0.1, "a", 0.1)}, "width is 'a'"),
        ({"containers": (0.1, 0.1, 0.1)}, "did you mean 'container'"),
        ({"Order": ["mug"]}, "did you mean 'order'"),
        ({"xyz": 1}, "order, container"),
    ],
)
def test_a_wrong_reset_is_told_in_one_line(options: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError) as told:
        make_env().reset(options=options)
    assert word in str(told.value)
    assert "\n" not in str(told.value)


def test_a_configuration_goes_through_json() -> None:
    config = PackConfig.from_mapping({**CONFIG, "mask": "stable"})
    assert PackConfig.from_mapping(json.loads(json.dumps(config.to_mapping()))) == config


def test_importing_the_package_registers_and_stays_light() -> None:
    assert "RobotPack-v0" in gymnasium.registry
    code = (
        "import sys, packenv, gymnasium\n"
        "heavy = {'pybullet', 'torch', 'numba', 'scipy', 'trimesh'} & set(sys.modules)\n"
        "sys.exit(f'imports {heavy}' if heavy or 'RobotPack-v0' not in gymnasium.registry else 0)"
    )
    root = Path(packenv.__file__).parents[1]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)
