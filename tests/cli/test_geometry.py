"""Plans on convex parts, with clearance and with physics, as a user meets them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from packenv.cli import main
from packenv.config import GridConfig
from packenv.geometry.prepare import PreparedItem
from packenv.io.plans import plan_to_json, read_plan
from packenv.items.cache import ItemCache
from packenv.items.catalogue import open_catalogue
from packenv.planning.assembly import MEMBERS
from packenv.types import Item
from tests.cli.refusals import refused

SIZE = "0.2x0.2x0.12"
CLEARANCE = 0.004


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ring, whose convex parts bulge into its hole by more than 1.5 mm, and two convex items."""
    folder = tmp_path_factory.mktemp("parts")
    trimesh.creation.annulus(0.02, 0.035, 0.03).export(folder / "ring.ply")
    trimesh.creation.box((0.10, 0.08, 0.05)).export(folder / "brick.ply")
    trimesh.creation.cylinder(0.0185, 0.06, sections=32).export(folder / "can.ply")
    (folder / "objects.csv").write_text(
        "name,file,mass_kg\nring,ring.ply,0.2\nbrick,brick.ply,0.4\ncan,can.ply,0.1\n"
    )
    (folder / "order.csv").write_text("item,qty\nring,1\nbrick,1\ncan,1\n")
    return folder


def pack(shelf: Path, *more: str | Path) -> int:
    arguments = [shelf / "order.csv", "--catalogue", shelf, "--container", SIZE, *more]
    return main(["pack", *map(str, arguments)])


@pytest.fixture(scope="module")
def mesh_plan(shelf: Path) -> Path:
    path = shelf / "mesh.json"
    assert pack(shelf, "--rehearse", "0", "--out", path) == 0
    return path


@pytest.fixture(scope="module")
def parts_plan(shelf: Path) -> Path:
    path = shelf / "parts.json"
    assert pack(shelf, "--geometry", "parts", "--out", path) == 0
    return path


@pytest.fixture(scope="module")
def physics_plan(shelf: Path) -> Path:
    path = shelf / "physics.json"
    assert pack(shelf, "--stability", "physics", "--clearance", str(CLEARANCE), "--out", path) == 0
    return path


def edited(path: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    """A copy beside the plan, so that its catalogue is found."""
    document = json.loads(path.read_text())
    edit(document)
    copy = path.with_name("edited.json")
    copy.write_text(json.dumps(document))
    return copy


def verified(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = main(["verify", str(path), "--json"])
    return code, json.loads(capsys.readouterr().out)


def can_in_ring(plan: dict[str, Any]) -> None:
    """The first ring lies on the floor and a can stands in its hole, 1.5 mm away from it all around."""
    plan["settings"]["constraints"] = "overlap"
    plan["metrics"] = {}  # of another pile
    steps = {step["item"]: step for step in reversed(plan["steps"])}
    shape = {"ring": (0.07, 0.07, 0.03), "can": (0.037, 0.037, 0.06)}
    plan["order"] = [{"item": name, "qty": 1} for name in shape]
    plan["steps"] = [steps[name] for name in shape]
    for number, (name, extents) in enumerate(shape.items(), start=1):
        place = np.array([0.05, 0.05, extents[2] / 2])
        corner = place - np.array(extents) / 2
        # What the plan says of the robot is not asked for under these constraints.
        steps[name].update(
            step=number,
            instance=1,
            position=place.tolist(),
            quat_xyzw=[0.0, 0.0, 0.0, 1.0],
            corner=corner.tolist(),
            extents=list(extents),
        )


# -------------------------------------------------------------------------------------------- geometry


def test_envelopes_of_a_plan_on_parts_do_not_overlap(
    parts_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report = verified(parts_plan, capsys)
    assert code == 0
    assert report["envelopes"]["pairs_checked"] == 3
    for found in (report, report["envelopes"]):
        assert found["overlaps"] == found["protrusions"] == found["blocked"] == []
    assert main(["verify", str(parts_plan)]) == 0
    assert "with convex parts: 0 overlaps" in capsys.readouterr().out


def test_parts_that_meet_fail_a_plan_on_parts_alone(
    mesh_plan: Path, parts_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The meshes are free of each other; what physics makes of them is not."""
    code, report = verified(edited(parts_plan, can_in_ring), capsys)
    assert code == 1
    assert report["overlaps"] == report["protrusions"] == report["blocked"] == []
    (overlap,) = report["envelopes"]["overlaps"]
    assert (overlap["step_a"], overlap["step_b"]) == (1, 2)
    assert main(["verify", str(parts_plan.with_name("edited.json"))]) == 1
    assert "with convex parts: overlap: step 2 (can)" in capsys.readouterr().out
    code, report = verified(edited(mesh_plan, can_in_ring), capsys)
    assert code == 0
    assert "envelopes" not in report


def test_an_item_shifted_into_another_is_found(parts_plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def shift(plan: dict[str, Any]) -> None:
        for key in ("position", "quat_xyzw", "corner", "extents"):
            plan["steps"][1][key] = plan["steps"][0][key]

    code, report = verified(edited(parts_plan, shift), capsys)
    assert code == 1
    for found in (report, report["envelopes"]):
        assert (1, 2) in {(o["step_a"], o["step_b"]) for o in found["overlaps"]}
    assert 2 in report["unreachable_steps"]  # it does not even lie on the grid any more


def test_a_plan_tells_the_envelopes_it_was_made_of(mesh_plan: Path, parts_plan: Path) -> None:
    of_meshes, of_parts = (json.loads(p.read_text()) for p in (mesh_plan, parts_plan))
    assert (of_meshes["settings"]["geometry"], of_parts["settings"]["geometry"]) == ("mesh", "parts")
    for name, mesh in of_parts["meshes"].items():
        envelope = mesh.pop("envelope_sha256")
        assert mesh == of_meshes["meshes"][name]
        assert (envelope == mesh["sha256"]) == (name != "ring")  # of a convex item the mesh is the envelope
    again = plan_to_json(read_plan(parts_plan))
    assert again["meshes"] == json.loads(parts_plan.read_text())["meshes"]


def test_a_plan_from_before_geometry_is_one_of_meshes(
    mesh_plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def older(plan: dict[str, Any]) -> None:
        del plan["settings"]["geometry"], plan["settings"]["clearance"]

    now, then = (verified(path, capsys) for path in (mesh_plan, edited(mesh_plan, older)))
    assert now == then
    assert then[0] == 0
    assert main(["view", str(mesh_plan.with_name("edited.json")), "-o", str(tmp_path / "v.png")]) == 0
    assert main(["execute", str(mesh_plan.with_name("edited.json")), "--closed-loop"]) == 0


def test_heightmaps_of_a_view_are_those_of_the_plan(shelf: Path, parts_plan: Path, tmp_path: Path) -> None:
    assert pack(shelf, "--geometry", "parts", "--png", tmp_path / "p.png") == 0
    assert main(["view", str(parts_plan), "-o", str(tmp_path / "v.png")]) == 0
    assert (tmp_path / "v.png").read_bytes() == (tmp_path / "p.png").read_bytes()


def wrong_geometry(plan: dict[str, Any]) -> None:
    plan["settings"]["geometry"] = "hull"


def other_parts(plan: dict[str, Any]) -> None:
    plan["meshes"]["ring"]["envelope_sha256"] = "ab" * 32


def no_envelope(plan: dict[str, Any]) -> None:
    del plan["meshes"]["can"]["envelope_sha256"]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (wrong_geometry, ["geometry", "hull", "parts"]),
        (other_parts, ["ring.ply", "abababababab", "plan again"]),
        (no_envelope, ["meshes.can", "envelope_sha256"]),
    ],
)
@pytest.mark.parametrize("command", ["verify", "view", "execute"])
def test_a_plan_of_other_shapes_isrefused(
    command: str,
    edit: Callable[[dict[str, Any]], None],
    words: list[str],
    parts_plan: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    more = {"view": ["-o", str(tmp_path / "v.png")], "execute": ["--closed-loop"]}.get(command, [])
    capsys.readouterr()
    refused(capsys, main([command, str(edited(parts_plan, edit)), *more]), "edited.json", *words)


# ----------------------------------------------------------------------------------- clearance, physics


def test_a_physics_plan_tells_what_each_drop_came_to(
    physics_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = json.loads(physics_plan.read_text())
    told = {name: plan["settings"][name] for name in ("stability", "clearance", "geometry")}
    assert told == {"stability": "physics", "clearance": CLEARANCE, "geometry": "parts"}
    assert len(plan["steps"]) == 3
    for step in plan["steps"]:
        drop = step["details"]["physics"]
        assert 0.0 <= drop["shift_m"] < 0.008
        assert abs(drop["sink_m"]) < 0.008
        assert set(step["details"]) >= {"stability", "manipulation"}
    code, report = verified(physics_plan, capsys)
    assert (code, report["ok"], report["envelopes"]["ok"]) == (0, True, True)
    assert main(["execute", str(physics_plan), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["success"] is True


def test_physics_plans_are_the_same_bytes_each_time(shelf: Path, physics_plan: Path, tmp_path: Path) -> None:
    options = ["--stability", "physics", "--clearance", str(CLEARANCE), "--geometry", "parts"]
    assert pack(shelf, *options, "--out", shelf / "twice.json") == 0
    assert (shelf / "twice.json").read_bytes() == physics_plan.read_bytes()


def test_physics_takes_the_smallest_box_that_takes_all(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boxes, order = tmp_path / "boxes.csv", tmp_path / "order.csv"
    boxes.write_text(
        "box_id,length_m,width_m,height_m\nBIG,0.3,0.3,0.2\nTINY,0.09,0.09,0.09\nFAIR,0.2,0.2,0.1\n"
    )
    order.write_text("item,qty\nbrick,1\n")
    options = ["--boxes", boxes, "--stability", "physics", "--constraints", "stability", "--json"]
    capsys.readouterr()
    assert main(["pack", *map(str, [order, "--catalogue", shelf, *options])]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["container"]["name"] == "FAIR"
    assert "physics" in plan["steps"][0]["details"]


@pytest.mark.parametrize("stability", ["physics", "paper"])
def test_a_rehearsed_plan_tells_how_it_went(
    stability: str, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plan.json"
    options = ["--stability", stability, "--clearance", str(CLEARANCE), "--rehearse", "2"]
    assert pack(shelf, *options, "--out", path) == 0
    told = capsys.readouterr().out
    assert "rehearsed: success in 2 of 2 worlds; plans tried: 1" in told
    assert ("with hm (auto):" in told) == (stability == "physics")  # there auto is one rule
    plan = json.loads(path.read_text())
    assert (plan["settings"]["rehearse"], plan["settings"]["geometry"]) == (2, "parts")
    figures = {name: value for name, value in plan["metrics"].items() if name.startswith("rehearsal")}
    assert plan["made_by"] == "planner" if stability == "physics" else plan["made_by"] in MEMBERS
    assert "rehearsed_plan" not in plan["settings"]
    assert figures == {"rehearsal_worlds": 2, "rehearsal_survived": 2, "rehearsal_plans": 1}
    assert main(["execute", str(path), "--catalogue", str(shelf)]) == 0


def test_clearance_keeps_boxes_apart(shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the walls and, side by side, from each other; without it they touch the walls."""
    order = tmp_path / "order.csv"
    order.write_text("item,qty\nbrick,3\n")

    def gaps(clearance: str) -> tuple[float, float]:
        arguments = [order, "--catalogue", shelf, "--container", "0.32x0.32x0.06", "--clearance", clearance]
        capsys.readouterr()
        assert main(["pack", *map(str, arguments), "--constraints", "overlap", "--json"]) == 0
        steps = json.loads(capsys.readouterr().out)["steps"]
        lows = np.array([step["corner"][:2] for step in steps])
        highs = lows + np.array([step["extents"][:2] for step in steps])
        between = np.maximum(lows[:, None] - highs, lows - highs[:, None]).max(axis=2)
        return min(lows.min(), (0.32 - highs).min()), between[np.triu_indices(3, 1)].min()

    wall, between = gaps(str(CLEARANCE))
    assert wall >= CLEARANCE - 1e-9
    assert between >= CLEARANCE - 1e-9
    assert gaps("0")[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--clearance=-0.001"], ["clearance", "-0.001", "0.05"]),
        (["--clearance", "0.06"], ["clearance", "0.06", "0.05"]),
        (["--clearance", "nan"], ["clearance", "nan", "0.05"]),
        (["--stability", "physics", "--constraints", "overlap"], ["stability physics", "overlap", "robot"]),
        (["--rehearse", "101"], ["rehearse", "101", "100"]),
        (["--rehearse", "2", "--geometry", "mesh"], ["rehearse 2", "geometry mesh"]),
        (["--stability", "physics", "--geometry", "mesh"], ["stability physics", "geometry mesh"]),
    ],
)
def test_options_that_cannot_be_are_one_line(
    options: list[str], words: list[str], shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, pack(shelf, *options, "--out", tmp_path / "p.json"), *words)
    assert list(tmp_path.iterdir()) == []


# -------------------------------------------------------------------------------------------- execution


def test_execute_says_where_physics_knows_larger_items(
    shelf: Path, mesh_plan: Path, parts_plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    main(["execute", str(mesh_plan)])
    (line,) = capsys.readouterr().err.strip().splitlines()
    bulge = ItemCache().parts(open_catalogue(str(shelf)).item("ring")).bulge
    assert bulge > 0.0015
    assert f"ring bulges by {bulge * 1e3:.1f} mm:" in line
    assert "--geometry parts" in line
    main(["execute", str(parts_plan)])
    assert capsys.readouterr().err == ""


def test_a_closed_loop_plans_on_the_geometry_of_the_plan(
    mesh_plan: Path, parts_plan: Path, physics_plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned_on: dict[str, str] = {}
    prepare = ItemCache.prepare

    def seen(self: ItemCache, item: Item, grid: GridConfig) -> PreparedItem:
        planned_on[item.name] = item.sha256
        return prepare(self, item, grid)

    monkeypatch.setattr(ItemCache, "prepare", seen)
    envelope = "envelope_sha256"
    for path, key in ((mesh_plan, "sha256"), (parts_plan, envelope), (physics_plan, envelope)):
        planned_on.clear()
        assert main(["execute", str(path), "--closed-loop"]) == 0
        meshes = json.loads(path.read_text())["meshes"]
        assert planned_on == {name: mesh[key] for name, mesh in meshes.items()}
