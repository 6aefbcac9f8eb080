"""Executions as JSON, page and animation: what they say is what was measured."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from packenv.errors import InputError
from packenv.geometry.transforms import quaternion_to_rotation
from packenv.io.executions import execution_to_json, mean_lengths, write_execution
from packenv.robot.files import default_cell
from packenv.sim.camera import Frame
from packenv.sim.disturbance import Disturbance
from packenv.sim.session import Execution, ExecutionConfig, ItemOutcome
from packenv.types import Container, Item, Placement, Plan
from packenv.view.animation import SIZE, draw_frame, write_gif
from packenv.view.colours import item_colour
from packenv.view.execution_scene import executed_scene
from packenv.view.page import page_text
from packenv.view.stage import Stage
from tests import shapes
from tests.view.test_page import decode, near_colour, visit

CRATE, CUP = shapes.box(0.1, 0.08, 0.06, "crate"), shapes.cup(0.04, 0.08)
ITEMS: dict[str, Item] = {"crate": CRATE, "cup": CUP}
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def placement(item: Item, position: tuple[float, float, float], instance: int = 1) -> Placement:
    at = np.array(position)
    corner = item.vertices.min(axis=0) + at
    return Placement(item.name, instance, np.eye(3), at, corner, item.extents, 0, 0.0, 0.0, 1)


PLAN = Plan(
    Container(0.3, 0.3, 0.25),
    (
        placement(CRATE, (0.0, 0.0, 0.0)),
        placement(CUP, (0.2, 0.2, 0.0)),
        placement(CRATE, (0.0, 0.1, 0.0), 2),
    ),
    (),
)


def outcome(item: str, drop: float, shift: float, *, collided: bool = False) -> ItemOutcome:
    planned = next(p for p in PLAN.placements if p.item == item)
    return ItemOutcome(
        item=item,
        planned=(planned.rotation, planned.position),
        measured=(TURN, planned.position + np.array([shift, 0.0, 0.0])),
        drop_m=drop,
        shift_m=shift,
        turned_rad=np.pi / 2,
        settle_s=0.0 if collided else 0.25,
        at_rest=not collided,
        deepest_m=0.002 if collided else None,
        met="crate" if collided else "",
        collided=collided,
    )


def stopped() -> Execution:
    """The crate was placed; the cup then met it."""
    items = (outcome("crate", 0.012, 0.003), outcome("cup", -0.2, 0.5, collided=True))
    final = tuple(o.measured for o in items)
    return Execution(False, "collision", "cup met crate 2.0 mm deep", items, final, 1.5)


def test_json_tells_every_item_and_its_poses() -> None:
    document = execution_to_json(stopped(), PLAN.placements, ExecutionConfig(), plan="p.json")
    again = json.loads(json.dumps(document, allow_nan=False))
    assert (again["success"], again["cause"], again["planned"], again["placed"]) == (False, "collision", 3, 1)
    assert [(i["step"], i["item"], i["instance"]) for i in again["items"]] == [(1, "crate", 1), (2, "cup", 1)]
    for shown, measured in zip(again["items"], stopped().items, strict=True):
        assert shown["drop_m"] == measured.drop_m
        assert shown["shift_m"] == measured.shift_m
        for key, pose in (("planned", measured.planned), ("measured", measured.measured)):
            assert shown[key]["position"] == pose[1].tolist()
            assert np.abs(quaternion_to_rotation(np.array(shown[key]["quat_xyzw"])) - pose[0]).max() < 1e-12
    assert again["config"]["motion"]["settle"] == 20.0
    assert again["disturbance"] is None


def test_json_names_the_disturbance() -> None:
    document = execution_to_json(stopped(), PLAN.placements, ExecutionConfig(), Disturbance(7))
    assert document["disturbance"]["seed"] == 7


def test_means_leave_out_what_was_never_released() -> None:
    assert mean_lengths(stopped()) == (0.012, 0.003)
    assert mean_lengths(Execution(False, "collision", "", stopped().items[1:], (), 0.0)) is None


def test_a_result_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing"):
        write_execution(tmp_path / "missing" / "e.json", {})
    with pytest.raises(ValueError, match="JSON compliant"):
        write_execution(tmp_path / "e.json", {"drop_m": float("nan")})
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------------------------------------ page


def test_the_page_holds_planned_and_measured_poses() -> None:
    record, _ = decode(page_text(executed_scene(PLAN, ITEMS, stopped())))
    assert record["executed"] is True
    assert [s["measured"] is None for s in record["steps"]] == [False, False, True]
    first = np.array(record["steps"][0]["measured"]).reshape(3, 4)
    assert np.array_equal(first[:, :3], TURN)
    assert np.array_equal(first[:, 3], [0.003, 0.0, 0.0])
    assert np.array_equal(np.array(record["steps"][0]["matrix"]).reshape(3, 4)[:, :3], np.eye(3))
    assert ["Execution", "collision: cup met crate 2.0 mm deep"] in record["summary"]
    shown = [step["figures"] for step in record["steps"]]
    assert (shown[0]["Drop"], shown[0]["Shift"], shown[0]["Turned"]) == ("12.0 mm", "3.0 mm", "90.0°")
    assert shown[1]["Execution"] == "cup met crate 2.0 mm deep"
    assert "Drop" not in shown[1]
    assert "not placed" in shown[2]["Execution"]


def test_a_browser_shows_planned_poses_on_demand(tmp_path: Path) -> None:
    """The third item was never placed: it is in the picture where the reader asks for the plan."""
    page = tmp_path / "e.html"
    page.write_text(page_text(executed_scene(PLAN, ITEMS, stopped())), encoding="utf-8")
    pictures = {}
    for flag in ("0", "1"):
        root, _, picture = visit(page, f"step=3&planned={flag}", tmp_path)
        assert root["data-state"] == "ready"
        pictures[flag] = picture[110:600, 20:620]
    changed = np.abs(pictures["1"] - pictures["0"]).max(axis=2) > 8
    green = pictures["1"][..., 1] - pictures["1"][..., [0, 2]].max(axis=2) > 8
    assert (changed & green).sum() > 300
    assert near_colour(pictures["0"], item_colour(0)) > 300


# ------------------------------------------------------------------------------------------- animation


BENT = np.array([0.0, 0.3, 1.8, 0.0, 1.0, 0.0])


def lit(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    """Number of pixels with about the hue of a colour, whatever the light on them."""
    wide = picture.astype(float)
    unit = wide / np.maximum(np.linalg.norm(wide, axis=2, keepdims=True), 1.0)
    return int((unit @ (np.array(colour) / np.linalg.norm(colour)) > 0.995).sum())


def frame(count: int, joints: np.ndarray | None = None) -> Frame:
    poses = tuple((p.rotation, p.position) for p in PLAN.placements[:count])
    return Frame(float(count), joints, poses)


def test_a_frame_shows_the_items_that_are_there_and_the_robot_where_there_is_one() -> None:
    stage = Stage(default_cell().with_container(PLAN.container), SIZE)
    empty, two, robot = (draw_frame(stage, PLAN, ITEMS, f) for f in (frame(0), frame(2), frame(0, BENT)))
    assert empty.shape == (SIZE[1], SIZE[0], 3)
    for index in (0, 1):
        assert lit(empty, item_colour(index)) < 20
        assert lit(two, item_colour(index)) > 300
    assert lit(two, item_colour(2)) < 20
    arm = (238, 186, 70)
    assert lit(robot, arm) - lit(empty, arm) > 5000


def test_a_gif_holds_every_frame(tmp_path: Path) -> None:
    path = tmp_path / "e.gif"
    frames = [frame(k) for k in (0, 1, 2)]
    write_gif(path, PLAN, ITEMS, frames, "collision: cup met crate")
    with Image.open(path) as picture:
        assert (picture.format, picture.size, picture.n_frames) == ("GIF", SIZE, 3)
        picture.seek(2)
        assert picture.info["duration"] > 1000
        told = np.asarray(picture.convert("RGB"))
    before = path.read_bytes()
    write_gif(path, PLAN, ITEMS, frames, "collision: cup met crate")
    assert path.read_bytes() == before
    write_gif(path, PLAN, ITEMS, frames)
    with Image.open(path) as picture:
        picture.seek(2)
        differs = (np.asarray(picture.convert("RGB")) != told).any(axis=2)
    assert differs[-40:].any()
    assert not differs[:-40].any()
    with pytest.raises(InputError, match="missing"):
        write_gif(tmp_path / "missing" / "e.gif", PLAN, ITEMS, frames[:1])
