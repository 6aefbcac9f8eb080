"""What a training run depends on, as frozen records that go to JSON and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, TypeVar

from packenv.agents.placement_network import NetworkConfig
from packenv.errors import InputError, check_known, is_number

T = TypeVar("T")

_MAX_SEED = 2**31 - 1


def _small_box() -> dict[str, Any]:
    """The environment that is trained in by default: tight, and cheap, for legality alone is asked."""
    return {"mask": "legal", "containers": [[0.24, 0.24, 0.20]], "candidates": 32}


def _tight_orders() -> dict[str, Any]:
    """The orders of it: more than always fits, so that policies can tell themselves apart."""
    return {"kind": "random", "items": [10, 14], "longest_side": [0.01, 0.19], "split": "train"}


@dataclass(frozen=True)
class PPOConfig:
    """Parameters of MaskablePPO.

    Attributes:
        learning_rate: of Adam, at the beginning; it falls linearly to a tenth at the last step.
        rollout: steps between two updates, over all workers.
        batch_size: samples a gradient step.
        n_epochs: passes over a rollout, at most.
        gamma: discount factor; 1, because an episode takes little more steps than its order has items.
        gae_lambda: of the generalized advantage estimate.
        clip_range: largest change of a probability ratio that pays.
        ent_coef: weight of the entropy bonus.
        vf_coef: weight of the value loss.
        max_grad_norm: the gradient is clipped to this norm.
        target_kl: an update stops early when the policy has moved further than 1.5 times this.
    """

    learning_rate: float = 1e-3
    rollout: int = 1024
    batch_size: int = 256
    n_epochs: int = 6
    gamma: float = 1.0
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.005
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    target_kl: float = 0.03

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            InputError: a value is out of range.
        """
        for name in ("learning_rate", "clip_range", "max_grad_norm", "target_kl"):
            _within(self, name, 0, math.inf, "above 0", open_below=True)
        for name in ("gamma", "gae_lambda"):
            _within(self, name, 0, 1, "between 0 and 1")
        for name in ("ent_coef", "vf_coef"):
            _within(self, name, 0, math.inf, "of at least 0")
        for name in ("rollout", "batch_size"):
            _within(self, name, 2, 10**7, "between 2 and 10,000,000")
        _within(self, "n_epochs", 1, 1000, "between 1 and 1000")
        if self.rollout % self.batch_size == 1:
            raise InputError(
                f"batch_size {self.batch_size} leaves one sample over of a rollout of {self.rollout}, whose "
                "advantage cannot be normalized; take a batch_size that divides rollout"
            )


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    Attributes:
        timesteps: steps to train for, over all workers; rounded up to whole rollouts.
        seed: of the weights, the order of the samples, and the environments.
        workers: environments, each in a process of its own; 1 runs it in the learner's process.
        threads: of torch in the learner; results are equal only for equal numbers.
        checkpoint_every: steps between two evaluations, each with a checkpoint; rounded up to whole rollouts.
        evaluation_episodes: held-out episodes an evaluation, the same ones each time.
        env_config: as ``PackEnv``'s ``config``; by default a small box under the ``legal`` mask.
        order_generator: as ``PackEnv``'s ``order_generator``; by default 10 to 14 items up to 19 cm long, of
            the kinds to train on.
        evaluation_order_generator: of the held-out episodes; None takes ``order_generator`` with other seeds.
        reward: as ``PackEnv``'s ``reward_fn``; None is its default.
        ppo: the algorithm.
        network: sizes of the network.
    """

    timesteps: int = 20_000
    seed: int = 0
    workers: int = 1
    threads: int = 1
    checkpoint_every: int = 4096
    evaluation_episodes: int = 50
    env_config: Mapping[str, Any] = field(default_factory=_small_box)
    order_generator: Mapping[str, Any] | None = field(default_factory=_tight_orders)
    evaluation_order_generator: Mapping[str, Any] | None = None
    reward: Mapping[str, Any] | None = None
    ppo: PPOConfig = field(default_factory=PPOConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            InputError: a value is out of range.
        """
        _within(self, "timesteps", 1, 10**12, "of at least 1")
        _within(self, "seed", 0, _MAX_SEED, f"between 0 and {_MAX_SEED}")
        _within(self, "workers", 1, 1024, "between 1 and 1024")
        _within(self, "threads", 1, 1024, "between 1 and 1024")
        _within(self, "checkpoint_every", 1, 10**12, "of at least 1")
        _within(self, "evaluation_episodes", 2, 10**6, "between 2 and 1,000,000")
        if self.ppo.rollout % self.workers:
            raise InputError(
                f"rollout is {self.ppo.rollout} and workers {self.workers}: "
                "give a rollout that divides evenly among the workers"
            )

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> TrainConfig:
        """Build a configuration from JSON.

        Args:
            mapping: any of the fields, ``ppo`` and ``network`` as mappings themselves.

        Raises:
            InputError: a key is unknown or a value is of the wrong kind or out of range.
        """
        nested = dict(_checked("training configuration", mapping, cls))
        for name, kind in (("ppo", PPOConfig), ("network", NetworkConfig)):
            if name in nested:
                nested[name] = kind(**_checked(name, nested[name], kind))
        return cls(**nested)

    def to_mapping(self) -> dict[str, Any]:
        """The configuration as JSON can hold it; :meth:`from_mapping` takes it back."""
        return asdict(self)


def _checked(where: str, mapping: object, kind: type[Any]) -> dict[str, Any]:
    """The mapping, once its keys are fields of the record and its values of the same kind as the defaults."""
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where} is {mapping!r}, give a JSON object")
    known = {f.name: f for f in fields(kind)}
    defaults = kind()
    values: dict[str, Any] = {}
    for key, value in mapping.items():
        check_known((key,), tuple(known), f"{where} has no", "there are")
        if value is None and "None" in str(known[key].type):
            values[key] = None
            continue
        values[key] = _of_kind(f"{where}: {key}", value, getattr(defaults, key))
    return values


def _of_kind(where: str, value: object, default: object) -> object:
    if isinstance(default, Mapping) or default is None:
        if isinstance(value, Mapping):
            return value
        raise InputError(f"{where} is {value!r}, give a JSON object")
    if isinstance(default, int) and is_number(value, whole=True):
        return value
    if isinstance(default, float) and is_number(value):
        return float(value)
    if not isinstance(default, int | float):
        return value  # a record of its own, which checks itself
    what = "a whole number" if isinstance(default, int) else "a number"
    raise InputError(f"{where} is {value!r}, give {what}")


def _within(
    record: object, name: str, lowest: float, highest: float, range_text: str, *, open_below: bool = False
) -> None:
    value = getattr(record, name)
    if not (lowest < value if open_below else lowest <= value) or not value <= highest or value == math.inf:
        raise InputError(f"{name} is {value}, give a number {range_text}")
