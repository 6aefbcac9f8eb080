"""``robotpack export`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh

from packenv.cli import main
from tests.memory_samples import meshes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("items")
    for name, solid in meshes().items():
        solid.export(folder / f"{name}.ply")
    (folder / "order.csv").write_text("item,qty\nbrick,1\ncan,1\n")
    return folder


def pack(folder: Path, plan: Path, *more: str) -> int:
    arguments = ["pack", str(folder / "order.csv"), "--catalogue", str(folder), "--container", "0.2x0.2x0.12"]
    return main([*arguments, "--out", str(plan), *more])


@pytest.fixture(scope="module")
def plan(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plans") / "p.json"
    assert pack(folder, path) == 0
    return path


@pytest.mark.parametrize("robot", ["tx90", "kr10_r1100"])
def test_a_plan_leaves_for_a_robot(
    folder: Path, robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, out = tmp_path / "p.json", tmp_path / "t.json"
    assert pack(folder, plan, "--cell", robot) == 0
    capsys.readouterr()
    assert main(["export", str(plan), "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    document = json.loads(out.read_text())
    duration = sum(step["duration"] for step in document["steps"])
    first, last = printed.out.splitlines()
    assert first == f"2 of 2 steps have a motion: {duration:.1f} s"
    assert last == f"wrote {out}"
    assert document["robot"]["name"] == robot
    assert document["plan"]["file"] == "p.json"


def test_share_and_speed_are_heeded(plan: Path, tmp_path: Path) -> None:
    durations = []
    for share, speed in (("0.5", "0.5"), ("0.5", "0.1"), ("0.05", "0.5")):
        out = tmp_path / "t.json"
        assert main(["export", str(plan), "-o", str(out), "--share", share, "--speed", speed]) == 0
        document = json.loads(out.read_text())
        assert document["limits"]["share"] == float(share)
        assert document["limits"]["speed"] == float(speed)
        durations.append(sum(step["duration"] for step in document["steps"]))
    assert durations[1] > 1.5 * durations[0]
    assert durations[2] > 1.5 * durations[0]


def test_a_step_without_a_motion_is_told_and_ends_with_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell.json"
    cell.write_text(json.dumps({"robot": "tx90", "pick": {"position_m": [3.0, 0.0, 0.0]}}))
    plan, out = tmp_path / "p.json", tmp_path / "t.json"
    assert pack(folder, plan, "--cell", str(cell)) == 0
    capsys.readouterr()
    assert main(["export", str(plan), "-o", str(out)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("no motion: step ") for line in lines) == 2
    assert "0 of 2 steps have a motion: 0.0 s" in lines
    document = json.loads(out.read_text())
    assert document["ok"] is False
    assert all("no posture of the arm reaches" in step["problem"] for step in document["steps"])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--share", "2"], ["share is 2", "at most 1"]),
        (["--speed", "0"], ["speed is 0"]),
        (["-o", "missing/t.json"], ["missing", "does not exist"]),
    ],
)
def test_a_mistake_is_one_line(
    plan: Path, more: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(plan), "-o", str(tmp_path / "t.json"), *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(word in line for word in words)
    assert not (tmp_path / "t.json").exists()


def test_a_plan_without_joints_says_what_to_do(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "p.json"
    assert pack(folder, plan, "--constraints", "stability") == 0
    capsys.readouterr()
    assert main(["export", str(plan), "-o", str(tmp_path / "t.json")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"robotpack: {plan}: step 1 (")
    assert line.endswith("pack --constraints robot")
    assert not (tmp_path / "t.json").exists()


def test_the_plan_itself_is_never_written_over(plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = plan.read_bytes()
    assert main(["export", str(plan), "-o", str(plan)]) == 2
    assert "is also" in capsys.readouterr().err
    assert plan.read_bytes() == before


def test_the_meshes_are_those_of_the_catalogue(plan: Path, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "t.json"
    assert main(["export", str(plan), "-o", str(out)]) == 0
    for name, mesh in json.loads(out.read_text())["meshes"].items():
        solid = trimesh.load_mesh(folder / f"{name}.ply", process=False)
        exported = trimesh.Trimesh(mesh["vertices"], mesh["triangles"], process=False)
        assert exported.volume == pytest.approx(solid.volume, rel=1e-3)
        assert exported.is_watertight
