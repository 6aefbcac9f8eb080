"""Every claim of a plan file is compared, or named as one that nobody checked: many ways to lie, each caught."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from packenv.cli import main

Lie = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two kinds of items, and a plan for the robot of an order of which one piece is left over."""
    folder = tmp_path_factory.mktemp("items")
    trimesh.creation.box((0.08, 0.06, 0.04)).export(folder / "brick.ply")
    trimesh.creation.box((0.5, 0.02, 0.02)).export(folder / "pole.ply")
    (folder / "objects.csv").write_text(
        "name,file,mass_kg,friction\nbrick,brick.ply,0.3,0.6\npole,pole.ply,0.2,\n"
    )
    (folder / "order.csv").write_text("item,qty\nbrick,2\npole,1\n")
    words = ["order.csv", "--container", "0.2x0.2x0.12", "--out", "plan.json", "--heuristic", "dblf"]
    paths = [str(folder / w) if w.endswith((".csv", ".json")) else w for w in words]
    assert main(["pack", *paths, "--catalogue", str(folder), "--clearance", "0.002"]) in (0, 1)
    return folder


def verified(
    folder: Path, lie: Lie, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, dict[str, Any], str]:
    """Exit code, report and words of ``verify`` on the plan with a change."""
    document = json.loads((folder / "plan.json").read_text())
    assert len(document["steps"]) == 2
    assert len(document["leftovers"]) == 1
    lie(document)
    path = tmp_path / "tampered.json"
    path.write_text(json.dumps(document))
    capsys.readouterr()
    code = main(["verify", str(path), "--catalogue", str(folder), "--json"])
    said = capsys.readouterr()
    report = json.loads(said.out) if said.out else {}
    assert code == main(["verify", str(path), "--catalogue", str(folder)])
    words = capsys.readouterr()
    return code, report, words.out + words.err


def path_of(document: dict[str, Any], step: int) -> dict[str, Any]:
    found: dict[str, Any] = document["steps"][step]["details"]["manipulation"]
    return found


def turning(document: dict[str, Any]) -> None:
    joints = path_of(document, 0)["joints"]
    for row, more in zip(joints, np.linspace(1.5, 0.0, len(joints)), strict=True):
        row[5] += float(more) * (-1.0 if row[5] > 0 else 1.0)


def test_the_plan_as_it_is_passes_and_says_what_is_not_checked(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report, words = verified(folder, lambda document: None, tmp_path, capsys)
    assert code == 0
    assert report["ok"]
    assert report["misstated_claims"] == []
    for name in ("stable_pose", "yaw", "route", "details.clearance_m", "leftovers.reason"):
        assert name in report["not_checked"]
        assert name in words
    rehearsed, _, words = verified(
        folder, lambda d: d["metrics"].update(rehearsal_worlds=5, rehearsal_survived=5), tmp_path, capsys
    )
    assert rehearsed == 0
    assert "metrics.rehearsal_survived" in words


@pytest.mark.parametrize(
    ("lie", "where"),
    [
        (lambda d: d["meshes"]["brick"].update(mass=0.03), "meshes.brick.mass"),
        (lambda d: d["meshes"]["brick"].update(mass_estimated=True), "meshes.brick.mass_estimated"),
        (lambda d: d["meshes"]["brick"].update(volume=1e-9), "meshes.brick.volume"),
        (lambda d: d["meshes"]["brick"].update(friction=0.9), "meshes.brick.friction"),
        (lambda d: d["meshes"]["brick"].pop("friction"), "meshes.brick.friction"),
        (lambda d: d["metrics"].update(utilization=0.9), "metrics.utilization"),
        (lambda d: d["metrics"].update(utilization="all of it"), "metrics.utilization"),
        (lambda d: d["metrics"].update(height=0.01), "metrics.height"),
        (lambda d: d["metrics"].update(packed=3), "metrics.packed"),
        (lambda d: d["metrics"].update(ordered=2), "metrics.ordered"),
        (lambda d: d["metrics"].update(route_5d=1), "metrics.route_5d"),
        (lambda d: d["steps"][0].update(route="later"), "metrics.route_first-pass"),
    ],
)
def test_a_false_figure_is_named(
    lie: Lie, where: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report, words = verified(folder, lie, tmp_path, capsys)
    assert code == 1
    assert not report["ok"]
    assert [claim["where"] for claim in report["misstated_claims"]] == [where]
    assert f"misstated: {where} is " in words


@pytest.mark.parametrize(
    ("lie", "key"),
    [
        (turning, "unreachable_steps"),
        (lambda d: path_of(d, 1).update(joints=path_of(d, 0)["joints"]), "unreachable_steps"),
        (lambda d: d["steps"][1].update(position=d["steps"][0]["position"]), "overlaps"),
        (lambda d: d["steps"][0]["corner"].__setitem__(2, 0.01), "misstated_boxes"),
        (lambda d: d["container"].update(size=[0.2, 0.2, 0.03]), "protrusions"),
        (lambda d: d["leftovers"].clear(), "miscounted"),
        (lambda d: d["steps"][1]["position"].__setitem__(2, 0.5), "unstable_steps"),
    ],
    ids=["turning", "other joints", "overlap", "corner", "container", "lost", "floating"],
)
def test_a_false_step_is_found(
    lie: Lie, key: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report, _ = verified(folder, lie, tmp_path, capsys)
    assert code == 1
    assert report[key]
    assert not report["ok"]


@pytest.mark.parametrize("key", ["mass", "volume"])
@pytest.mark.parametrize("value", [0.0, -0.3])
@pytest.mark.parametrize("name", ["brick", "pole"])
def test_what_weighs_nothing_is_refused(
    key: str, value: float, name: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of items that are left over, too, which are in no pile."""
    code, _, words = verified(folder, lambda d: d["meshes"][name].update({key: value}), tmp_path, capsys)
    assert code == 2
    assert f"meshes.{name}.{key} is {value}, should be a number above 0" in words
