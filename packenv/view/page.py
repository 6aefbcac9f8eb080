"""The viewer page: one HTML file that shows a plan in any browser, without a network.

The file holds its script (three.js and RobotPack's own, see ``viewer_page/``), its style and the scene.
A content security policy inside it names the script and the style by hash and allows nothing else, so the
browser itself refuses every load and every script that is not RobotPack's.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from packenv.io.files import write_whole
from packenv.types import FloatArray, IntArray, Item
from packenv.version import __version__
from packenv.view.colours import hex_colour, item_colour
from packenv.view.scene import Scene, SceneStep
from packenv.view.words import NOTES, WEIGHTS, leftover_lines, robustness_figures

# Coordinates and heights are stored as whole multiples of 10 µm: 5 µm of error at most, and few bits.
LENGTH_UNIT = 1e-5
_PAGE_FOLDER = Path(__file__).with_name("viewer_page")


def write_page(path: Path, scene: Scene) -> None:
    """Write the viewer page of a scene.

    Args:
        path: the HTML file to write; an older one is replaced only when the new one is complete.
        scene: what to show.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(Path(path), page_text(scene).encode("utf-8"))


def page_text(scene: Scene) -> str:
    """The viewer page of a scene as text; equal scenes give equal pages."""
    parts = {
        name: (_PAGE_FOLDER / name).read_text(encoding="utf-8") for name in ("style.css", "viewer.bundle.js")
    }
    style, bundle = parts["style.css"], parts["viewer.bundle.js"]
    record, arrays = _encode(scene)
    policy = (
        f"default-src 'none'; script-src '{_source_hash(bundle)}'; style-src '{_source_hash(style)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    fields = {
        "POLICY": html.escape(policy, quote=True).replace("&#x27;", "'"),
        "VERSION": html.escape(__version__),
        "TITLE": html.escape(scene.title),
        "STYLE": style,
        "DATA": _script_safe(json.dumps(record, allow_nan=False, separators=(",", ":"))),
        "ARRAYS": base64.b64encode(arrays).decode("ascii"),
        "BUNDLE": bundle,
    }
    template = (_PAGE_FOLDER / "template.html").read_text(encoding="utf-8")
    # One pass over the template alone: a name that looks like a field stays what it is.
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda match: fields[match.group(1)], template)


def pack_integers(values: IntArray) -> bytes:
    """Code whole numbers so that deflate makes little of them: differences, zigzag, byte planes.

    Args:
        values: (n,) whole numbers whose differences fit 32 bits with sign.

    Returns:
        4 n bytes: all lowest bytes first, then all second ones, and so on.
    """
    steps: IntArray = values.astype(np.int64)  # a copy
    steps[1:] -= values[:-1]
    zigzag = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u4")
    planes: NDArray[np.uint8] = zigzag.view(np.uint8).reshape(-1, 4).T
    return planes.tobytes()


class _Arrays:
    """Collects integer arrays into one block and says where each lies."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: IntArray) -> dict[str, int]:
        packed = pack_integers(values)
        place = {"offset": self._size, "count": int(values.size)}
        self._parts.append(packed)
        self._size += len(packed)
        return place

    def deflated(self) -> bytes:
        return zlib.compress(b"".join(self._parts), 9)


def _encode(scene: Scene) -> tuple[dict[str, object], bytes]:
    """The scene as a JSON-able record and the deflated block of arrays that it points into."""
    arrays = _Arrays()
    meshes: list[dict[str, object]] = []
    known: dict[str, int] = {}
    steps: list[dict[str, object]] = []
    for index, step in enumerate(scene.steps):
        if step.item.sha256 not in known:
            known[step.item.sha256] = len(meshes)
            meshes.append(_encode_mesh(step.item, arrays))
        steps.append(_encode_step(step, index, known[step.item.sha256]))
    record: dict[str, object] = {
        "title": scene.title,
        "container": {"size": [float(s) for s in scene.container.size], "label": scene.container.label},
        "meshes": meshes,
        "steps": steps,
        "heightmap": _encode_heightmaps(scene, arrays),
        "leftovers": [asdict(line) for line in leftover_lines(scene.leftovers)],
        "leftover_count": len(scene.leftovers),
        "summary": _summary(scene),
        "notes": NOTES,
        "executed": bool(scene.verdict),
        "metrics": _plain(scene.metrics),
        "settings": _plain(scene.settings),
    }
    return record, arrays.deflated()


def _encode_mesh(item: Item, arrays: _Arrays) -> dict[str, object]:
    grid = np.rint(item.vertices / LENGTH_UNIT).astype(np.int64)
    return {
        "unit": LENGTH_UNIT,
        "vertices": [arrays.add(np.ascontiguousarray(grid[:, axis])) for axis in range(3)],
        "faces": arrays.add(item.faces.reshape(-1)),
    }


def _encode_step(step: SceneStep, index: int, mesh: int) -> dict[str, object]:
    placement = step.placement
    return {
        "item": placement.item,
        "instance": placement.instance,
        "name": step.name,
        "limits": step.limits,
        "mesh": mesh,
        "colour": hex_colour(item_colour(index)),
        "matrix": _matrix(placement.rotation, placement.position),
        "measured": None if step.measured is None else _matrix(*step.measured),
        "corner": [float(v) for v in placement.corner],
        "figures": _plain(step.figures),
    }


def _matrix(rotation: FloatArray, position: FloatArray) -> list[float]:
    """The first three rows of a pose's 4 x 4 matrix, row by row."""
    return [float(v) for v in np.column_stack([rotation, position]).reshape(-1)]


def _encode_heightmaps(scene: Scene, arrays: _Arrays) -> dict[str, object] | None:
    if not scene.heightmaps:
        return None
    grids = np.stack([np.rint(m.astype(np.float64) / LENGTH_UNIT).astype(np.int64) for m in scene.heightmaps])
    # A placement changes few cells, so what changed since the step before is mostly zeros.
    changes = np.diff(grids, axis=0, prepend=np.zeros_like(grids[:1]))
    _, nx, ny = grids.shape
    return {
        "nx": nx,
        "ny": ny,
        "cell_size": float(scene.cell_size),
        "unit": LENGTH_UNIT,
        "heights": arrays.add(changes.reshape(-1)),
    }


def _summary(scene: Scene) -> list[tuple[str, str]]:
    """The figures of the page's head, label and text."""
    placed, wanted = len(scene.steps), len(scene.steps) + len(scene.leftovers)
    return [
        ("Packed", f"{placed} of {wanted}"),
        ("Utilization", f"{100 * scene.utilization:.1f} %"),
        ("Height", f"{scene.height:.3f} m"),
        ("Container", scene.container.full_label),
        ("Heuristic", scene.heuristic),
        *_robustness(scene.metrics),
        *scene.verdict,
    ]


def _robustness(metrics: Mapping[str, object]) -> list[tuple[str, str]]:
    """What every intermediate pile takes; nothing where a file holds something else than RobotPack writes."""
    try:
        tilt, push, off = robustness_figures(metrics, "min_").values()
        return [("Every step takes", f"{tilt} tilt, {push.removesuffix(WEIGHTS)} push, {off} off")]
    except (KeyError, TypeError, ValueError):
        return []


def _plain(value: object) -> object:
    """A value as JSON can hold it: numpy's scalars and arrays as lists, what is not finite as a word."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _script_safe(text: str) -> str:
    """JSON that can stand inside a script element: nothing in it can end the element."""
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _source_hash(text: str) -> str:
    """A content security policy's name for an inline script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
