"""The same planning step in plain NumPy with ray-cast heightmaps, as the paper describes it.

Heightmaps by casting one ray through each cell centre (embree), lowest Z and HM by one pass of NumPy over
the window of each candidate. Nothing is kept between orders, nothing is compiled here.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from packenv.config import GridConfig
from packenv.geometry.prepare import PreparedItem
from packenv.planning.planner import by_box_volume
from packenv.types import Container, FloatArray, Item


def ray_cast_maps(item: Item, rotation: FloatArray, cell: float) -> tuple[FloatArray, FloatArray]:
    """Top and bottom heightmap sampled at cell centres; bottom is +inf where no ray hits."""
    vertices = item.vertices @ rotation.T
    vertices -= vertices.min(axis=0)
    caster = RayMeshIntersector(trimesh.Trimesh(vertices, item.faces, process=False))
    w, h = np.ceil(vertices.max(axis=0)[:2] / cell).astype(int)
    x, y = np.meshgrid((np.arange(w) + 0.5) * cell, (np.arange(h) + 0.5) * cell, indexing="ij")
    roof = vertices[:, 2].max() + 1.0
    maps = []
    for start, direction in ((roof, -1.0), (-1.0, 1.0)):
        origins = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, start)])
        directions = np.tile([0.0, 0.0, direction], (x.size, 1))
        points, rays, _ = caster.intersects_location(origins, directions, multiple_hits=False)
        heights = np.full(x.size, np.nan)
        heights[rays] = points[:, 2]
        maps.append(heights.reshape(w, h))
    top, bottom = maps
    return np.nan_to_num(top, nan=0.0), np.nan_to_num(bottom, nan=np.inf)


@dataclass(frozen=True)
class Outcome:
    """What a reference run did: items placed, CPU-seconds in all, CPU-seconds without the ray casting."""

    placed: int
    cpu_s: float
    search_cpu_s: float


def plan(
    names: Sequence[str],
    meshes: Mapping[str, Item],
    prepared: Mapping[str, PreparedItem],
    container: Container,
    grid: GridConfig,
) -> Outcome:
    """Pack an order with HM. Only the stable poses are taken from ``prepared``."""
    start = time.process_time()
    casting = 0.0
    cell, step = grid.cell_size, grid.step_cells
    shape = tuple(int(s / cell + 1e-6) for s in container.size[:2])
    surface = np.zeros(shape)
    placed = 0
    for name in by_box_volume(names, prepared):
        best = (np.inf, None)
        for oriented in prepared[name].orientations:
            before = time.process_time()
            top, bottom = ray_cast_maps(meshes[name], oriented.rotation, cell)
            casting += time.process_time() - before
            w, h = top.shape
            footprint = np.isfinite(bottom)
            total = surface.sum()
            for x in range(0, shape[0] - w + 1, step):
                for y in range(0, shape[1] - h + 1, step):
                    window = surface[x : x + w, y : y + h]
                    z = max(0.0, float((window - bottom).max()))
                    if z + top.max() > container.height:
                        continue
                    after = np.where(footprint, np.maximum(top + z, window), window)
                    score = (x + y) * cell + total - window.sum() + after.sum()
                    if score < best[0]:
                        best = (score, (x, y, after))
        if best[1] is not None:
            x, y, after = best[1]
            surface[x : x + after.shape[0], y : y + after.shape[1]] = after
            placed += 1
    whole = time.process_time() - start
    return Outcome(placed, whole, whole - casting)
