"""The network of the learned placement policy: plain torch, no Stable-Baselines3.

It reads an observation of RobotPack-v0 and gives a logit for every candidate, one for *defer*, and the
value of the state. Nothing in it depends on the number of candidates, items or stable poses, nor on the
size of the heightmaps: candidates pass through shared layers one by one, items are pooled, and the
convolutions end in a pooling of fixed size. Permuting the candidates therefore permutes their logits and
leaves *defer* and the value as they are.

Inputs are divided by the container's size inside the network, so no running statistics have to be kept
beside the weights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from packenv.errors import InputError
from packenv.types import IntArray

_MAP_SIZE = 8
"""Pixels a side after pooling, before the last convolution of a map."""

_MARGIN_SCALE = 0.02
"""A support margin of this many metres is 1 in the network's input."""

_RANK_SCALE = 8.0
"""ln(1 + rank) is divided by this: about 1 for the 3,000th candidate."""

_BEARS_SCALE = math.log(101.0)
"""ln(1 + kg) is divided by this: 1 for an item without a limit."""


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the network.

    Attributes:
        channels: of the first convolution; the second has twice as many.
        embedding: numbers that describe one candidate, one item or one map.
        context: numbers that describe the whole state.
        patch: samples a side of the container heightmap under a candidate and just beside it.
    """

    channels: int = 12
    embedding: int = 64
    context: int = 128
    patch: int = 6

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            InputError: a size is not positive or is absurdly large.
        """
        for name, largest in (("channels", 512), ("embedding", 4096), ("context", 8192), ("patch", 64)):
            value = getattr(self, name)
            if not 1 <= value <= largest:
                raise InputError(f"network {name} is {value}, give a whole number from 1 to {largest}")


@dataclass(frozen=True)
class ObservationLayout:
    """What the numbers of an observation mean; a policy fits only the layout that it was trained on.

    Attributes:
        candidates: names of the columns of ``candidates``.
        remaining: names of the columns of ``remaining``.
        state: names of the entries of ``state``.
        pixel: side of a pixel of the observed heightmaps, m.
    """

    candidates: tuple[str, ...]
    remaining: tuple[str, ...]
    state: tuple[str, ...]
    pixel: float


class Encoding(NamedTuple):
    """What the heads see: ``context`` (b, c) of the state, ``candidates`` (b, k, e), one row each."""

    context: Tensor
    candidates: Tensor


class PlacementNetwork(nn.Module):
    """Encoder, actor and critic of the placement policy."""

    def __init__(self, layout: ObservationLayout, config: NetworkConfig) -> None:
        """Build the network with fresh weights.

        Raises:
            InputError: the layout lacks a column that the network needs.
        """
        super().__init__()
        self.encoder = Encoder(layout, config)
        self.actor = Actor(self.encoder.candidate_size, config)
        self.critic = Critic(config)

    def forward(self, observation: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Logits (b, k + 1) of a batch of observations, *defer* last, nothing masked, and values (b, 1)."""
        encoding = self.encoder(observation)
        return self.actor(encoding), self.critic(encoding.context)


def best_actions(network: PlacementNetwork, observation: Mapping[str, NDArray[Any]]) -> IntArray:
    """The valid action with the largest logit (n,) for each of n observations.

    Args:
        network: the policy.
        observation: arrays of RobotPack-v0, stacked along a first axis of n.
    """
    tensors = {
        name: torch.as_tensor(np.asarray(value), dtype=torch.float32) for name, value in observation.items()
    }
    with torch.inference_mode():
        logits = network.actor(network.encoder(tensors)).numpy()
    valid = np.asarray(observation["action_mask"]).astype(bool)
    best: IntArray = np.where(valid, logits, -np.inf).argmax(axis=1)
    return best


class Encoder(nn.Module):
    """Observation to :class:`Encoding`."""

    def __init__(self, layout: ObservationLayout, config: NetworkConfig) -> None:
        """Build the encoder.

        Raises:
            InputError: the layout lacks a column that the network needs.
        """
        super().__init__()
        self.normalize = _Normalizer(layout)
        self.patch = config.patch
        self.container_map = _MapEncoder(2, config)
        self.item_map = _MapEncoder(3, config)
        size, rows = config.embedding, self.normalize.candidate_columns
        self.item = _mlp(self.normalize.item_columns, size, size)
        self.candidate = _mlp(rows + config.patch**2 + size, size, size)
        self.candidate_size: int = size + rows
        pooled = 6 * size + self.normalize.item_columns + self.normalize.state_columns
        self.context = _mlp(pooled, config.context, config.context)

    def forward(self, observation: Mapping[str, Tensor]) -> Encoding:
        """Describe a batch of observations."""
        seen = self.normalize(observation)
        container = self.container_map(torch.stack((seen.container, torch.ones_like(seen.container)), dim=1))
        batch, poses = seen.item_maps.shape[:2]
        by_pose = self.item_map(seen.item_maps.flatten(0, 1)).unflatten(0, (batch, poses))
        exists = (seen.item_maps[:, :, 2].amax((-2, -1)) > 0).float()
        by_pose = by_pose * exists[..., None]

        own_pose = torch.take_along_dim(by_pose, seen.pose[..., None].clamp(max=poses - 1), dim=1)
        patches = surface_patches(seen, self.patch)
        rows = self.candidate(torch.cat((seen.candidates, patches, own_pose), dim=2))
        rows = rows * seen.present[..., None]
        items = self.item(seen.items) * seen.items_present[..., None]

        context = self.context(
            torch.cat(
                (
                    container,
                    by_pose.amax(1),
                    _mean(items, seen.items_present),
                    items.amax(1),
                    _mean(rows, seen.valid),
                    (rows * seen.valid[..., None]).amax(1),
                    seen.items[:, 0],
                    seen.state,
                ),
                dim=1,
            )
        )
        return Encoding(context, torch.cat((rows, seen.candidates), dim=2))


class Actor(nn.Module):
    """A logit for each candidate from shared layers, and one for *defer* from the context."""

    def __init__(self, candidate_size: int, config: NetworkConfig) -> None:
        """Build the head; its logits begin near 0, so the untrained policy is nearly uniform."""
        super().__init__()
        self.of_candidate = nn.Linear(candidate_size, config.embedding)
        self.of_context = nn.Linear(config.context, config.embedding, bias=False)
        self.score = nn.Linear(config.embedding, 1)
        self.direct = nn.Linear(candidate_size, 1, bias=False)
        of_defer = nn.Linear(config.embedding, 1)
        self.defer = nn.Sequential(nn.Linear(config.context, config.embedding), nn.ReLU(), of_defer)
        for last in (self.score, self.direct, of_defer):
            nn.init.orthogonal_(last.weight, gain=0.01)
        nn.init.zeros_(self.score.bias)
        nn.init.zeros_(of_defer.bias)

    def forward(self, encoding: Encoding) -> Tensor:
        """Logits (b, k + 1), *defer* last."""
        hidden = functional.relu(
            self.of_candidate(encoding.candidates) + self.of_context(encoding.context)[:, None]
        )
        logits = (self.score(hidden) + self.direct(encoding.candidates)).squeeze(2)
        return torch.cat((logits, self.defer(encoding.context)), dim=1)


class Critic(nn.Module):
    """The value of the state, from the context alone."""

    def __init__(self, config: NetworkConfig) -> None:
        """Build the head."""
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(config.context, config.embedding), nn.ReLU(), nn.Linear(config.embedding, 1)
        )

    def forward(self, context: Tensor) -> Tensor:
        """Values (b, 1)."""
        value: Tensor = self.layers(context)
        return value


class _Seen(NamedTuple):
    """A batch of observations in the network's own scale (b states, k candidates, n items, p poses)."""

    container: Tensor  # (b, x, y) in container heights
    item_maps: Tensor  # (b, p, 3, m, m) in container heights; footprint as it is
    candidates: Tensor  # (b, k, columns)
    present: Tensor  # (b, k) 0 or 1
    valid: Tensor  # (b, k) 0 or 1: the action mask without *defer*
    pose: Tensor  # (b, k) int64
    box: Tensor  # (b, k, 5): x, y, z, length, width in m
    items: Tensor  # (b, n, columns)
    items_present: Tensor  # (b, n)
    state: Tensor  # (b, columns)
    height: Tensor  # (b,) of the container, m
    pixel: float


class _Normalizer(nn.Module):
    """Scales observations by the container's size and drops what carries no information. No parameters."""

    def __init__(self, layout: ObservationLayout) -> None:
        super().__init__()
        self.layout = layout
        self._row = _Columns("candidates", layout.candidates, _CANDIDATE_COLUMNS)
        self._item = _Columns("remaining", layout.remaining, _ITEM_COLUMNS)
        self._state = _Columns("state", layout.state, _STATE_COLUMNS)
        self._scores = [i for i, name in enumerate(layout.candidates) if name.startswith("score_")]
        self._ranks = [i for i, name in enumerate(layout.candidates) if name.startswith("rank_")]
        if len(self._scores) != len(self._ranks) or not self._scores:
            raise InputError("observation layout: every score_<heuristic> needs its rank_<heuristic>")
        self.candidate_columns = 15 + len(self._scores) + 2 * len(self._ranks)
        self.item_columns = len(_ITEM_COLUMNS)
        self.state_columns = len(_STATE_COLUMNS) + 1

    def forward(self, observation: Mapping[str, Tensor]) -> _Seen:
        state, rows, items = observation["state"], observation["candidates"], observation["remaining"]
        size = torch.stack([self._state(state, side) for side in _SIDES], dim=1)
        height = size[:, 2].clamp(min=1e-3)
        return _Seen(
            container=observation["container"] / height[:, None, None],
            item_maps=_scaled_maps(observation["item"], height),
            candidates=self._candidates(rows, size),
            present=self._row(rows, "present"),
            valid=observation["action_mask"][:, : rows.shape[1]].float(),
            pose=self._row(rows, "pose").round().long().clamp(min=0),
            box=torch.stack([self._row(rows, name) for name in ("x", "y", "z", "length", "width")], dim=2),
            items=self._items(items, size),
            items_present=self._item(items, "present"),
            state=self._states(state, size),
            height=height,
            pixel=self.layout.pixel,
        )

    def _candidates(self, rows: Tensor, size: Tensor) -> Tensor:
        column = self._row
        length, width, height = (size[:, None, i].clamp(min=1e-3) for i in range(3))
        yaw, present = column(rows, "yaw"), column(rows, "present")
        ranks = rows[..., self._ranks]
        shown = torch.stack(
            (
                column(rows, "x") / length,
                column(rows, "y") / width,
                column(rows, "z") / height,
                column(rows, "length") / length,
                column(rows, "width") / width,
                column(rows, "height") / height,
                (column(rows, "z") + column(rows, "height")) / height,
                1 - (column(rows, "x") + column(rows, "length")) / length,
                1 - (column(rows, "y") + column(rows, "width")) / width,
                torch.sin(2 * yaw),
                torch.cos(2 * yaw),
                column(rows, "probability"),
                column(rows, "perturbed"),
                column(rows, "com_height") / height,
                (column(rows, "support_margin") / _MARGIN_SCALE).clamp(-2, 2),
            ),
            dim=2,
        )
        shown = torch.cat(
            (
                shown,
                rows[..., self._scores],
                torch.log1p(ranks.clamp(min=0)) / _RANK_SCALE,
                (ranks == 0).float(),
            ),
            dim=2,
        )
        return shown * present[..., None]

    def _items(self, items: Tensor, size: Tensor) -> Tensor:
        column = self._item
        length, width, height = (size[:, None, i].clamp(min=1e-3) for i in range(3))
        return torch.stack(
            (
                column(items, "present"),
                column(items, "length") / length,
                column(items, "width") / width,
                column(items, "height") / height,
                column(items, "volume") / (length * width * height),
                torch.log1p(column(items, "mass").clamp(min=0)),
                column(items, "share_filled"),
                column(items, "deferred"),
                column(items, "max_tilt") / math.pi,
                torch.log1p(column(items, "bears").clamp(min=0)) / _BEARS_SCALE,
                column(items, "refused"),
            ),
            dim=2,
        )

    def _states(self, state: Tensor, size: Tensor) -> Tensor:
        column = self._state
        length, width, height = (size[:, i].clamp(min=1e-3) for i in range(3))
        return torch.stack(
            (
                torch.log(length / 0.3),
                torch.log(width / length),
                torch.log(height / length),
                column(state, "utilization"),
                column(state, "packed_share"),
                column(state, "left_share"),
                (column(state, "stage") == 1).float(),
                (column(state, "stage") == 2).float(),
            ),
            dim=1,
        )


_SIDES = ("length", "width", "height")
_CANDIDATE_COLUMNS = (
    *("present", "x", "y", "z", *_SIDES, "yaw", "pose"),
    *("probability", "perturbed", "com_height", "support_margin"),
)
_ITEM_COLUMNS = (
    *("present", *_SIDES, "volume", "mass", "share_filled", "deferred"),
    *("max_tilt", "bears", "refused"),
)
_STATE_COLUMNS = (*_SIDES, "utilization", "packed_share", "left_share", "stage")


class _Columns:
    """Finds the columns of a table by their names."""

    def __init__(self, table: str, names: tuple[str, ...], needed: tuple[str, ...]) -> None:
        if missing := [name for name in needed if name not in names]:
            raise InputError(f"observation layout: {table} lacks the columns {', '.join(missing)}")
        self._index = {name: i for i, name in enumerate(names)}

    def __call__(self, table: Tensor, name: str) -> Tensor:
        return table[..., self._index[name]]


class _MapEncoder(nn.Module):
    """A heightmap of any size to a vector."""

    def __init__(self, layers: int, config: NetworkConfig) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(layers, config.channels, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(_MAP_SIZE),
            nn.Conv2d(config.channels, 2 * config.channels, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(2 * config.channels * math.ceil(_MAP_SIZE / 2) ** 2, config.embedding),
            nn.ReLU(),
        )

    def forward(self, maps: Tensor) -> Tensor:
        encoded: Tensor = self.layers(maps)
        return encoded


def surface_patches(seen: _Seen, samples: int) -> Tensor:
    """The container heightmap under each candidate and just beside it, relative to the candidate's corner.

    The patch covers the candidate's bounding box and one and a half pixels around it. What lies outside
    the heightmap is as high as the container.

    Args:
        seen: the batch.
        samples: per side.

    Returns:
        (b, k, samples²): heights above the candidate's lowest z, in container heights, within ±1.
    """
    steps = (torch.arange(samples, device=seen.box.device) + 0.5) / samples
    margin = 1.5 * seen.pixel
    corner, extents = seen.box[..., :2] - margin, seen.box[..., 3:] + 2 * margin
    along = (
        corner[..., None, :] + steps[:, None] * extents[..., None, :]
    )  # (b, k, s, 2): x and y of the samples
    shape = torch.tensor(seen.container.shape[1:], device=seen.box.device)
    pixel = torch.floor(along / seen.pixel).long()
    inside = (pixel >= 0) & (pixel < shape)
    pixel = torch.minimum(pixel.clamp(min=0), shape - 1)
    flat = pixel[..., 0][..., :, None] * shape[1] + pixel[..., 1][..., None, :]
    batch = flat.shape[0]
    heights = seen.container.flatten(1).gather(1, flat.reshape(batch, -1)).reshape(flat.shape)
    heights = torch.where(inside[..., 0][..., :, None] & inside[..., 1][..., None, :], heights, 1.0)
    z = seen.box[..., 2] / seen.height[:, None]
    return ((heights - z[..., None, None]).clamp(-1, 1) * seen.present[..., None, None]).flatten(2)


def _scaled_maps(maps: Tensor, height: Tensor) -> Tensor:
    scale = torch.stack((1 / height, 1 / height, torch.ones_like(height)), dim=1)
    return maps * scale[:, None, :, None, None]


def _mean(rows: Tensor, weight: Tensor) -> Tensor:
    """Mean over the second axis of the rows with weight 1; zeros where there is none."""
    return (rows * weight[..., None]).sum(1) / weight.sum(1, keepdim=True).clamp(min=1)


def _mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs), nn.ReLU())
