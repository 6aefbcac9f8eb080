"""What was packed, in the words that the page and the terminal share."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from packenv.planning.options import AUTO, SINGLE_RULES, STANDS_FOR_AUTO, Method
from packenv.planning.robustness import LARGEST_PUSH, LARGEST_TILT
from packenv.planning.search.offsets import LARGEST_OFFSET
from packenv.types import Item, Leftover, Placement, Plan


@dataclass(frozen=True)
class LeftoverLine:
    """Pieces of one item that were left over for one reason.

    Attributes:
        name: of the item, and how many where there are several.
        reason: a word for programs.
        detail: one sentence for people.
    """

    name: str
    reason: str
    detail: str


def leftover_lines(leftovers: Sequence[Leftover]) -> tuple[LeftoverLine, ...]:
    """What was left over, equal pieces in one line."""
    same = Counter((left.item, left.reason, left.detail) for left in leftovers)
    return tuple(
        LeftoverLine(item if n == 1 else f"{item} x {n}", reason, detail)
        for (item, reason, detail), n in same.items()
    )


def piece_names(placements: Sequence[Placement]) -> tuple[str, ...]:
    """The name of each placed piece, with its number where several of its item are placed."""
    counts = Counter(p.item for p in placements)
    return tuple(p.item if counts[p.item] == 1 else f"{p.item} ({p.instance})" for p in placements)


def rule_words(plan: Plan) -> str:
    """The heuristic that made a plan, beside the one that was asked for; or ``agent``, or the method of layouts."""
    if plan.made_by in ("agent", *get_args(Method)):
        return plan.made_by
    asked = str(plan.settings.get("heuristic", "?"))
    made = next((word for word in plan.made_by.split() if word in SINGLE_RULES), None)
    made = made or (STANDS_FOR_AUTO if asked == AUTO else asked)
    if made == asked:
        return asked
    return f"{made} (auto)" if asked == AUTO else f"{made} (in place of {asked})"


def loads_at_end(placements: Sequence[Placement]) -> dict[int, float]:
    """What rests on limited items in the end, at most, by step from 1, kg; empty where a plan does not tell."""
    details = placements[-1].details if placements else {}
    told = next((d["loads"] for d in details.values() if isinstance(d, Mapping) and "loads" in d), ())
    try:
        return {int(load["step"]): float(load["kg"]) for load in told}
    except (KeyError, TypeError, ValueError):
        return {}  # a file may hold anything


def limit_words(item: Item, load: float | None) -> tuple[str, ...]:
    """The limits of a placed item, and how far its load is used up.

    Args:
        item: the item.
        load: what rests on it, kg; None where that is not known.
    """
    words, bears = item.limits.words, item.limits.bears
    if load is None or math.isinf(bears) or bears == load == 0.0:
        return words
    return (*words, f"{load:.2g} of {bears:g} kg on it" if load else "nothing on it")


WEIGHTS = " of its weight"
"""What a push is a share of."""

NOTES = {
    "Tilt margin": "Tilt of gravity under which this item stays where it is while all other items are held.",
    "Pile takes tilt": "All items placed so far stay in balance on a table that is tilted by this, whichever way.",
    "Pile takes push": "All items placed so far stay in balance while this one is pushed sideways by this share of "
    "its weight, whichever way.",
    "Item may be off": "Lowered this far beside its place, whichever way, the item meets nothing before its release.",
    "Every step takes": "The least tilt and the least push that the pile of any step takes, and the least by which an "
    "item may be off on its way down.",
}
"""What labels of figures mean, for those who ask the page."""


def robustness_figures(figures: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """What a pile withstands, label to text.

    Args:
        figures: ``tilt_deg``, ``push`` and ``offset_m``, each behind the prefix.
        prefix: of their names.

    Raises:
        KeyError: a figure is missing.
        ValueError: a figure is no number.
    """
    tilt, push, off = (float(figures[prefix + name]) for name in ("tilt_deg", "push", "offset_m"))
    return {
        "Pile takes tilt": f"{tilt:.1f}°{_or_more(tilt, LARGEST_TILT)}",
        "Pile takes push": f"{100 * push:.0f} %{_or_more(push, LARGEST_PUSH)}{WEIGHTS}",
        "Item may be off": f"{off * 1e3:.0f} mm{_or_more(off, LARGEST_OFFSET)}",
    }


def robustness_words(figures: Mapping[str, Any], prefix: str = "") -> str:
    """The same in a line."""
    tilt, push, off = robustness_figures(figures, prefix).values()
    return f"takes a tilt of {tilt}, a push of {push}, and an item that is {off} off"


def _or_more(value: float, most: float) -> str:
    return " or more" if value >= most else ""
