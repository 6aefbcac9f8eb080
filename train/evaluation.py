"""What a policy reaches on given episodes while it is being trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium

from packenv.agents.placement_network import PlacementNetwork, best_actions
from packenv.agents.protocol import Agent, Observation
from packenv.agents.running import run_episode
from packenv.agents.summary import summarize
from packenv.types import IntArray


class NetworkAgent:
    """The policy in training as an agent; it sees the network as it is at each step."""

    def __init__(self, network: PlacementNetwork) -> None:
        """Take the network, not a copy."""
        self._network = network

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """The best valid action."""
        return int(self.act_batch({name: value[None] for name, value in obs.items()}, {})[0])

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """The best valid action (n,) for each observation."""
        return best_actions(self._network, obs)

    def reset(self, seed: int | None = None) -> None:
        """Nothing is kept between steps."""


def evaluate(agent: Agent, name: str, env: gymnasium.Env[Any, Any], seeds: Sequence[int]) -> dict[str, Any]:
    """Run one episode from each seed.

    Args:
        agent: is reset with the episode's seed.
        name: of the agent.
        env: RobotPack-v0.
        seeds: of the episodes, two or more.

    Returns:
        ``agent``, ``episodes`` and the means ``return`` with half its 95 % interval ``return_ci95``,
        ``packed_share``, ``complete`` (of the orders) and ``utilization``.
    """
    found = summarize(
        name, [run_episode(env, agent, name=name, episode=k, seed=s) for k, s in enumerate(seeds)]
    )
    assert found.total_reward.high is not None
    return {
        "agent": name,
        "episodes": found.episodes,
        "return": found.total_reward.mean,
        "return_ci95": found.total_reward.high - found.total_reward.mean,
        "packed_share": found.packed_share.mean,
        "complete": found.complete.mean,
        "utilization": found.utilization.mean,
    }
