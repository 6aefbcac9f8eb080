"""What an agent is: from what the environment shows to the number of an action."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias

from numpy.typing import NDArray

from packenv.types import IntArray

Observation: TypeAlias = Mapping[str, NDArray[Any]]
"""The ``Dict`` observation of ``RobotPack-v0``, or of a vector environment: n in front of each shape."""


class Agent(Protocol):
    """Chooses actions. With K candidates, action k < K places at candidate k, and K defers the item."""

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """One action for one observation; a valid one wherever there is one."""
        ...

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """(n,) int64 actions for n observations, as :meth:`act` would choose them one after another.

        Args:
            obs: as a vector environment stacks them.
            infos: as a vector environment gives them.
        """
        ...

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode anew; the seed decides all that the agent draws until the next call."""
        ...
