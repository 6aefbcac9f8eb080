"""The training configuration: to JSON and back, and one line for what is wrong."""

from __future__ import annotations

import json

import pytest

from packenv.errors import InputError

pytest.importorskip("torch", reason="training needs torch (pip install 'robotpack[train]')")

from packenv.train.config import PPOConfig, TrainConfig


def test_it_survives_json():
    config = TrainConfig(
        seed=5,
        workers=2,
        env_config={"mask": "legal"},
        order_generator={"kind": "random", "items": [2, 3]},
        ppo=PPOConfig(rollout=64, batch_size=32, learning_rate=1e-4),
    )
    again = TrainConfig.from_mapping(json.loads(json.dumps(config.to_mapping())))
    assert again == config
    assert TrainConfig.from_mapping({}) == TrainConfig()


def test_whole_numbers_may_stand_for_reals():
    assert TrainConfig.from_mapping({"ppo": {"gamma": 1}}).ppo.gamma == 1.0


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"timestep": 3}, "no 'timestep'; did you mean 'timesteps'"),
        ({"ppo": {"gama": 1}}, "ppo has no 'gama'; did you mean 'gamma'"),
        ({"ppo": [1]}, r"ppo is \[1\], give a JSON object"),
        ({"network": {"patch": 2.5}}, "network: patch is 2.5, give a whole number"),
        ({"seed": True}, "seed is True, give a whole number"),
        ({"seed": -1}, "seed is -1"),
        ({"env_config": None}, "env_config is None, give a JSON object"),
        ({"order_generator": "toy"}, "order_generator is 'toy', give a JSON object"),
        ({"timesteps": 0}, "timesteps is 0"),
        ({"evaluation_episodes": 1}, "evaluation_episodes is 1"),
        ({"ppo": {"learning_rate": 0}}, "learning_rate is 0"),
        ({"ppo": {"learning_rate": float("nan")}}, "learning_rate is nan"),
        ({"ppo": {"gamma": 1.5}}, "gamma is 1.5"),
        ({"ppo": {"ent_coef": float("inf")}}, "ent_coef is inf"),
        ({"ppo": {"rollout": 65, "batch_size": 32}}, "leaves one sample over"),
        ({"workers": 3, "ppo": {"rollout": 64}}, "divides evenly"),
    ],
)
def test_what_is_wrong_is_one_line(mapping, message):
    with pytest.raises(InputError, match=message) as caught:
        TrainConfig.from_mapping(mapping)
    assert "\n" not in str(caught.value)
