"""A figure, and what all of them are made with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from packenv import api
from packenv.config import EngineName
from packenv.errors import InputError
from packenv.items.catalogue import Catalogue
from packenv.items.plan_items import shelf_for
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.types import Container, FloatArray, Order, Plan
from packenv.view.painter import Image
from packenv.view.picture import render_image
from packenv.view.show import scene_of
from packenv.watcher import Watcher

from ..orders import fitting
from ..spec import RunSpec


@dataclass(frozen=True)
class Figure:
    """A figure that was written.

    Attributes:
        name: of its files, without their ending.
        title: a line.
        caption: what is to be seen, and how it was made.
        files: the PNG first.
        paper: the figure of the paper that it redoes.
        made_of: seed, options, orders and figures that the caption states, as JSON has them.
    """

    name: str
    title: str
    caption: str
    files: tuple[Path, ...]
    paper: str
    made_of: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The figure as JSON has it, with the names of its files."""
        return {
            "name": self.name,
            "title": self.title,
            "caption": self.caption,
            "paper": self.paper,
            "files": [path.name for path in self.files],
            **self.made_of,
        }


@dataclass(frozen=True)
class Source:
    """What all figures are made of.

    Attributes:
        catalogue: where the items are from.
        unit: that the user gave for its meshes.
        seed: of the draw of orders.
        engine: of executions.
        out: folder of the files.
        watcher: is told of remarks.
    """

    catalogue: Catalogue
    unit: str | None
    seed: int
    engine: EngineName
    out: Path
    watcher: Watcher

    @property
    def box(self) -> Container:
        """The container of large orders."""
        return RunSpec().box

    def shelf(self, options: PlanOptions) -> ItemShelf:
        """The items as some options plan with them."""
        return shelf_for(self.catalogue, options)

    def names(self, options: PlanOptions, container: Container) -> list[str]:
        """The items that fit into a container alone.

        Raises:
            InputError: there are none.
        """
        found = fitting(self.shelf(options).prepared, container, options.grid)
        if not found:
            raise InputError(
                f"figures: no item of {self.catalogue.label} fits a box of {size_words(container)}, give smaller "
                "items, or the unit of their meshes"
            )
        return found

    def plan(
        self,
        order: Sequence[str],
        options: PlanOptions,
        container: Container | str | None = None,
        start: Plan | None = None,
    ) -> Plan:
        """Plan an order; see :func:`packenv.plan`."""
        return api.plan(
            Order.of(*order),
            container or (self.box if start is None else None),
            self.shelf(options),
            options,
            start=start,
            unit=self.unit,
            margins=False,
        )

    def picture(
        self, plan: Plan, size: tuple[int, int], azimuth: float = -58.0, elevation: float = 32.0
    ) -> Image:
        """Draw a plan; see :func:`packenv.view.picture.render_image`."""
        return render_image(scene_of(plan, self.catalogue), size=size, azimuth=azimuth, elevation=elevation)


def size_words(container: Container) -> str:
    """Inner size of a container, as people write it."""
    return " × ".join(f"{100 * side:g}" for side in container.size) + " cm"


def azimuth_from(side: FloatArray) -> float:
    """Of four views, the one from the side to which a horizontal direction (2,) points, degrees."""
    views = (-58.0, 32.0, 122.0, 212.0)
    return max(
        views, key=lambda view: float(side @ [math.cos(math.radians(view)), math.sin(math.radians(view))])
    )
