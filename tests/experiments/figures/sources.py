"""What figures of tests are made of."""

from __future__ import annotations

from pathlib import Path

from packenv.experiments.figures.figure import Source
from packenv.items.catalogue import Catalogue, open_catalogue
from packenv.watcher import Watcher
from tests.shapes import box

BOXES = Catalogue.of_items(
    {item.name: item for item in (box(0.1, 0.08, 0.05, "brick"), box(0.12, 0.1, 0.04, "slab"))}
)
"""A catalogue without a bowl."""

_NAMES = """
bowl cracker_box sugar_box pitcher funnel plate apple chips_can nesting_cup_1 softball soup_can banana tennis_ball
"""


def _some() -> Catalogue:
    whole = open_catalogue("builtin")
    return Catalogue(whole.label, whole.folder, {name: whole.entries[name] for name in _NAMES.split()})


SOME = _some()
"""Some built-in items: preparing all of them takes a minute."""


class Listener(Watcher):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.remarks: list[str] = []

    def remark(self, text: str) -> None:
        self.remarks.append(text)


def source_of(out: Path, catalogue: Catalogue, watcher: Watcher | None = None) -> Source:
    """The source of figures of a catalogue."""
    return Source(catalogue, None, 0, "auto", out, watcher or Listener())
