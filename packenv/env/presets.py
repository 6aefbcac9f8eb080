"""Environments that tell agents apart, by name: each is registered as ``RobotPack-<name>-v0``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_TIGHT = {"mask": "legal", "containers": [[0.24, 0.24, 0.20]]}
_TIGHT_ORDERS = {"kind": "random", "items": [18, 22], "longest_side": [0.01, 0.19]}


@dataclass(frozen=True)
class Preset:
    """An environment by name.

    Attributes:
        meaning: one sentence for people.
        config: as :class:`packenv.env.pack_env.PackEnv` takes it.
        order_generator: likewise.
    """

    meaning: str
    config: Mapping[str, Any]
    order_generator: Mapping[str, Any]

    def to_kwargs(self) -> dict[str, Any]:
        """What ``PackEnv`` is called with, as JSON has it."""
        return {"config": dict(self.config), "order_generator": dict(self.order_generator)}


PRESETS: Mapping[str, Preset] = {
    "tight-offline": Preset(
        "more items than a small box takes, all of them known; free of overlap alone", _TIGHT, _TIGHT_ORDERS
    ),
    "tight-online": Preset(
        "the same, but items come one by one and only the current one is seen",
        {**_TIGHT, "arrivals": "online", "buffer": 1},
        _TIGHT_ORDERS,
    ),
    "large": Preset(
        "about as many items as the paper's box takes, all of them known; free of overlap alone",
        {"mask": "legal", "containers": [[0.32, 0.32, 0.30]]},
        {"kind": "random", "items": [22, 28]},
    ),
    "paper": Preset(
        "the paper's orders of ten under all constraints, with its contacts and its grasp",
        {"mask": "robot", "contacts": "paper", "grasp": "paper"},
        {"kind": "random", "items": 10, "repeats": False},
    ),
}
"""By name."""


def env_id(name: str) -> str:
    """The id of a preset for ``gymnasium.make``."""
    return f"RobotPack-{name}-v0"
