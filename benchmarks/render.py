"""How long a picture takes: ``python -m benchmarks.render --json``.

Ten built-in items are packed by HM into the 0.32x0.32x0.30 container under non-overlap alone. ``frame_s`` is the
environment's frame of 480 x 480 pixels with the robot at home, ``frame_without_robot_s`` the same without it,
``png_s`` a plan's picture at its usual size with its file, and ``gif_frame_s`` a frame of an animation with its
share of the file. Medians of wall-clock seconds of one thread, after a first time that is not counted; ``load``
is the machine's load average in the last minute (none on Windows).
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import packenv as rp
from packenv.items.plan_items import cell_of
from packenv.view.animation import planned_frames, write_gif
from packenv.view.picture import write_png
from packenv.view.show import scene_of
from packenv.view.stage import Stage

BOX = rp.Container(0.32, 0.32, 0.30)
ORDER = rp.Order.of(
    "pitcher",
    "spray_bottle",
    "power_drill",
    "bowl",
    "rubber_duck",
    "nesting_cup_5",
    "mug",
    "medium_clamp",
    "scissors",
    "banana",
)


def median_seconds(draw: Callable[[], object], count: int) -> float:
    """Of so many drawings, after one that is not counted."""
    times = []
    for _ in range(count + 1):
        start = time.perf_counter()
        draw()
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=15, help="drawings of each kind")
    parser.add_argument("--json", action="store_true", help="JSON only, no summary line")
    arguments = parser.parse_args()

    plan = rp.plan(ORDER, BOX, constraints="overlap")
    scene, stage = scene_of(plan), Stage(cell_of(plan), (480, 480))
    placed = [(plan.items[p.item], p.pose) for p in plan.placements]
    frames = planned_frames(plan)
    with tempfile.TemporaryDirectory() as folder:
        png, gif = Path(folder) / "plan.png", Path(folder) / "plan.gif"
        report = {
            "items": len(placed),
            "faces": sum(len(item.faces) for item, _ in placed),
            "frame_s": median_seconds(lambda: stage.draw(placed, stage.home), arguments.count),
            "frame_without_robot_s": median_seconds(lambda: stage.draw(placed), arguments.count),
            "png_s": median_seconds(lambda: write_png(png, scene), max(1, arguments.count // 3)),
            "gif_frame_s": median_seconds(lambda: write_gif(gif, plan, plan.items, frames), 1) / len(frames),
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        }
    if not arguments.json:
        print(
            f"{report['frame_s'] * 1e3:.0f} ms a frame, {report['png_s']:.2f} s a PNG, "
            f"{report['gif_frame_s'] * 1e3:.0f} ms a frame of a GIF",
            file=sys.stderr,
        )
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
