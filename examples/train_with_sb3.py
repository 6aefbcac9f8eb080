"""Train a policy with Stable-Baselines3's own policy network; pip install 'robotpack[train]'.

A few hundred steps teach it nothing yet: docs/training.md says what more it takes.
"""

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import packenv  # noqa: F401  registers RobotPack-v0

CONFIG = {"mask": "legal", "containers": [[0.24, 0.24, 0.2]], "candidates": 16, "max_items": 8}

env = Monitor(gymnasium.make("RobotPack-v0", config=CONFIG, order_generator={"kind": "random", "items": 5}))
model = PPO("MultiInputPolicy", env, n_steps=64, batch_size=32, seed=0)
before = [weight.detach().clone() for weight in model.policy.parameters()]
model.learn(128)

changed = any(bool((a != b).any()) for a, b in zip(before, model.policy.parameters(), strict=True))
reward, _ = evaluate_policy(model, env, n_eval_episodes=2, warn=False)
assert changed
print(f"trained {model.num_timesteps} steps; mean return of two episodes {reward:.2f}")
