"""The reachability map behind the cell's layout: ``python -m benchmarks.reachability --png FILE --json``.

Three views of the same maps: which cup positions are reached, by distance and height; what share of the
paper's container is served wherever it stands around the robot; what share of every container is served
against the distance of its near wall. docs/cell.md explains them.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from packenv.io.containers import read_boxes
from packenv.io.files import write_whole
from packenv.robot.files import default_cell
from packenv.robot.reachability import ReachMap, corner_distances, reach_map, share
from packenv.types import Container

ROBOT = default_cell().robot
COLUMN = ROBOT.shapes.column_radius
RADII = np.round(np.arange(0.10, 1.0501, 0.005), 4)
EDGES = np.round(np.arange(0.16, 0.701, 0.01), 3)
"""Distances of the near wall from joint 1's axis that are compared, m."""

_SCALE = 2  # drawn larger, then scaled down: smooth lines
_SIZE = (1320, 1000)
_INK, _GREY, _LIGHT = (34, 40, 49), (120, 128, 140), (226, 229, 234)
_YES, _NO = (74, 160, 110), (238, 205, 198)
_LINES = ((31, 119, 180), (214, 120, 20), (44, 150, 60), (190, 50, 60), (130, 90, 170), (20, 20, 20))


@dataclass(frozen=True)
class Frame:
    """A rectangle of the picture with its own axes.

    Attributes:
        box: (left, top, right, bottom), px before scaling.
        x: (from, to) in the axis's unit.
        y: (from, to), upwards.
    """

    box: tuple[int, int, int, int]
    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Pixel of a point, scaled."""
        left, top, right, bottom = self.box
        u = (x - self.x[0]) / (self.x[1] - self.x[0])
        v = (y - self.y[0]) / (self.y[1] - self.y[0])
        return ((left + u * (right - left)) * _SCALE, (bottom - v * (bottom - top)) * _SCALE)

    def rectangle(self, x0: float, y0: float, x1: float, y1: float) -> list[float]:
        """Pixels of a rectangle given by its lower left and upper right corner."""
        (left, bottom), (right, top) = self.at(x0, y0), self.at(x1, y1)
        return [left, top, right, bottom]


class Canvas:
    """A picture under work."""

    def __init__(self) -> None:
        self.image = Image.new("RGB", (_SIZE[0] * _SCALE, _SIZE[1] * _SCALE), "white")
        self.draw = ImageDraw.Draw(self.image)

    def text(
        self,
        place: tuple[float, float],
        words: str,
        size: int = 14,
        anchor: str = "la",
        colour: tuple[int, int, int] = _INK,
    ) -> None:
        """Write at a scaled pixel."""
        self.draw.text(
            place, words, fill=colour, font=ImageFont.load_default(size=size * _SCALE), anchor=anchor
        )

    def axes(
        self, frame: Frame, xs: Sequence[float], ys: Sequence[float], labels: tuple[str, str, str]
    ) -> None:
        """Border, ticks, title and the names of both axes; y ticks are written as given by ``labels``."""
        title, x_name, y_name = labels
        left, top, right, bottom = (v * _SCALE for v in frame.box)
        self.draw.rectangle([left, top, right, bottom], outline=_GREY, width=_SCALE)
        for x in xs:
            place = frame.at(x, frame.y[0])
            self.draw.line([place, (place[0], place[1] + 5 * _SCALE)], fill=_GREY, width=_SCALE)
            self.text((place[0], place[1] + 8 * _SCALE), f"{x:g}", 13, "ma", _GREY)
        for y in ys:
            place = frame.at(frame.x[0], y)
            self.draw.line([place, (place[0] - 5 * _SCALE, place[1])], fill=_GREY, width=_SCALE)
            self.text((place[0] - 9 * _SCALE, place[1]), f"{y:g}", 13, "rm", _GREY)
        self.text((left, top - 34 * _SCALE), title, 17, "ld")
        self.text((left, top - 10 * _SCALE), y_name, 13, "ld", _GREY)
        self.text((right, bottom + 27 * _SCALE), x_name, 13, "ra", _GREY)


def draw_section(canvas: Canvas, reach: ReachMap, container: Container) -> None:
    """Reached cup positions over distance and height, with the chosen container in section."""
    frame = Frame((70, 90, 1280, 330), (0.0, 1.05), (0.0, reach.rim))
    half = (reach.radii[1] - reach.radii[0]) / 2
    edges = np.concatenate([[0.0], (reach.heights[1:] + reach.heights[:-1]) / 2, [reach.rim]])
    for r, row in zip(reach.radii, reach.reachable, strict=True):
        for j, reached in enumerate(row):
            canvas.draw.rectangle(
                frame.rectangle(r - half, edges[j], min(r + half, frame.x[1]), edges[j + 1]),
                fill=_YES if reached else _NO,
            )
    canvas.draw.rectangle(frame.rectangle(0.0, 0.0, COLUMN, reach.rim), fill=_LIGHT)
    canvas.text(frame.at(COLUMN / 2, reach.rim / 2), "robot's column", 14, "mm", _GREY)
    nearest, farthest = corner_distances(container, default_cell().with_container(container).position[:2])
    for r, words, anchor in ((nearest, "near wall ", "rm"), (farthest, " far corners", "lm")):
        canvas.draw.line([frame.at(r, 0.0), frame.at(r, reach.rim)], fill=_INK, width=2 * _SCALE)
        canvas.text(frame.at(r, reach.rim * 0.9), words, 13, anchor)
    canvas.text(frame.at((nearest + farthest) / 2, reach.rim / 2), "container 0.32 x 0.32 x 0.30", 15, "mm")
    canvas.axes(
        frame,
        np.arange(0.0, 1.01, 0.1).tolist(),
        [0.0, 0.1, 0.2, 0.3],
        (
            "Final cup positions that a top-down path reaches (green), rim at 0.30 m",
            "horizontal distance of the cup from joint 1's axis, m",
            "height of the cup, m",
        ),
    )


def draw_around(canvas: Canvas, reach: ReachMap, container: Container) -> dict[str, float]:
    """Share of the container that is served, by the place of its centre around the robot."""
    frame = Frame((70, 450, 560, 940), (-1.0, 1.0), (-1.0, 1.0))
    step = 0.02
    places = np.arange(-1.0 + step / 2, 1.0, step)
    best = 0.0
    for x in places:
        for y in places:
            corner = (x - container.length / 2, y - container.width / 2)
            if corner_distances(container, corner)[0] < COLUMN:
                colour = _LIGHT
            else:
                served = share(reach, container, corner, spacing=0.04)
                best = max(best, served)
                colour = tuple(round(n + (p - n) * served) for n, p in zip(_NO, _YES, strict=True))
            canvas.draw.rectangle(
                frame.rectangle(x - step / 2, y - step / 2, x + step / 2, y + step / 2), fill=colour
            )
    circle = frame.rectangle(-COLUMN, -COLUMN, COLUMN, COLUMN)
    canvas.draw.ellipse(circle, outline=_GREY, width=2 * _SCALE)
    canvas.text(frame.at(0.0, 0.0), "robot", 14, "mm", _GREY)
    x, y, _ = default_cell().with_container(container).position
    canvas.draw.rectangle(
        frame.rectangle(x, y, x + container.length, y + container.width), outline=_INK, width=2 * _SCALE
    )
    centre = frame.at(x + container.length / 2, y + container.width / 2)
    canvas.draw.ellipse([c + d * _SCALE for d in (-5, 5) for c in centre], fill=_INK)
    canvas.text((centre[0], centre[1] + 10 * _SCALE), "chosen", 13, "ma")
    canvas.axes(
        frame,
        [-1, -0.5, 0, 0.5, 1],
        [-1, -0.5, 0, 0.5, 1],
        (
            "Share of the container served, by its centre's place",
            "x of the centre, m",
            "y, m: green 100 %, red 0 %, grey too near",
        ),
    )
    return {"best_share": best}


def draw_shares(canvas: Canvas, shares: dict[str, list[float]]) -> None:
    """Share of every container that is served, against the distance of its near wall."""
    frame = Frame((680, 450, 1280, 940), (float(EDGES[0]), float(EDGES[-1])), (0.0, 1.05))
    for colour, values in zip(_LINES, shares.values(), strict=False):
        points = [frame.at(e, s) for e, s in zip(EDGES, values, strict=True)]
        canvas.draw.line(points, fill=colour, width=2 * _SCALE, joint="curve")
    canvas.draw.rectangle(frame.rectangle(EDGES[0], 0.0, COLUMN, 1.05), fill=_LIGHT)
    canvas.text(frame.at(COLUMN - 0.006, 0.5), "column", 13, "rm", _GREY)
    canvas.draw.line(
        [frame.at(ROBOT.near_edge, 0.0), frame.at(ROBOT.near_edge, 1.05)], fill=_INK, width=2 * _SCALE
    )
    canvas.text(frame.at(ROBOT.near_edge + 0.008, 0.03), f"chosen: {ROBOT.near_edge:.2f} m", 13, "lb")
    for k, (colour, name) in enumerate(zip(_LINES, shares, strict=False)):
        place = frame.at(ROBOT.near_edge + 0.03, 0.16 + 0.055 * k)
        canvas.draw.line([place, (place[0] + 26 * _SCALE, place[1])], fill=colour, width=3 * _SCALE)
        canvas.text((place[0] + 34 * _SCALE, place[1]), name, 13, "lm")
    canvas.axes(
        frame,
        [0.2, 0.3, 0.4, 0.5, 0.6, 0.7],
        [0.0, 0.2, 0.4, 0.6, 0.8, 1.0],
        (
            "Share of each container served, by its distance",
            "near wall from joint 1's axis, m",
            "share of the inner volume",
        ),
    )


def main() -> int:
    """Compute the maps, draw them, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--png", type=Path, help="picture to write")
    parser.add_argument("--json", action="store_true", help="JSON only, no progress lines")
    arguments = parser.parse_args()

    boxes = list(read_boxes())
    paper = Container(0.32, 0.32, 0.30)
    if all(box.size != paper.size for box in boxes):
        boxes.append(paper)
    maps = {height: reach_map(ROBOT, height, RADII, levels=25) for height in {box.height for box in boxes}}
    rows, curves = [], {}
    for box in boxes:
        reach = maps[box.height]
        whole = reach.radii[reach.reachable.all(axis=1)]
        curves[f"{box.label}  {box.length:g} x {box.width:g} x {box.height:g}"] = [
            share(reach, box, (float(e), -box.width / 2)) for e in EDGES
        ]
        corner = default_cell().with_container(box).position[:2]
        nearest, farthest = corner_distances(box, corner)
        rows.append(
            {
                "container": box.label,
                "share": share(reach, box, corner),
                "served_from_m": float(whole.min()),
                "served_to_m": float(whole.max()),
                "nearest_m": nearest,
                "farthest_m": farthest,
            }
        )
        if not arguments.json:
            sys.stderr.write(f"{box.label}: {rows[-1]['share']:.1%} served\n")
    report: dict[str, object] = {"near_edge_m": ROBOT.near_edge, "column_radius_m": COLUMN, "rows": rows}
    if arguments.png:
        canvas = Canvas()
        draw_section(canvas, maps[paper.height], paper)
        report |= draw_around(canvas, maps[paper.height], paper)
        draw_shares(canvas, curves)
        stream = io.BytesIO()
        small = canvas.image.resize(_SIZE, Image.Resampling.LANCZOS)
        small.save(stream, format="PNG", optimize=True)
        write_whole(arguments.png, stream.getvalue())
    sys.stdout.write(json.dumps(report, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
