"""A trained policy on disk: ``policy.safetensors`` (weights) beside ``config.json`` (everything else).

Neither file can hold code, so reading a policy of unknown origin is safe. ``config.json`` holds
``schema_version``, ``network`` (sizes), ``layout`` (names of the observation's columns and the side of a
pixel) and, for people and for going on with the training, ``train``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from packenv.env.observation import FEATURES, ITEM_FEATURES, STATE_FEATURES
from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.json_text import read_json

from .placement_network import NetworkConfig, ObservationLayout, PlacementNetwork

WEIGHTS_FILE = "policy.safetensors"
CONFIG_FILE = "config.json"
SCHEMA_VERSION = 2


def current_layout(pixel: float) -> ObservationLayout:
    """The layout of this version's observations.

    Args:
        pixel: side of a pixel of the observed heightmaps, m.
    """
    return ObservationLayout(FEATURES, ITEM_FEATURES, STATE_FEATURES, pixel)


def write_config(
    folder: Path, network: NetworkConfig, layout: ObservationLayout, train: Mapping[str, Any]
) -> None:
    """Write ``config.json`` whole or not at all.

    Args:
        folder: an existing folder.
        network: sizes of the network.
        layout: of the observations.
        train: how it is trained, JSON-able.

    Raises:
        InputError: the file cannot be written.
    """
    document = {
        "schema_version": SCHEMA_VERSION,
        "network": asdict(network),
        "layout": asdict(layout),
        "train": train,
    }
    write_whole(folder / CONFIG_FILE, json.dumps(document, indent=1).encode() + b"\n")


def write_weights(folder: Path, network: PlacementNetwork) -> None:
    """Write ``policy.safetensors`` whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    weights = {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
    write_whole(folder / WEIGHTS_FILE, save(weights))


def read_config(folder: Path) -> dict[str, Any]:
    """Read ``config.json``.

    Raises:
        InputError: the file is missing or is not such a file.
    """
    path = folder / CONFIG_FILE
    document: Any = read_json(path, "a folder that python -m packenv.train wrote")
    version = document.get("schema_version") if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        raise InputError(f"{path}: schema_version is {version!r}, this version reads {SCHEMA_VERSION}")
    return dict(document)


def read_policy(folder: Path) -> PlacementNetwork:
    """Read a policy.

    Args:
        folder: with both files.

    Returns:
        The network in evaluation mode.

    Raises:
        InputError: a file is missing or broken, the two do not belong together, or the policy was trained on
            observations with other columns than this version's.
    """
    document, path = read_config(folder), folder / CONFIG_FILE
    try:
        stored = document["layout"]
        layout = ObservationLayout(
            candidates=tuple(stored["candidates"]),
            remaining=tuple(stored["remaining"]),
            state=tuple(stored["state"]),
            pixel=float(stored["pixel"]),
        )
        sizes = NetworkConfig(
            **{field.name: int(document["network"][field.name]) for field in fields(NetworkConfig)}
        )
    except (KeyError, TypeError, ValueError) as problem:
        raise InputError(f"{path}: network or layout is damaged ({problem!r})") from None
    if layout != current_layout(layout.pixel):
        raise InputError(f"{path}: was trained on observations with other columns, train it again")
    network = PlacementNetwork(layout, sizes)
    path = folder / WEIGHTS_FILE
    try:
        network.load_state_dict(load(path.read_bytes()))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    except SafetensorError as problem:
        raise InputError(f"{path}: is not a safetensors file ({problem})") from None
    except RuntimeError as problem:
        raise InputError(f"{path}: does not fit {CONFIG_FILE} beside it ({problem})") from None
    if not all(torch.isfinite(value).all() for value in network.state_dict().values()):
        raise InputError(f"{path}: holds weights that are not finite")
    return network.eval()
