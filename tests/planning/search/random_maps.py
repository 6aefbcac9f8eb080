"""Random container heightmaps and items, in whole height quanta."""

from __future__ import annotations

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container, OrientedItem

CELL = 0.002


def quantized(values: np.ndarray) -> np.ndarray:
    """Round to whole height quanta, float32."""
    return (np.round(values / HEIGHT_QUANTUM) * HEIGHT_QUANTUM).astype(np.float32)


def random_surface(rng: np.random.Generator, nx: int, ny: int, height: float = 0.12) -> ContainerMap:
    """Plateaus and spikes up to the rim."""
    heights = np.zeros((nx, ny))
    for _ in range(rng.integers(0, 6)):
        x, y = rng.integers(0, nx), rng.integers(0, ny)
        heights[x : x + rng.integers(1, nx), y : y + rng.integers(1, ny)] = rng.uniform(0, height * 0.8)
    heights += rng.random((nx, ny)) * rng.choice([0.0, 0.01])
    box = Container(nx * CELL + 1e-4, ny * CELL + 1e-4, height)
    return ContainerMap(box, CELL, quantized(np.minimum(heights, height)))


def random_oriented(rng: np.random.Generator, w: int, h: int, height: float = 0.05) -> OrientedItem:
    """An item with a ragged footprint, a bumpy top and a hollow bottom."""
    footprint = rng.random((w, h)) < rng.choice([0.6, 1.0])
    footprint[rng.integers(0, w), rng.integers(0, h)] = True
    bottom = rng.random((w, h)) * height / 2 * rng.choice([0.0, 1.0])
    top = bottom + rng.random((w, h)) * height / 2
    bottom = quantized(bottom - bottom[footprint].min())
    top = np.maximum(quantized(top), bottom)
    tallest = float(top[footprint].max())
    return OrientedItem(
        item="thing",
        pose_index=0,
        yaw=0.0,
        rotation=np.eye(3),
        offset=np.zeros(3),
        extents=np.array([w * CELL, h * CELL, tallest]),
        com=np.array([w * CELL / 2, h * CELL / 2, tallest * rng.uniform(0.2, 0.8)]),
        top=np.where(footprint, top, np.float32(0)).astype(np.float32),
        bottom=np.where(footprint, bottom, np.float32(np.inf)).astype(np.float32),
        cell_size=CELL,
    )
