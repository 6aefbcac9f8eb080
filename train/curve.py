"""The learning curve as an SVG picture: return on the held-out episodes over the steps of training."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

_WIDTH, _HEIGHT = 760, 420
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 110, 42, 52
_COLOURS = {"learned": "#0b62a4", "random": "#777777", "hm": "#c05020"}
_OTHER = "#557755"


def curve_svg(rows: Sequence[Mapping[str, Any]], baselines: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw the curve.

    Args:
        rows: at least one, by rising ``timesteps``, each with ``return``, ``return_ci95`` and ``episodes``.
        baselines: the same of other agents on the same episodes, by name; drawn as level lines.

    Returns:
        The picture.
    """
    everyone = [*rows, *baselines.values()]
    lowest = min(row["return"] - row["return_ci95"] for row in everyone)
    highest = max(row["return"] + row["return_ci95"] for row in everyone)
    room = 0.08 * (highest - lowest) or 0.5
    view = _View(max(1, rows[-1]["timesteps"]), lowest - room, highest + room)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-family="sans-serif" '
        'font-size="13">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#ffffff"/>',
        _text(_LEFT, 24, f"Mean return on {rows[-1]['episodes']} held-out episodes, 95 % interval", size=15),
        *_axes(view),
    ]
    for name, row in baselines.items():
        parts += _level(view, name, row)
    edge = [(row["timesteps"], row["return"] + row["return_ci95"]) for row in rows]
    edge += [(row["timesteps"], row["return"] - row["return_ci95"]) for row in reversed(rows)]
    line = [(row["timesteps"], row["return"]) for row in rows]
    colour = _COLOURS["learned"]
    parts.append(f'<polygon points="{view.points(edge)}" fill="{colour}" fill-opacity="0.15"/>')
    parts.append(f'<polyline points="{view.points(line)}" fill="none" stroke="{colour}" stroke-width="2"/>')
    parts += [f'<circle cx="{view.x(t):.1f}" cy="{view.y(r):.1f}" r="2.6" fill="{colour}"/>' for t, r in line]
    parts.append(_text(view.x(line[-1][0]) + 8, view.y(line[-1][1]) + 4, "learned", colour=colour))
    return "\n".join([*parts, "</svg>", ""])


class _View:
    """From steps and returns to the picture's coordinates."""

    def __init__(self, steps: float, lowest: float, highest: float) -> None:
        self.steps, self.lowest, self.highest = steps, lowest, highest

    def x(self, steps: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * steps / self.steps

    def y(self, value: float) -> float:
        return (
            _HEIGHT
            - _BOTTOM
            - (_HEIGHT - _TOP - _BOTTOM) * (value - self.lowest) / (self.highest - self.lowest)
        )

    def points(self, pairs: Sequence[tuple[float, float]]) -> str:
        return " ".join(f"{self.x(steps):.1f},{self.y(value):.1f}" for steps, value in pairs)


def _axes(view: _View) -> Iterator[str]:
    floor, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    for value in _ticks(view.lowest, view.highest):
        y = view.y(value)
        yield f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}" stroke="#e4e4e4"/>'
        yield _text(_LEFT - 8, y + 4, f"{value:g}", anchor="end")
    for steps in _ticks(0, view.steps):
        yield _text(view.x(steps), floor + 20, f"{steps:,.0f}", anchor="middle")
    yield f'<path d="M{_LEFT} {_TOP}V{floor}H{right}" fill="none" stroke="#333333"/>'
    yield _text((_LEFT + right) / 2, _HEIGHT - 12, "steps of training", anchor="middle")


def _level(view: _View, name: str, row: Mapping[str, Any]) -> Iterator[str]:
    colour, right = _COLOURS.get(name, _OTHER), _WIDTH - _RIGHT
    y, half = view.y(row["return"]), view.y(row["return"]) - view.y(row["return"] + row["return_ci95"])
    yield (
        f'<rect x="{_LEFT}" y="{y - half:.1f}" width="{right - _LEFT}" height="{2 * half:.1f}" '
        f'fill="{colour}" fill-opacity="0.12"/>'
    )
    yield (
        f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}" stroke="{colour}" stroke-width="1.6" '
        'stroke-dasharray="6 4"/>'
    )
    yield _text(right - 8, y - 5, name, anchor="end", colour=colour)


def _ticks(lowest: float, highest: float) -> Iterator[float]:
    """Round numbers between the two, four to nine of them."""
    rough = (highest - lowest) / 6
    unit = 10.0 ** math.floor(math.log10(rough))
    step = unit * min((1, 2, 5, 10), key=lambda k: abs(k * unit - rough))
    for k in range(math.ceil(lowest / step), math.floor(highest / step) + 1):
        yield round(k * step, 10)


def _text(
    x: float, y: float, text: str, *, anchor: str = "start", colour: str = "#222222", size: int = 13
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" font-size="{size}">'
        f"{escape(text)}</text>"
    )
