"""Run agents through episodes: the same seed gives the same record, whatever the number of workers."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from packenv.backends import imap_unordered
from packenv.env.config import PackConfig
from packenv.io.rows import row_key
from packenv.shipped import BUILTIN
from packenv.version import __version__

from .protocol import Agent
from .registry import make

if TYPE_CHECKING:
    import gymnasium

TIMEOUT = 1800.0
"""Seconds after which an episode is given up."""

OrderSpec: TypeAlias = Mapping[str, object] | str
"""What :func:`packenv.env.orders.from_spec` takes."""


@dataclass(frozen=True)
class EpisodeRecord:
    """What became of one episode.

    Attributes:
        agent: name of the agent.
        episode: its number, from 0; of one number, all agents of a run get the same order.
        seed: what the environment and the agent were reset with.
        container: label of the container.
        items: number of items in the order.
        packed: how many of them were placed.
        left_over: names of those that were left over.
        utilization: volume of the placed items as a share of the container's.
        total_reward: sum of the rewards (the undiscounted return).
        steps: actions that were taken.
        invalid_actions: how many of them were invalid.
        truncated: whether the episode was cut off.
        seconds: wall time of all choices and steps, without the reset; records are equal without it.
    """

    agent: str
    episode: int
    seed: int
    container: str
    items: int
    packed: int
    left_over: tuple[str, ...]
    utilization: float
    total_reward: float
    steps: int
    invalid_actions: int
    truncated: bool
    seconds: float = field(compare=False)

    @property
    def complete(self) -> bool:
        """Whether the whole order was packed."""
        return self.packed == self.items

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> EpisodeRecord:
        """The record of a row, as :func:`run_episodes` makes rows."""
        values = {name: value for name, value in row.items() if name != "key"}
        return cls(**{**values, "left_over": tuple(values["left_over"])})


@dataclass(frozen=True)
class FailedEpisode:
    """An episode that raised, hung, or took its process down.

    Attributes:
        agent: name of the agent.
        episode: its number.
        seed: what it began with.
        error: what happened, one line.
    """

    agent: str
    episode: int
    seed: int
    error: str


@dataclass(frozen=True)
class AgentSpec:
    """An agent by its name, with its options as :func:`packenv.agents.make` takes them."""

    name: str
    options: Mapping[str, object] = field(default_factory=dict)

    def make(self) -> Agent:
        """The agent.

        Raises:
            InputError: as :func:`packenv.agents.make`.
        """
        return make(self.name, **self.options)


@dataclass(frozen=True)
class Setting:
    """The environment that episodes run in.

    Attributes:
        config: its configuration.
        order_generator: the specification of its orders, or ``my_module:MyGenerator``; None takes the
            environment's own.
    """

    config: PackConfig = field(default_factory=PackConfig)
    order_generator: OrderSpec | None = None

    def make(self) -> gymnasium.Env[Any, Any]:
        """The environment.

        Raises:
            InputError: the catalogue or the specification of the orders is wrong.
        """
        from packenv.env.pack_env import PackEnv

        return PackEnv(self.config, order_generator=self.order_generator)


@dataclass(frozen=True)
class EpisodeJob:
    """One episode to run.

    Attributes:
        key: hash of all that its record depends on, the seconds apart.
        agent: who acts.
        episode: its number.
        seed: what it begins with.
    """

    key: str
    agent: AgentSpec
    episode: int
    seed: int


def episode_jobs(
    agents: Sequence[AgentSpec], setting: Setting, *, episodes: int, seed: int
) -> tuple[EpisodeJob, ...]:
    """Every episode of every agent; those of one number come one after another, on the same order.

    Args:
        agents: who acts.
        setting: where.
        episodes: number of episodes of each agent.
        seed: gives each episode a seed of its own, which does not depend on how many there are.
    """
    seeds = [_episode_seed(seed, k) for k in range(episodes)]
    common = (
        __version__,
        _canonical(setting.config.to_mapping()),
        _canonical(setting.order_generator),
        _files_digest(setting),
    )
    agent_parts = [(agent.name, _canonical(agent.options), _weights_digest(agent)) for agent in agents]
    return tuple(
        EpisodeJob(row_key(*common, *parts, k, own), agent, k, own)
        for k, own in enumerate(seeds)
        for agent, parts in zip(agents, agent_parts, strict=True)
    )


def run_episodes(
    jobs: Sequence[EpisodeJob], setting: Setting, *, workers: int = 1, timeout: float = TIMEOUT
) -> Iterator[tuple[str, EpisodeRecord | FailedEpisode]]:
    """Run episodes; yield the key and the record of each as it ends.

    Args:
        jobs: the episodes.
        setting: what they were made for by :func:`episode_jobs`.
        workers: number of processes; 1 runs all in this one.
        timeout: seconds after which an episode is given up.

    Raises:
        InputError: an agent or the environment cannot be made.
    """
    if not jobs:
        return
    agents = tuple({job.agent.name: job.agent for job in jobs}.values())
    if workers > 1:
        # What is wrong with the input is said here, once, and not by every process.
        _prepare(setting, agents)
        _clear()
    outcomes = imap_unordered(
        _work,
        jobs,
        backend="serial" if workers == 1 else "pebble",
        workers=workers,
        timeout=timeout,
        prepare=_prepare,
        arguments=(setting, agents),
        start="spawn",
    )
    try:
        for outcome in outcomes:
            job = outcome.job
            if outcome.row is None:
                yield job.key, FailedEpisode(job.agent.name, job.episode, job.seed, outcome.error)
            else:
                yield job.key, outcome.row["record"]
    finally:
        _clear()


def run_episode(
    env: gymnasium.Env[Any, Any], agent: Agent, *, name: str, episode: int, seed: int
) -> EpisodeRecord:
    """Run one episode.

    Args:
        env: ``RobotPack-v0``, wrapped or not.
        agent: who acts.
        name: of the agent, for the record.
        episode: its number, for the record.
        seed: what environment and agent are reset with.
    """
    obs, info = env.reset(seed=seed)
    agent.reset(seed)
    items = info["packed_items"] + info["items_left"] + len(info["left_over"])
    total_reward, steps, invalid = 0.0, 0, 0
    terminated = truncated = False
    start = time.perf_counter()
    while not (terminated or truncated):
        obs, reward, terminated, truncated, info = env.step(agent.act(obs, info))
        total_reward += float(reward)
        steps += 1
        invalid += bool(info["invalid_action"])
    return EpisodeRecord(
        agent=name,
        episode=episode,
        seed=seed,
        container=info["container"],
        items=items,
        packed=info["packed_items"],
        left_over=tuple(info["left_over"]),
        utilization=float(info["utilization"]),
        total_reward=total_reward,
        steps=steps,
        invalid_actions=invalid,
        truncated=truncated,
        seconds=time.perf_counter() - start,
    )


class _Process:
    """What this process has made for its episodes."""

    env: gymnasium.Env[Any, Any] | None = None
    agents: Mapping[str, Agent] = {}


def _prepare(setting: Setting, agents: Sequence[AgentSpec]) -> None:
    _Process.agents = {agent.name: agent.make() for agent in agents}
    _Process.env = setting.make()


def _clear() -> None:
    if _Process.env is not None:
        _Process.env.close()
    _Process.env, _Process.agents = None, {}


def _work(job: EpisodeJob) -> dict[str, Any]:
    assert _Process.env is not None
    agent = _Process.agents[job.agent.name]
    record = run_episode(_Process.env, agent, name=job.agent.name, episode=job.episode, seed=job.seed)
    return {"record": record}


def record_row(key: str, record: EpisodeRecord) -> dict[str, Any]:
    """The row of a record, JSON-able; :meth:`EpisodeRecord.of_row` reads it."""
    return {"key": key, **asdict(record)}


def _episode_seed(seed: int, episode: int) -> int:
    """53 bits, which JSON keeps everywhere; so runs of neighbouring seeds share no episode."""
    return int(np.random.SeedSequence([seed, episode]).generate_state(1, np.uint64)[0] >> np.uint64(11))


def _canonical(document: object) -> str:
    return json.dumps(document, sort_keys=True, default=str)


def _files_digest(setting: Setting) -> str:
    """Of what the setting names by its path: the catalogue's folder and a file of orders."""
    spec = setting.order_generator if isinstance(setting.order_generator, Mapping) else {}
    paths = [] if setting.config.catalogue == BUILTIN else [Path(setting.config.catalogue)]
    paths += [Path(str(spec["path"]))] if "path" in spec else []
    return _digest(file for path in paths for file in ([path] if path.is_file() else path.glob("*")))


def _weights_digest(agent: AgentSpec) -> str:
    """Of the files that a learned policy consists of."""
    path = Path(str(agent.options.get("weights", "")))
    if "weights" not in agent.options:
        return ""
    if path.is_file():
        return _digest(iter([path]))
    return _digest(file for file in path.glob("*") if file.suffix in (".safetensors", ".json"))


def _digest(files: Iterator[Path]) -> str:
    content = hashlib.sha256()
    for file in sorted(file for file in files if file.is_file()):
        content.update(f"{file.name}\0{file.stat().st_size}\0".encode())
        content.update(file.read_bytes())
    return content.hexdigest()
