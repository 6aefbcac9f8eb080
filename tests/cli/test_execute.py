"""``robotpack execute`` as a user meets it."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from packenv.cli import main
from packenv.sim.descent import PlacementTask
from packenv.sim.session import ItemOutcome, Session
from tests.cli.refusals import refused
from tests.conftest import BULLET, REPO, needs_bullet
from tests.mesh_samples import write_three

SIZE = "0.2x0.2x0.12"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shelf, an order, and the order's plans for a robot and for an ideal hand."""
    folder = tmp_path_factory.mktemp("execute")
    write_three(folder)
    (folder / "objects.csv").write_text(
        "name,file,mass_kg\nbrick,brick.ply,0.3\nbook,book.ply,0.2\ncan,can.ply,0.1\n"
    )
    (folder / "order.csv").write_text("item,qty\nbrick,1\nbook,1\ncan,1\n")
    for constraints in ("robot", "overlap"):
        options = ["--catalogue", folder, "--container", SIZE, "--constraints", constraints, "--rehearse", 0]
        out = folder / f"{constraints}.json"
        assert main(["pack", *map(str, [folder / "order.csv", *options, "--out", out])]) == 0
    return folder


def execute(*arguments: str | Path) -> int:
    return main(["execute", *map(str, arguments)])


def edited(folder: Path, edit: Callable[[dict[str, Any]], object], plan: str = "robot") -> Path:
    document = json.loads((folder / f"{plan}.json").read_text())
    edit(document)
    path = folder / "edited.json"
    path.write_text(json.dumps(document))
    return path


def test_a_plan_is_carried_out_and_measured(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert execute(folder / "robot.json", "--json", "--out", tmp_path / "e.json") == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert printed.err == ""
    assert json.loads((tmp_path / "e.json").read_text()) == result
    assert (result["success"], result["cause"], result["placed"], result["loop"]) == (True, None, 3, "open")
    plan = json.loads((folder / "robot.json").read_text())
    for item, step in zip(result["items"], plan["steps"], strict=True):
        assert (item["item"], item["instance"]) == (step["item"], step["instance"])
        assert item["planned"]["position"] == pytest.approx(step["position"])
        assert item["drop_m"] == pytest.approx(0.01, abs=0.005)
        assert item["shift_m"] < 0.005
        assert item["at_rest"]
    assert execute(folder / "robot.json") == 0
    assert "success; 3 of 3 items placed" in capsys.readouterr().out


def test_page_and_animation_are_written(folder: Path, tmp_path: Path) -> None:
    page, gif = tmp_path / "e.html", tmp_path / "e.gif"
    assert execute(folder / "robot.json", "--html", page, "--gif", gif) == 0
    assert '"executed":true' in page.read_text()
    with Image.open(gif) as picture:
        assert picture.size == (480, 360)
        assert 20 < picture.n_frames <= 300
    assert sorted(p.name for p in tmp_path.iterdir()) == ["e.gif", "e.html"]


def test_every_process_measures_the_same_bits(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = folder / "robot.json"
    texts = []
    for _ in range(2):
        capsys.readouterr()
        assert execute(plan, "--json", "--disturb", "--seed", "3") in (0, 1)
        texts.append(capsys.readouterr().out)
    command = [
        sys.executable,
        "-m",
        "packenv",
        "execute",
        str(plan),
        "--json",
        "--disturb",
        "--seed",
        "3",
    ]
    fresh = subprocess.run(
        command, capture_output=True, text=True, cwd=REPO, env=os.environ.copy(), timeout=120, check=False
    )
    assert fresh.stderr == ""
    assert texts[0] == texts[1] == fresh.stdout


def test_a_plan_without_joints_is_carried_out_by_an_ideal_hand(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert execute(folder / "overlap.json", "--json") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["success"] is True
    assert "ideal hand" in printed.err


def test_options_reach_the_physics(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def result(*options: str) -> dict[str, Any]:
        capsys.readouterr()
        assert execute(folder / "robot.json", "--json", *options) in (0, 1)
        document: dict[str, Any] = json.loads(capsys.readouterr().out)
        return document

    nominal = result()
    full = result("--full-settle", "--settle", "1.5")
    assert all(item["settle_s"] == pytest.approx(1.5, abs=0.01) for item in full["items"])
    assert all(item["settle_s"] < 1.4 for item in nominal["items"])
    gentle = result("--gentle")
    assert gentle["drop_m"] < 0.5 * nominal["drop_m"]
    one, other = (result("--disturb", "--seed", seed) for seed in ("1", "2"))
    assert len({r["items"][0]["final"]["position"][0] for r in (nominal, one, other)}) == 3
    assert (nominal["disturbance"], one["disturbance"]["seed"]) == (None, 1)
    frictions = {r["disturbance"]["drawn_mu"] for r in (one, other)}
    assert len(frictions) == 2
    assert all(0.5 <= mu <= 0.9 for mu in frictions)


def test_guarded_moves_are_for_the_open_loop_too(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A book that hangs 4 mm off meets the wall: a blind robot stops there, one that feels gets beside it."""

    def into_the_wall(plan: dict[str, Any]) -> None:
        for key in ("position", "corner"):
            plan["steps"][0][key][0] -= 0.004

    path = edited(folder, into_the_wall, "overlap")
    capsys.readouterr()
    assert execute(path, "--json") == 1
    assert json.loads(capsys.readouterr().out)["cause"] == "collision"
    assert execute(path, "--feel", "--json") == 0
    felt = json.loads(capsys.readouterr().out)
    assert (felt["loop"], felt["placed"]) == ("open", 3)
    assert felt["config"]["motion"]["feel"] == 0.0005
    assert felt["items"][0]["deepest_m"] < 0.002


def onto_the_first(plan: dict[str, Any]) -> None:
    """Plan the second item where the first one lies."""
    first, second = plan["steps"][:2]
    for key in ("position", "corner"):
        second[key][:2] = first[key][:2]


def test_a_closed_loop_plans_again_what_would_go_wrong(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Grasps slip by millimetres, no matter; an item that would meet another one gets a new place."""
    capsys.readouterr()
    assert execute(folder / "robot.json", "--closed-loop", "--disturb", "--seed", "1", "--json") == 0
    closed = json.loads(capsys.readouterr().out)
    assert (closed["success"], closed["loop"], closed["placed"]) == (True, "closed", 3)
    plan = json.loads((folder / "robot.json").read_text())
    assert closed["items"][0]["planned"]["position"] == pytest.approx(plan["steps"][0]["position"])
    path = edited(folder, onto_the_first, "robot")
    assert execute(path, "--json") == 1
    capsys.readouterr()
    assert execute(path, "--closed-loop", "--json") == 0
    closed = json.loads(capsys.readouterr().out)
    assert (closed["success"], closed["placed"]) == (True, 3)
    assert closed["plans"] > 1
    assert execute(path, "--closed-loop") == 0
    assert "times" in capsys.readouterr().out


def test_a_closed_loop_tells_of_every_item_after_a_collision(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the open loop does: the same plan, the same items planned."""
    path = edited(folder, onto_the_first, "overlap")
    counts = []
    for options in ([], ["--closed-loop"]):
        capsys.readouterr()
        code = execute(path, "--json", *options)
        result = json.loads(capsys.readouterr().out)
        assert code == (0 if result["success"] else 1)
        counts.append(result["planned"])
    assert counts == [3, 3]


def test_a_closed_loop_needs_the_planner_s_settings(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, value in (("heuristic", "best"), ("seed", None), ("n_poses", 0), ("grid_step", 0.0033)):
        path = edited(folder, lambda plan, n=name, v=value: plan["settings"].update({n: v}))
        capsys.readouterr()
        refused(capsys, execute(path, "--closed-loop"), "edited.json", name)


def test_an_item_that_sticks_out_is_no_success(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = edited(folder, lambda plan: plan["container"].update(size=[0.2, 0.2, 0.03]), "overlap")
    capsys.readouterr()
    assert execute(path, "--json") == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["success"], result["cause"]) == (False, "item-out")
    assert "out of the container" in result["detail"]
    assert execute(path) == 1
    assert "failed (item-out)" in capsys.readouterr().out


def test_a_collision_stops_the_robot(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def onto_the_first(plan: dict[str, Any]) -> None:
        for key in ("position", "corner"):
            plan["steps"][1][key] = plan["steps"][0][key]

    path = edited(folder, onto_the_first, "overlap")
    capsys.readouterr()
    assert execute(path, "--json") == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["cause"], result["planned"], result["placed"]) == ("collision", 3, 1)
    assert [item["collided"] for item in result["items"]] == [False, True]


# ---------------------------------------------------------------------------------------------- mistakes


def no_steps(plan: dict[str, Any]) -> None:
    plan["steps"] = []


def short_path(plan: dict[str, Any]) -> None:
    plan["steps"][1]["details"]["manipulation"]["joints"] = [[0.0] * 6]


def bent_path(plan: dict[str, Any]) -> None:
    """The wrist is the other way round at one waypoint, where the tool is the same."""
    joints = plan["steps"][1]["details"]["manipulation"]["joints"][1]
    joints[3:] = [joints[3] + math.pi, -joints[4], joints[5] + math.pi]


@pytest.mark.parametrize(
    ("edit", "word"),
    [
        (no_steps, "places no item"),
        (short_path, "a path of three or more waypoints"),
        (bent_path, "do not lie on one branch"),
    ],
    ids=["empty", "short", "bent"],
)
def test_a_plan_that_cannot_be_carried_out_isrefused(
    edit: Callable[[dict[str, Any]], None], word: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = edited(folder, edit)
    capsys.readouterr()
    refused(capsys, execute(path), word, "edited.json")


def test_a_closed_loop_needs_placements_in_the_container(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = edited(folder, lambda plan: plan["steps"][0]["position"].__setitem__(0, -0.1))
    capsys.readouterr()
    refused(capsys, execute(path, "--closed-loop"), "edited.json", "step 1", "not inside")


def test_a_seed_needs_a_disturbance(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    refused(capsys, execute(folder / "robot.json", "--seed", "3"), "--seed 3", "--disturb")


@needs_bullet
def test_a_window_that_is_closed_ends_the_execution(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user closes it while the second item is placed; there is no window here, but its engine goes."""
    place = Session.place

    def closing(self: Session, task: PlacementTask) -> ItemOutcome:
        if self.measured():
            self.close()
        return place(self, task)

    monkeypatch.setattr(Session, "place", closing)
    capsys.readouterr()
    code = execute(folder / "overlap.json", "--engine", "bullet")
    assert code == 2
    assert "the window was closed" in capsys.readouterr().err


def test_wrong_files_are_refused_before_any_work(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = folder / "robot.json"
    capsys.readouterr()
    refused(capsys, execute(tmp_path / "none.json"), "none.json", "cannot be read")
    refused(capsys, execute(plan, "--out", tmp_path / "missing" / "e.json"), "--out", "does not exist")
    refused(capsys, execute(plan, "--out", tmp_path / "e", "--gif", tmp_path / "e"), "is also")
    refused(capsys, execute(plan, "--gif", plan), "is also")
    assert list(tmp_path.iterdir()) == []


def test_a_window_needs_a_display(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    capsys.readouterr()
    refused(
        capsys, execute(folder / "robot.json", "--gui", "--engine", "mujoco"), "--gui", "PyBullet's window"
    )
    if BULLET:
        refused(capsys, execute(folder / "robot.json", "--gui"), "--gui", "no display")


@pytest.mark.parametrize("seconds", ["0", "-1", "601", "nan", "soon"])
def test_a_settling_time_out_of_range_isrefused(
    seconds: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        execute(folder / "robot.json", "--settle", seconds)
    assert stopped.value.code == 2
    assert "--settle" in capsys.readouterr().err


def test_help_imports_no_physics() -> None:
    code = "import sys; from packenv.cli import main\n"
    code += "try: main(['execute', '--help'])\nexcept SystemExit: pass\n"
    code += "sys.exit(any(name in sys.modules for name in ('pybullet', 'numba', 'scipy', 'torch', 'PIL')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, cwd=REPO, check=False)
    assert done.returncode == 0
