"""Pictures of packed boxes, and pages of plans that fail: plans are made again from their rows."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from packenv.items.plan_items import Items
from packenv.types import Plan
from packenv.view.picture import render_image
from packenv.view.show import scene_of, show
from packenv.watcher import Watcher

from ..experiment import Row
from ..results import Result
from .document import PAGES, Shot
from .words import count, method_name, plain

if TYPE_CHECKING:
    from packenv.execution.execute import ExecutedPlan

T = TypeVar("T")

_SIZE = (640, 480)
_SHOTS, _FAILING = 6, 6
_LONGEST_S = 30.0
"""Plans that took longer, CPU-seconds, are not made again for a picture."""


class Pictures(Protocol):
    """Where plans come from that a report shows."""

    @property
    def catalogue(self) -> Items:
        """What their items are from."""

    def plan_of(self, experiment: str, row: Row) -> Plan | ExecutedPlan:
        """The plan of a row, made again."""


@dataclass(frozen=True)
class Shown:
    """What there is to look at of an experiment.

    Attributes:
        shots: of packed boxes.
        pages: address of a page by the key of its row.
        left_out: a sentence for each plan that could not be made again.
    """

    shots: tuple[Shot, ...]
    pages: dict[str, str]
    left_out: tuple[str, ...]


class Showcase:
    """Draws packed boxes and plans that fail; what an earlier experiment has shown is not made twice."""

    def __init__(self, pictures: Pictures, folder: Path, watcher: Watcher) -> None:
        """Show nothing yet.

        Args:
            pictures: where plans come from.
            folder: of the report.
            watcher: is told of progress, and of plans that cannot be shown.
        """
        self._pictures, self._folder, self._watcher = pictures, folder, watcher
        self._drawn: set[str] = set()
        self._pages: dict[str, str] = {}

    def of(self, result: Result, rows: Sequence[Row]) -> Shown:
        """Pictures of packed boxes, and pages of the first plans that fail."""
        left_out: list[str] = []

        def tried(row: Row, draw: Callable[[Plan | ExecutedPlan], T]) -> T | None:
            try:
                return draw(self._pictures.plan_of(result.experiment, row))
            except (
                Exception
            ) as problem:  # own rules raise anything, and a report is worth more than a picture
                left_out.append(f"{_title(row)} is not shown: {plain(problem)}")
                self._watcher.remark(left_out[-1])
                return None

        chosen = _worth_a_picture(rows)
        if not self._drawn.isdisjoint(row["key"] for row in chosen):
            chosen = []
        shots = []
        for row in self._watcher.progress(chosen, f"pictures of {result.experiment}"):
            if (png := tried(row, self._png)) is not None:
                self._drawn.add(row["key"])
                shots.append(Shot(_file_name(result, row), _caption(row), png))
        by_key = {
            row["key"]: row for row in rows if row.get("status", "ok") == "ok" and _seconds(row) <= _LONGEST_S
        }
        failing = list(dict.fromkeys(f.key for f in result.failures if f.key in by_key))[:_FAILING]
        new = [by_key[key] for key in failing if key not in self._pages]
        for row in self._watcher.progress(new, f"pages of {result.experiment}"):
            address = f"{PAGES}/{_file_name(result, row)}.html"
            if tried(row, partial(self._page, address)):
                self._pages[row["key"]] = address
        pages = {key: self._pages[key] for key in failing if key in self._pages}
        return Shown(tuple(shots), pages, tuple(left_out))

    def _page(self, address: str, plan: Plan | ExecutedPlan) -> bool:
        show(plan, self._folder / address, self._pictures.catalogue)
        return True

    def _png(self, plan: Plan | ExecutedPlan) -> bytes:
        """A picture with a palette: a third of the bytes, and no difference that is seen."""
        from PIL import Image

        image = Image.fromarray(render_image(scene_of(plan, self._pictures.catalogue), size=_SIZE))
        buffer = io.BytesIO()
        image.quantize(256, kmeans=1).save(buffer, format="PNG", optimize=True)
        return buffer.getvalue()


def _worth_a_picture(rows: Sequence[Row]) -> list[Row]:
    """Rows of whole plans: of the paper's method where there are such, of many boxes, under most constraints."""
    whole = [row for row in rows if _packed(row) and _seconds(row) <= _LONGEST_S]
    lead = [row for row in whole if row["method"] == "hm"] or whole
    strict = [row for row in lead if row["constraints"] == "robot"] or lead
    same = [
        row for row in strict if (row["setting"], row["items"]) == (strict[0]["setting"], strict[0]["items"])
    ]
    orders = {int(row["index"]): row for row in reversed(same)}
    return list(_boxes_in_turn([row for _, row in sorted(orders.items())]))[:_SHOTS]


def _boxes_in_turn(rows: Sequence[Row]) -> Iterator[Row]:
    """A row of each box, then a second one of each, and so on."""
    by_box: dict[str, list[Row]] = {}
    for row in rows:
        by_box.setdefault(str(row.get("container")), []).append(row)
    for k in range(max(map(len, by_box.values()), default=0)):
        yield from (some[k] for some in by_box.values() if k < len(some))


def _packed(row: Row) -> bool:
    """Whether an order was packed whole, and carried out where that was tried."""
    return bool(row.get("complete") or (row.get("planned") and row.get("nominal", {}).get("success")))


def _seconds(row: Row) -> float:
    """CPU-seconds that the plan of a row takes again; none where it is in a file."""
    return 0.0 if row.get("plan") else float(row.get("plan_cpu_s", row.get("cpu_s", 0.0)))


def _title(row: Row) -> str:
    return f"Order {row['index']} by {method_name(row['method'])}"


def _caption(row: Row) -> str:
    names = [plain(name) for name in row["order"]]
    box = plain(row.get("container") or ", ".join(row["boxes"]))
    box += " m" * bool(re.fullmatch(r"[0-9.x]+", box))  # a size, not a name
    return f"{_title(row)}: {count(len(names), 'item')} in {box}: {', '.join(names)}"


def _file_name(result: Result, row: Row) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "-", f"{result.experiment}-{row['key']}")[:100]
