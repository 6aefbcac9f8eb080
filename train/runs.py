"""A run's folder: configuration, checkpoint, weights and progress, each written whole or not at all.

=================== ==========================================================================
config.json         network, layout and training configuration, seed included
policy.safetensors  weights at the last checkpoint
checkpoint.pt       weights, optimizer, counters and random states at the last checkpoint
progress.jsonl      one row an evaluation; rows are only ever added
baselines.json      what ``random`` and ``hm`` reach on the held-out episodes
curve.svg           return over steps
tensorboard/        event files
=================== ==========================================================================

A row of progress is part of its checkpoint and reaches the disk after it, so a run that was killed at any
moment goes on from a checkpoint that is at least as new as the last row.
"""

from __future__ import annotations

import io
import json
import pickle
import random
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from packenv.agents.placement_network import ObservationLayout, PlacementNetwork
from packenv.agents.policy_files import CONFIG_FILE, read_config, write_config, write_weights
from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.io.rows import RowFile
from packenv.json_text import read_json

from .config import TrainConfig

Row = dict[str, Any]


@dataclass(frozen=True)
class RandomStates:
    """State of every generator that training draws from, outside the environments."""

    torch: torch.Tensor
    numpy: tuple[Any, ...]
    python: tuple[Any, ...]

    @classmethod
    def of_now(cls) -> RandomStates:
        """The states of this process."""
        state: Any = np.random.get_state(legacy=True)  # noqa: NPY002
        name, keys, *rest = state
        return cls(torch.get_rng_state(), (name, keys.tolist(), *rest), random.getstate())

    def restore(self) -> None:
        """Make this process go on from here."""
        name, keys, *rest = self.numpy
        state: Any = (name, np.array(keys, dtype=np.uint32), *rest)
        torch.set_rng_state(self.torch)
        np.random.set_state(state)  # noqa: NPY002
        version, words, gauss = self.python
        random.setstate((version, tuple(words), gauss))


@dataclass(frozen=True)
class Checkpoint:
    """All that going on takes.

    Attributes:
        timesteps: steps taken.
        updates: passes over rollouts.
        wall_s: seconds spent, over all sessions.
        network: state dict of the network.
        optimizer: state dict of the optimizer.
        random: generators.
        row: the row of progress at these timesteps, with a ``key`` of its own.
    """

    timesteps: int
    updates: int
    wall_s: float
    network: dict[str, torch.Tensor]
    optimizer: dict[str, Any]
    random: RandomStates
    row: Row


class RunFolder:
    """Reads and writes the folder of one run. One process at a time."""

    def __init__(self, path: Path) -> None:
        """Name the folder; nothing is touched."""
        self.path = path

    @property
    def begun(self) -> bool:
        """Whether a run has been begun here."""
        return (self.path / CONFIG_FILE).exists()

    def begin(self, config: TrainConfig, layout: ObservationLayout) -> None:
        """Create the folder where needed, and write the configuration.

        Raises:
            InputError: the folder or the file cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise InputError(f"{self.path}: cannot be made a folder ({problem.strerror})") from None
        write_config(self.path, config.network, layout, config.to_mapping())

    def config(self) -> TrainConfig:
        """The configuration of the run that was begun here.

        Raises:
            InputError: there is none, or it is damaged.
        """
        document = read_config(self.path)
        if not isinstance(document.get("train"), dict):
            raise InputError(f"{self.path / CONFIG_FILE}: has no training configuration")
        return TrainConfig.from_mapping(document["train"])

    def save(self, checkpoint: Checkpoint, network: PlacementNetwork) -> None:
        """Write the checkpoint, then the weights, then the row of progress.

        Raises:
            InputError: a file cannot be written.
        """
        stream = io.BytesIO()
        torch.save({**vars(checkpoint), "random": asdict(checkpoint.random)}, stream)
        write_whole(self.path / "checkpoint.pt", stream.getvalue())
        self._publish(checkpoint, network)

    def load(self) -> Checkpoint | None:
        """The last checkpoint, or None before the first; nothing in the file is run.

        Raises:
            InputError: the file is damaged.
        """
        path = self.path / "checkpoint.pt"
        if not path.exists():
            return None
        try:
            stored = torch.load(path, map_location="cpu", weights_only=True)
            return Checkpoint(**{**stored, "random": RandomStates(**stored["random"])})
        except (
            OSError,
            RuntimeError,
            pickle.UnpicklingError,
            TypeError,
            KeyError,
            EOFError,
            ValueError,
        ) as problem:
            raise InputError(f"{path}: is not a checkpoint of this version ({problem})") from None

    def restore(self, checkpoint: Checkpoint, network: PlacementNetwork) -> None:
        """Put the checkpoint's weights into the network; finish what a kill after the checkpoint left undone.

        Raises:
            InputError: the checkpoint's network has other sizes.
        """
        try:
            network.load_state_dict(checkpoint.network)
        except RuntimeError as problem:
            raise InputError(
                f"{self.path / 'checkpoint.pt'}: does not fit {CONFIG_FILE} ({problem})"
            ) from None
        self._publish(checkpoint, network)

    def _publish(self, checkpoint: Checkpoint, network: PlacementNetwork) -> None:
        write_weights(self.path, network)
        progress = self._progress()
        if checkpoint.row["key"] not in progress:
            progress.append(checkpoint.row)

    def rows(self) -> list[Row]:
        """Every finished row of progress."""
        return list(self._progress())

    def _progress(self) -> RowFile:
        return RowFile(self.path / "progress.jsonl")

    def baselines(self) -> dict[str, Row]:
        """Rows of the baselines by agent; empty until they are measured."""
        path = self.path / "baselines.json"
        return dict(read_json(path)) if path.exists() else {}

    def write_baselines(self, baselines: dict[str, Row]) -> None:
        """Keep the rows of the baselines."""
        write_whole(self.path / "baselines.json", json.dumps(baselines, indent=1).encode() + b"\n")

    def write_curve(self, svg: str) -> None:
        """Keep the picture of the run."""
        write_whole(self.path / "curve.svg", svg.encode())
