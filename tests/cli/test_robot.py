"""pack, verify and view under stability and manipulation constraints, as a user meets them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from packenv.cli import main
from packenv.io.plans import read_plan, write_plan

SIZE = "0.2x0.2x0.12"
Edit = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five items; the cup cannot take the stick anywhere."""
    folder = tmp_path_factory.mktemp("shelf")
    trimesh.creation.box((0.08, 0.06, 0.04)).export(folder / "brick.ply")
    trimesh.creation.box((0.10, 0.08, 0.02)).export(folder / "book.ply")
    trimesh.creation.box((0.06, 0.05, 0.03)).export(folder / "block.ply")
    trimesh.creation.cylinder(0.02, 0.06, sections=24).export(folder / "can.ply")
    trimesh.creation.box((0.012, 0.012, 0.05)).export(folder / "stick.ply")
    rows = ["brick,brick.ply,0.3", "book,book.ply,0.2", "can,can.ply,0.1", "stick,stick.ply,0.01"]
    (folder / "objects.csv").write_text("\n".join(["name,file,mass_kg", *rows, "block,block.ply,0.1", ""]))
    return folder


@pytest.fixture(scope="module")
def order(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("orders") / "order.csv"
    path.write_text("item,qty\nbrick,1\nbook,1\ncan,2\nblock,1\n")
    return path


def pack(order: Path, shelf: Path, *more: str | Path) -> int:
    arguments = [order, "--catalogue", shelf, "--container", SIZE, *more]
    return main(["pack", *map(str, arguments)])


def verified(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = main(["verify", str(path), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def robot_plan(order: Path, shelf: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plans") / "p.json"
    assert pack(order, shelf, "--out", path) == 0
    return path


def edited(path: Path, edit: Edit) -> Path:
    """A copy beside the plan, so that its catalogue is found."""
    document = json.loads(path.read_text())
    edit(document)
    copy = path.with_name("edited.json")
    copy.write_text(json.dumps(document))
    return copy


# ----------------------------------------------------------------------------------- pack, then verify


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--constraints", "overlap"),
        ("--constraints", "stability"),
        ("--stability", "paper"),
        ("--constraints", "stability", "--stability", "margin"),
        ("--stability", "margin", "--heuristic", "dblf"),
        ("--search", "5d"),
        ("--contacts", "paper", "--heuristic", "mta"),
        ("--grasp", "paper", "--heuristic", "random", "--seed", "3"),
        ("--grasp", "flat", "--sequence", "given"),
    ],
    ids=" ".join,
)
def test_what_pack_plans_verify_accepts(
    options: tuple[str, ...],
    order: Path,
    shelf: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "p.json"
    assert pack(order, shelf, *options, "--out", path) == 0
    code, report = verified(path, capsys)
    assert code == 0
    assert report["ok"] is True
    assert report["unstable_steps"] == report["unreachable_steps"] == []
    plan = json.loads(path.read_text())
    settings = dict(zip(options[::2], options[1::2], strict=True))
    for key in ("constraints", "stability", "search", "grasp", "contacts", "heuristic"):
        default = {
            "constraints": "robot",
            "stability": "cautious",
            "search": "3d",
            "grasp": "seal",
            "contacts": "surface",
            "heuristic": "auto",
        }[key]
        assert plan["settings"][key] == settings.get(f"--{key}", default)
    routes = {key: n for key, n in plan["metrics"].items() if key.startswith("route_")}
    assert sum(routes.values()) == plan["metrics"]["packed"] == 5
    found = {f"route_{step['route']}" for step in plan["steps"]}
    assert set(routes) == found
    told = {"overlap": set(), "stability": {"stability", "robustness"}}
    told["robot"] = told["stability"] | {"manipulation"}
    for step in plan["steps"]:
        assert set(step["details"]) == told[plan["settings"]["constraints"]]


def test_same_seed_same_bytes(order: Path, shelf: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert pack(order, shelf, "--heuristic", "random", "--seed", "7", "--out", tmp_path / name) == 0
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_plan_is_read_as_it_was_written(robot_plan: Path) -> None:
    plan = read_plan(robot_plan)
    again = robot_plan.with_name("again.json")
    write_plan(again, plan)
    one, other = (json.loads(path.read_text()) for path in (robot_plan, again))
    for document in (one, other):
        for step in document["steps"]:
            # A quaternion goes through a matrix: its last bit may change.
            step["quat_xyzw"] = [round(q, 12) for q in step["quat_xyzw"]]
    assert one == other
    for step, placement in zip(one["steps"], plan.placements, strict=True):
        for key in ("checked", "rejections"):
            assert step[key] == getattr(placement, key)
        path = placement.path
        assert path is not None
        assert step["details"].pop("manipulation") == {
            "grasp": path.grasp.tolist(),
            "grasp_kind": path.grasp_kind,
            "grasps_tried": path.grasps_tried,
            "cup_heights": path.cup_heights.tolist(),
            "joints": path.joints.tolist(),
        }
        assert step["details"] == placement.details


def test_rejections_of_leftovers_are_read(robot_plan: Path) -> None:
    left = {"item": "can", "instance": 2, "reason": "no-packable-candidate", "detail": "full"}

    def edit(plan: dict[str, Any]) -> None:
        plan["steps"] = [s for s in plan["steps"] if (s["item"], s["instance"]) != ("can", 2)]
        for k, step in enumerate(plan["steps"], start=1):
            step["step"] = k
        plan["leftovers"] = [{**left, "rejections": {"unreachable": 3}}]

    (leftover,) = read_plan(edited(robot_plan, edit)).leftovers
    assert dataclasses.asdict(leftover) == {**left, "rejections": {"unreachable": 3}}


# ------------------------------------------------------------------------------------------ leftovers


def test_a_stick_that_no_cup_can_take_is_left_over(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item,qty\nbrick,1\nstick,1\n")
    assert pack(order, shelf, "--json") == 1
    plan = json.loads(capsys.readouterr().out)
    assert [step["item"] for step in plan["steps"]] == ["brick"]
    (left,) = plan["leftovers"]
    assert (left["item"], left["reason"]) == ("stick", "no-graspable-spot")
    assert set(left["rejections"]) == {"orientation-no-grasp"}
    assert pack(order, shelf) == 1
    told = capsys.readouterr().out
    assert "no graspable spot" in told
    assert "--grasp" in told
    assert "--constraints stability" in told


def test_a_deep_container_is_out_of_reach(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item,qty\nbrick,1\n")
    assert pack(order, shelf, "--container", "0.15x0.15x1.5", "--json", "--search", "5d") == 1
    (left,) = json.loads(capsys.readouterr().out)["leftovers"]
    assert left["reason"] == "unreachable-container"
    assert "0.15x0.15x1.5 is 1.5 m above" in left["detail"]
    assert pack(order, shelf, "--container", "0.15x0.15x1.5", "--constraints", "stability") == 0


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
@pytest.mark.parametrize(
    "boxes",
    [
        "S,0.1,0.1,0.05",
        pytest.param(
            "S,0.09,0.07,0.05\nT,0.11,0.09,0.045",
        ),
    ],
)
def test_no_piece_is_lost_where_no_box_takes_all(
    boxes: str,
    constraints: str,
    order: Path,
    shelf: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Every ordered piece is a step or a leftover, whichever box was tried last."""
    table = tmp_path / "boxes.csv"
    table.write_text(f"box_id,length_m,width_m,height_m\n{boxes}\n")
    path = tmp_path / "p.json"
    options = ("--container", "auto", "--boxes", table, "--constraints", constraints)
    assert pack(order, shelf, *options, "--out", path) == 1
    _, report = verified(path, capsys)
    assert report["miscounted"] == []
    assert report["placed"] + report["left_over"] == 5


# --------------------------------------------------------------------------------------- tampered plans


def test_a_plan_that_claims_more_than_it_keeps(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Planned at random under overlap alone, an item soon hangs over an edge."""
    path = tmp_path / "p.json"
    options = ("--constraints", "overlap", "--heuristic", "random", "--out", path)

    def claim(word: str) -> Edit:
        return lambda plan: plan["settings"].update(constraints=word)

    fallen = 0
    for seed in range(6):
        assert pack(order, shelf, *options, "--seed", str(seed)) == 0
        assert verified(path, capsys)[0] == 0
        code, report = verified(edited(path, claim("stability")), capsys)
        assert code == int(bool(report["unstable_steps"])) == 1 - int(report["ok"])
        assert report["unreachable_steps"] == []
        fallen += code
    assert fallen >= 1
    code, report = verified(edited(path, claim("robot")), capsys)
    assert code == 1
    assert report["unreachable_steps"] == [1, 2, 3, 4, 5]  # no joints are stated


def test_tampered_joints_are_found_and_said(robot_plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def bend(plan: dict[str, Any]) -> None:
        plan["steps"][2]["details"]["manipulation"]["joints"][-1][1] += 0.01

    path = edited(robot_plan, bend)
    code, report = verified(path, capsys)
    assert (code, report["unreachable_steps"], report["unstable_steps"]) == (1, [3], [])
    assert main(["verify", str(path)]) == 1
    assert "the robot cannot place step 3" in capsys.readouterr().out


def test_an_item_lifted_off_its_support_is_found(
    robot_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def lift(plan: dict[str, Any]) -> None:
        for key in ("position", "corner"):
            plan["steps"][0][key][2] += 0.02

    path = edited(robot_plan, lift)
    code, report = verified(path, capsys)
    assert code == 1
    assert 1 in report["unstable_steps"]
    assert main(["verify", str(path)]) == 1
    assert "the pile does not stand at step 1" in capsys.readouterr().out


def test_what_else_is_wrong_is_still_reported(robot_plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An item outside the container cannot be checked on; the audit's findings are not lost."""
    path = edited(robot_plan, lambda plan: plan["steps"][1]["position"].__setitem__(0, -0.5))
    code, report = verified(path, capsys)
    assert code == 1
    assert any(found["step"] == 2 for found in report["protrusions"])
    assert 2 in report["unreachable_steps"]


@pytest.mark.parametrize("key", ["constraints", "stability", "grasp", "contacts"])
@pytest.mark.parametrize("value", ["none", None, 3])
def test_an_unknown_claim_is_refused(
    key: str, value: object, robot_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["verify", str(edited(robot_plan, lambda plan: plan["settings"].update({key: value})))]) == 2
    printed = capsys.readouterr()
    (line,) = printed.err.strip().splitlines()
    assert f"edited.json: settings: {key} is {value!r}, give one of" in line


@pytest.mark.parametrize(
    ("key", "value"), [("checked", -1), ("checked", "two"), ("rejections", []), ("details", None)]
)
def test_a_wrong_value_is_refused(
    key: str, value: object, robot_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = edited(robot_plan, lambda plan: plan["steps"][1].update({key: value}))
    capsys.readouterr()
    assert main(["verify", str(path)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert key in line


@pytest.mark.parametrize("key", ["rejections", "details"])
def test_a_missing_mapping_is_named_with_its_place(
    key: str, robot_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = edited(robot_plan, lambda plan: plan["steps"][1].pop(key))
    capsys.readouterr()
    assert main(["verify", str(path)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "steps[1]" in line


# ------------------------------------------------------------------------------------------------- page


def test_the_page_tells_the_constraints_figures(robot_plan: Path, tmp_path: Path) -> None:
    page = tmp_path / "v.html"
    assert main(["view", str(robot_plan), "-o", str(page)]) == 0
    text = page.read_text()
    for label in ("Checked", "Contacts", "Tilt margin", "Forces on it", "Grasp", "Joints"):
        assert f'"{label}"' in text


@pytest.mark.parametrize(
    "details",
    [
        {"stability": {"margin_deg": "much"}},
        {"stability": {"forces": [{"at": [0, 0]}]}},
        {"stability": {"forces": 3}},
        {"manipulation": {}},
        {"manipulation": {"grasp": "top", "grasp_kind": 1, "joints": []}},
    ],
    ids=str,
)
def test_malformed_details_are_no_crash(
    details: dict[str, Any], robot_plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = edited(robot_plan, lambda plan: plan["steps"][0].update(details=details))
    capsys.readouterr()
    assert main(["view", str(path), "-o", str(tmp_path / "v.html")]) in (0, 2)
