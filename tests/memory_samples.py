"""Three small solids in memory, a box that takes them, and options that are quick to plan with."""

from __future__ import annotations

from typing import Any

import trimesh

from packenv.config import GridConfig
from packenv.types import Container, Order

BOX = Container(0.2, 0.2, 0.12)
ORDER = Order.of("brick", "book", "can")
COARSE = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
QUICK: dict[str, Any] = {"grid": COARSE}


def meshes(scale: float = 1.0) -> dict[str, trimesh.Trimesh]:
    """By item name; in metres, or times ``scale``."""
    solids = {
        "brick": trimesh.creation.box((0.08, 0.06, 0.04)),
        "book": trimesh.creation.box((0.10, 0.08, 0.05)),
        "can": trimesh.creation.cylinder(0.02, 0.06, sections=24),
    }
    for solid in solids.values():
        solid.apply_scale(scale)
    return solids
