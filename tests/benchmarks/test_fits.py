"""The answers of the known-answer benchmark are true, and its command counts what is right."""

from __future__ import annotations

import json
import math
import sys
from itertools import islice

import numpy as np
import pytest

from benchmarks import fits
from benchmarks.known_fits import KINDS, SHELLS, Instance
from benchmarks.shells import bowl, cup, plate, rectangle
from packenv.config import CLEARANCE
from packenv.types import Container, FloatArray, Item, Placement, Plan
from packenv.verification.exact_meshes import AuditReport, audit_plan


def instances(kind: str, count: int) -> list[Instance]:
    return list(islice(KINDS[kind](np.random.default_rng(3)), count))


def audit(container: Container, items: dict[str, Item], corners: list[tuple[str, FloatArray]]) -> AuditReport:
    """The audit of upright items with the smallest corners of their boxes here."""
    placements = [
        Placement(
            name,
            step,
            np.eye(3),
            corner - items[name].vertices.min(axis=0),
            corner,
            items[name].extents,
            0,
            0.0,
            0.0,
            1,
        )
        for step, (name, corner) in enumerate(corners, 1)
    ]
    return audit_plan(Plan(container, tuple(placements), ()), items)


def lattice(instance: Instance, layers: int, pitch: float) -> list[tuple[str, FloatArray]]:
    """Equal items side by side, as many as fit, and so many layers of them."""
    ((name, item),) = instance.items.items()
    counts = np.floor(np.array(instance.container.size[:2]) / item.extents[:2] + 1e-6).astype(int)
    return [
        (name, np.array([i * item.extents[0], j * item.extents[1], k * pitch]))
        for k in range(layers)
        for i in range(counts[0])
        for j in range(counts[1])
    ]


@pytest.mark.parametrize("kind", ["rows", "cubes"])
def test_boxes_side_by_side_fit_and_no_more_do_by_volume(kind: str) -> None:
    for instance in instances(kind, 100):
        (item,) = instance.items.values()
        tall = item.extents[2]
        corners = lattice(instance, math.floor(instance.container.height / tall + 1e-6), tall)
        assert len(corners) == instance.fits < len(instance.order), instance.label
        assert audit(instance.container, dict(instance.items), corners).ok, instance.label
        assert (instance.fits + 1) * item.volume > instance.container.volume * (1 - 1e-9), instance.label


@pytest.mark.parametrize("kind", ["nested", "filled"])
def test_stacks_of_the_stated_height_are_free_and_higher_ones_overlap(kind: str) -> None:
    seen = set()
    for instance in instances(kind, 60):
        if instance.kind not in SHELLS:
            continue
        seen.add(instance.kind)
        (item,) = instance.items.values()
        room = instance.container.height - item.extents[2]
        layers = instance.fits // len(lattice(instance, 1, 0.0))
        held = lattice(instance, layers, room / max(1, layers - 1))
        assert len(held) == instance.fits < len(instance.order)
        assert audit(instance.container, dict(instance.items), held).ok, instance.label
        assert audit(
            instance.container, dict(instance.items), lattice(instance, layers + 1, room / layers)
        ).overlaps, instance.label
    assert seen == set(SHELLS)


def test_cups_and_cores_are_free_in_the_middle_of_what_holds_them() -> None:
    seen = set()
    for instance in instances("nested", 60):
        items, size = dict(instance.items), np.array(instance.container.size)
        if len(items) == 1:
            continue
        seen.add(instance.kind)
        height, corners = 0.0, []
        for name, item in items.items():
            low = item.vertices.min(axis=0)
            corners.append((name, np.array([*(0.5 * size[:2] + low[:2]), height])))
            if name.startswith("cup"):
                inner = np.hypot(*item.vertices[:, :2].T) < 1e-9
                height += float(item.vertices[inner, 2].max())
        report = audit(instance.container, items, corners)
        assert report.ok, (instance.label, report)
    assert seen == {"cups in cups", "core in a round bore", "core in a square bore"}


def rotated(size: FloatArray, first: int, second: int, angles: FloatArray) -> FloatArray:
    """(n, 3) boxes about a box turned by angles between two axes."""
    boxes = np.tile(size, (len(angles), 1))
    cos, sin = np.abs(np.cos(angles)), np.abs(np.sin(angles))
    boxes[:, first] = size[first] * cos + size[second] * sin
    boxes[:, second] = size[first] * sin + size[second] * cos
    return boxes


def test_bars_go_in_at_an_angle_alone_where_they_are_said_to() -> None:
    fine = np.radians(np.arange(0.0, 90.0, 0.005))
    counts = {0: 0, 1: 0}
    for instance in instances("angles", 150):
        (item,) = instance.items.values()
        inner, size = np.array(instance.container.size), item.extents
        counts[instance.fits] += 1
        assert (np.sort(size) > np.sort(inner) + CLEARANCE).any(), instance.label
        if instance.kind == "corner to corner":
            diagonal = float(np.linalg.norm(inner))
            if not instance.fits:
                assert size.max() > diagonal
                continue
            lean = np.radians(np.arange(0.0, 90.0, 0.5))[:, None]
            yaw = np.radians(np.arange(0.0, 90.0, 0.5))[None, :]
            long_, thin = size[0], size[1:]
            x = np.cos(yaw) * (long_ * np.cos(lean) + thin[1] * np.sin(lean)) + np.sin(yaw) * thin[0]
            y = np.sin(yaw) * (long_ * np.cos(lean) + thin[1] * np.sin(lean)) + np.cos(yaw) * thin[0]
            z = long_ * np.sin(lean) + thin[1] * np.cos(lean) + 0.0 * yaw
            room = np.minimum(np.minimum(inner[0] - x, inner[1] - y), inner[2] - z)
            assert room.max() > -2e-3, instance.label
            continue
        other = 2 if instance.kind == "across" else int(np.argmin(inner))
        plane = [k for k in range(3) if k != other]
        flat = np.empty(3)
        flat[plane], flat[other] = size[:2], size[2]
        boxes = rotated(flat, *plane, fine)
        fitting = bool((boxes <= inner + 1e-9).all(axis=1).any())
        assert fitting == bool(instance.fits), instance.label
    assert min(counts.values()) > 10


@pytest.mark.parametrize("angle", [3.0, 8.0, 20.0])
def test_a_conical_cup_nests_at_wall_over_sine_or_at_its_floor(angle: float) -> None:
    half = math.radians(angle)
    thin, thick = (cup(0.03, 0.1, half, 0.001, floor) for floor in (0.0005, 0.03))
    tray = cup(0.03, 0.1, half, 0.001, 0.0005, rectangle(0.1, 0.2))
    assert thin.pitch == pytest.approx(0.001 / math.sin(half), rel=1e-9)
    assert tray.pitch == pytest.approx(thin.pitch, rel=1e-9)
    assert thick.pitch == pytest.approx(0.03, rel=1e-9)


def test_bowls_of_many_facets_nest_as_spheres_do_and_plates_at_their_thickness() -> None:
    radius, wall, opening = 0.08, 0.003, math.radians(75)
    centre = radius * math.cos(opening)
    smooth = math.sqrt(centre**2 + radius**2 - (radius - wall) ** 2) - centre
    assert bowl(radius, wall, opening, facets=400).pitch == pytest.approx(smooth, rel=1e-3)
    assert plate(0.06, 0.1, 0.02, 0.003).pitch == pytest.approx(0.003, rel=1e-9)


def test_the_command_counts_what_is_right(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["fits", "--instances", "3", "--json"])
    assert fits.main() == 0
    report = json.loads(capsys.readouterr().out)
    assert report["overlaps"] == 0
    for kind in ("rows", "cubes", "nested", "angles", "filled"):
        missed = [found for found in report["wrong"] if found["of"] == kind]
        assert report[kind] == pytest.approx(1.0 - len(missed) / 3)
        assert all(found["placed"] != found["fits"] for found in missed)


def test_a_wrong_answer_is_counted_as_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows where one piece more is said to fit than does."""
    known = KINDS["rows"]

    def claimed(rng: np.random.Generator) -> object:
        for instance in known(rng):
            yield Instance(
                "false", instance.container, instance.items, (*instance.order, "box"), instance.fits + 1
            )

    monkeypatch.setitem(KINDS, "rows", claimed)
    monkeypatch.setattr(sys, "argv", ["fits", "--instances", "4", "--kinds", "rows"])
    assert fits.main() == 0
    printed = capsys.readouterr().out
    assert "rows       0.0% of    4  (false 0%)" in printed
    assert printed.count(" false: ") == 4
