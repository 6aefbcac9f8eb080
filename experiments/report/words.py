"""Numbers and names as the report's tables, sentences and plots write them."""

from __future__ import annotations

import math

from ..results import Interval

DASH = "–"
"""Stands where there is nothing to report."""

MINUS = "\N{MINUS SIGN}"

_METHODS = {"hm": "HM", "dblf": "DBLF", "mta": "MTA", "minz": "MinZ", "gls": "GLS"}
_CONSTRAINTS = {
    "overlap": "non-overlap",
    "stability": "non-overlap and stability",
    "robot": "all constraints",
}


def printable(text: str) -> str:
    """Some text without what a terminal or a browser would obey."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def plain(text: object) -> str:
    """The same in one line, with single spaces."""
    return printable(" ".join(str(text).split()))


def method_name(method: str) -> str:
    """A method as the literature writes it."""
    return _METHODS.get(method, plain(method))


def constraints_name(constraints: str) -> str:
    """What a plan had to satisfy, in the paper's words."""
    return _CONSTRAINTS.get(constraints, plain(constraints))


def percent(share: float | None, n: int = 1, *, sign: bool = False) -> str:
    """A share of 0 to 1 in percent, so fine that one order of ``n`` is seen."""
    if share is None or not math.isfinite(share):
        return DASH
    digits = 1 if n <= 1000 else 2
    text = f"{100.0 * share:.{digits}f}"
    if float(text) == 0.0:
        return text.removeprefix("-")
    return f"{'+' * (sign and share > 0.0)}{text}".replace("-", MINUS)


def interval(ends: Interval, n: int = 1, *, sign: bool = False) -> str:
    """An interval of shares in percent."""
    low, high = (percent(end, n, sign=sign) for end in ends)
    return DASH if low == high == DASH else f"{low} to {high}"


def number(value: float | int | str | None) -> str:
    """A figure with three digits, to a ten-thousandth, or all before the point; a whole number or a text as it is."""
    if value is None:
        return DASH
    if isinstance(value, bool) or not isinstance(value, float | int):
        return plain(value) or DASH
    if isinstance(value, int):
        return f"{value:,}".replace("-", MINUS)
    if not math.isfinite(value):
        return DASH
    before = math.floor(math.log10(abs(value))) if value else 0
    text = f"{value:,.{min(max(0, 2 - before), 4)}f}"
    return "0" if not text.strip("-0.") else text.replace("-", MINUS)


def chance(p: float) -> str:
    """A p-value, which below a thousandth is no number that anyone should read."""
    if not math.isfinite(p):
        return DASH
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def count(n: int, thing: str) -> str:
    """So many things: ``1 order``, ``1,000 orders``."""
    return f"{n:,} {thing}{'s' * (n != 1)}"
