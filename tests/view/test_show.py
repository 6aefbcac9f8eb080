"""What is shown of a plan and of an execution, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import packenv as rp
from packenv.cli import main
from packenv.types import FloatArray
from packenv.view.show import SUFFIXES
from tests.memory_samples import BOX, QUICK, meshes
from tests.mesh_samples import write_three

ORDER = rp.Order.of("brick", "can", "can")


@pytest.fixture(scope="module")
def plan() -> rp.Plan:
    return rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), **QUICK)


@pytest.fixture(scope="module")
def executed(plan: rp.Plan) -> rp.ExecutedPlan:
    """Recorded; the disturbed world takes items away from where they were planned."""
    return rp.execute(plan, feel=True, disturb=3, record=True)


def placed(plan: rp.Plan, poses: tuple[rp.Pose, ...]) -> dict[str, FloatArray]:
    """(n, 3) vertices of every placed item in the container frame, by the name of its node."""
    names = [p.item if p.instance == 1 else f"{p.item}-{p.instance}" for p in plan.placements]
    points = [pose.apply(plan.items[p.item].vertices) for p, pose in zip(plan.placements, poses, strict=True)]
    return dict(zip(names, points, strict=True))


def in_file(path: Path) -> dict[str, FloatArray]:
    """The same as a 3D program reads it."""
    scene = trimesh.load(path)
    found = {}
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        found[node] = trimesh.transform_points(scene.geometry[geometry].vertices, matrix)
    return found


def bounds(points: FloatArray) -> FloatArray:
    return np.array([points.min(axis=0), points.max(axis=0)])


def same(found: dict[str, FloatArray], expected: dict[str, FloatArray]) -> None:
    assert sorted(found) == sorted(expected)
    for name, points in expected.items():
        np.testing.assert_allclose(bounds(found[name]), bounds(points), atol=1e-6)


def test_a_glb_has_a_node_for_every_placement(plan: rp.Plan, tmp_path: Path) -> None:
    rp.show(plan, tmp_path / "p.glb")
    planned = placed(plan, tuple(p.pose for p in plan.placements))
    assert sorted(planned) == ["brick", "can", "can-2"]
    same(in_file(tmp_path / "p.glb"), planned)
    scene = trimesh.load(tmp_path / "p.glb")
    assert sorted(scene.geometry) == ["brick", "can"]
    np.testing.assert_allclose(scene.bounds, bounds(np.concatenate(list(planned.values()))), atol=1e-6)
    np.testing.assert_allclose(plan.to_scene().bounds, scene.bounds, atol=1e-6)
    assert plan.to_scene().metadata["container"] == list(BOX.size)


def test_a_glb_of_an_execution_has_measured_poses(
    plan: rp.Plan, executed: rp.ExecutedPlan, tmp_path: Path
) -> None:
    rp.show(executed, tmp_path / "e.glb")
    found = in_file(tmp_path / "e.glb")
    same(found, placed(plan, executed.execution.final))
    planned = placed(plan, tuple(p.pose for p in plan.placements))
    assert max(np.abs(bounds(found[name]) - bounds(planned[name])).max() for name in found) > 1e-4


def test_the_glb_of_a_stopped_execution_has_what_was_placed(plan: rp.Plan, tmp_path: Path) -> None:
    first, second, *rest = plan.placements
    onto = rp.Placement(**{**vars(second), "position": first.position, "corner": first.corner})
    broken = rp.Plan(**{**vars(plan), "placements": (first, onto, *rest)})
    stopped = rp.execute(broken)
    assert not stopped.success
    rp.show(stopped, tmp_path / "e.glb")
    assert len(in_file(tmp_path / "e.glb")) == len(stopped.execution.final) < 3


@pytest.mark.parametrize("of", ["plan", "execution"])
@pytest.mark.parametrize("name", ["a.html", "a.HTM", "a.png", "a.PNG", "a.gif", "a.glb"])
def test_a_file_is_what_its_name_says(
    name: str, of: str, plan: rp.Plan, executed: rp.ExecutedPlan, tmp_path: Path
) -> None:
    thing = plan if of == "plan" else executed
    path = tmp_path / name
    rp.show(thing, str(path))
    content = path.read_bytes()
    kind = path.suffix.lower()
    if kind in (".html", ".htm"):
        assert content.lower().startswith(b"<!doctype html>")
        assert b"brick" in content
    elif kind == ".png":
        assert content.startswith(b"\x89PNG\r\n\x1a\n")
        with Image.open(path) as picture:
            assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 100
    elif kind == ".gif":
        assert content.startswith(b"GIF89a")
        with Image.open(path) as picture:
            frames = 1 + 3 * 2 if of == "plan" else 5
            assert picture.n_frames >= frames
            first = np.asarray(picture.convert("RGB"))
            picture.seek(picture.n_frames - 1)
            assert (np.asarray(picture.convert("RGB")) != first).any()
    else:
        assert content.startswith(b"glTF")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a.pdf", "a", "a.json", "glb"])
def test_an_unknown_kind_is_refused(
    name: str, plan: rp.Plan, executed: rp.ExecutedPlan, tmp_path: Path
) -> None:
    for thing in (plan, executed):
        with pytest.raises(rp.InputError) as problem:
            rp.show(thing, tmp_path / name)
        assert "\n" not in str(problem.value)
        assert all(suffix in str(problem.value) for suffix in SUFFIXES)
        assert name in str(problem.value)
    assert list(tmp_path.iterdir()) == []


def test_an_animation_of_what_was_not_recorded_is_refused(plan: rp.Plan, tmp_path: Path) -> None:
    silent = rp.execute(plan)
    assert silent.frames == ()
    with pytest.raises(rp.InputError, match="record=True"):
        rp.show(silent, tmp_path / "e.gif")
    assert list(tmp_path.iterdir()) == []
    rp.show(silent, tmp_path / "e.png")


def test_a_file_that_cannot_be_written_is_one_line(plan: rp.Plan, tmp_path: Path) -> None:
    for name in ("p.glb", "p.png", "p.html", "p.gif"):
        with pytest.raises(rp.InputError) as problem:
            rp.show(plan, tmp_path / "missing" / name)
        assert "missing" in str(problem.value)
        assert "\n" not in str(problem.value)


def test_what_is_shown_replaces_no_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = tmp_path / "brick.glb"
    trimesh.creation.box((0.08, 0.06, 0.04)).export(mesh)
    before = mesh.read_bytes()
    planned = rp.plan(rp.Order.of("brick"), BOX, str(tmp_path), constraints="overlap", **QUICK)
    with pytest.raises(rp.InputError, match=r"brick\.glb: is also .*brick\.glb, which is read"):
        rp.show(planned, mesh)
    assert mesh.read_bytes() == before
    rp.show(planned, tmp_path / "view.glb")
    monkeypatch.chdir(tmp_path)  # an item in memory has no file, whatever its name
    named = {"brick.glb": meshes()["brick"]}
    rp.show(rp.plan(rp.Order.of("brick.glb"), BOX, named, constraints="overlap", **QUICK), Path("brick.glb"))
    assert mesh.read_bytes() != before


@pytest.mark.parametrize("kind", ["gif", "glb"])
def test_view_writes_animations_and_3d_files(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_three(tmp_path)
    order, path, out = tmp_path / "order.csv", tmp_path / "p.json", tmp_path / f"v.{kind}"
    order.write_text("item,qty\nbrick,1\ncan,2\n")
    arguments = [order, "--catalogue", tmp_path, "--container", "0.2x0.2x0.12", "--out", path]
    assert main(["pack", *map(str, arguments), "--constraints", "overlap"]) == 0
    assert main(["view", str(path), "-o", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    if kind == "glb":
        plan = rp.load_plan(path)
        same(in_file(out), placed(plan, tuple(p.pose for p in plan.placements)))
    else:
        with Image.open(out) as picture:
            assert picture.n_frames >= 7
