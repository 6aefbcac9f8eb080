"""Guided local search as an agent: the paper's fourth method, played one item at a time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, cast

import numpy as np

from packenv.env.config import PackConfig
from packenv.env.observation import FEATURES
from packenv.errors import InputError
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.anytime import Budget
from packenv.planning.assembly import assemble
from packenv.planning.layouts.guided_local_search import GuidedLocalSearch
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.planner import by_box_volume
from packenv.types import Container, IntArray, Placement

from .heuristics import HM
from .protocol import Observation

PLANS = 100
"""Rounds of moves of all pieces."""
_X, _Y, _Z, _YAW, _POSE, _PERTURBED = (
    FEATURES.index(name) for name in ("x", "y", "z", "yaw", "pose", "perturbed")
)


class GLS:
    """Packs the whole order by guided local search when it first sees it, free of overlap alone, and plays that.

    Each item goes to the offered candidate, of those valid at the orientation that the layout gives it, that is
    nearest to its place there; where there is none, or the layout has no place for it, to where HM puts it. What the
    agent needs besides observations is ``order`` and ``instance`` of ``info``, and the catalogue.
    """

    def __init__(self, config: Mapping[str, Any] | None = None, plans: int = PLANS) -> None:
        """Open the catalogue.

        Args:
            config: of the environment, as a mapping; the default one where None.
            plans: rounds of moves of all pieces; the same number gives the same layout.

        Raises:
            InputError: the configuration is wrong or hides the order, or ``plans`` is below 1.
        """
        if plans < 1:
            raise InputError(f"gls: plans is {plans}, give at least 1")
        chosen = PackConfig.from_mapping(config or {})
        if chosen.arrivals == "online":
            raise InputError("gls: arrivals is 'online', and a layout needs the whole order: give 'offline'")
        catalogue = open_catalogue(chosen.catalogue, unit=chosen.unit)
        self._shelf = ItemShelf(catalogue, chosen.grid, "parts" if chosen.physics else "mesh")
        self._options = chosen.plan_options().changed({"constraints": "overlap", "own_constraints": ()})
        self._plans = plans
        self._layout = lru_cache(maxsize=16)(self._planned)
        self._hm = HM()

    def reset(self, seed: int | None = None) -> None:
        """Nothing is drawn: the layout depends on order and container alone."""

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """One action for one observation."""
        order, instance = cast("tuple[str, ...]", info["order"]), cast(int, info["instance"])
        size = tuple(round(float(side), 6) for side in obs["state"][:3])
        place = self.layout(size, tuple(order)).get((str(info["item"]), instance))
        chosen = None if place is None else nearest(obs, place)
        return self._hm.act(obs, info) if chosen is None else chosen

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """(n,) actions for n observations."""
        rows = [
            self.act(
                {name: values[k] for name, values in obs.items()},
                {name: cast("list[object]", infos[name])[k] for name in ("order", "item", "instance")},
            )
            for k in range(len(obs["action_mask"]))
        ]
        return np.array(rows, dtype=np.int64)

    def layout(self, size: tuple[float, ...], order: tuple[str, ...]) -> Mapping[tuple[str, int], Placement]:
        """Where each piece, by name and number among its equals, has its place.

        Args:
            size: of the container, m.
            order: names of all pieces.
        """
        return self._layout(size, order)

    def _planned(
        self, size: tuple[float, ...], order: tuple[str, ...]
    ) -> Mapping[tuple[str, int], Placement]:
        self._shelf.load(set(order))
        prepared = {name: self._shelf.prepared[name] for name in order}
        box = Container(size[0], size[1], size[2])
        with assemble(self._options, self._shelf, box) as planner:
            search = LayoutPacker(
                planner,
                planner,
                self._shelf.shapes,
                GuidedLocalSearch(),
                "gls",
                budget=Budget(plans=self._plans),
            )
            packing = search.pack(by_box_volume(order, prepared), prepared, box)
        return {(p.item, p.instance): p for p in packing.placements}


def nearest(obs: Observation, place: Placement) -> int | None:
    """The valid candidate at a placement's orientation that is nearest to it; None where there is none.

    Args:
        obs: with the candidates.
        place: of the current item in the layout.
    """
    rows, valid = obs["candidates"], obs["action_mask"][:-1] != 0
    # Yaws are float32 there.
    same = (rows[:, _POSE] == place.pose_index) & (np.abs(rows[:, _YAW] - place.yaw) < 1e-4)
    fitting = np.flatnonzero(valid & same & (rows[:, _PERTURBED] == 0))
    if not len(fitting):
        return None
    away = np.linalg.norm(rows[fitting][:, (_X, _Y, _Z)] - place.corner, axis=1)
    return int(fitting[away.argmin()])
