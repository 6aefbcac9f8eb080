"""A robot cell on its way: command line, plan file, scripts and environment; and the page that describes it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.cli import main
from packenv.env.config import PackConfig
from packenv.geometry.transforms import quaternion_to_rotation
from packenv.items.plan_items import cell_of
from packenv.planning.options import PlanOptions
from packenv.robot.cell import CellSetup, Place
from packenv.robot.files import default_cell, load_cell
from packenv.robot.urdf import urdf_text
from tests.conftest import REPO
from tests.env_samples import COARSE, best_action, make_env
from tests.robot.sampling import KR10

BOX = "0.16x0.12x0.10"
TURNED = {
    "robot": "kr10_r1100",
    "container": {"position_m": [0.5, -0.1, 0.0], "yaw_deg": 25},
    "friction": 0.6,
}
PAGE = (REPO / "docs" / "cell.md").read_text(encoding="utf-8")


@pytest.fixture
def order(tmp_path: Path) -> Path:
    path = tmp_path / "order.csv"
    path.write_text("item,qty\nsoap_bar,1\ntuna_can,1\n")
    return path


@pytest.fixture
def turned(tmp_path: Path) -> Path:
    path = tmp_path / "turned.json"
    path.write_text(json.dumps(TURNED))
    return path


def pack(order: Path, *more: str | Path) -> tuple[int, Path]:
    out = order.parent / "plan.json"
    return main(["pack", str(order), "--container", BOX, "--out", str(out), *map(str, more)]), out


@pytest.mark.parametrize(
    "cell", ["kr10_r1100", str(REPO / "assets" / "robots" / "kr10_r1100.json"), "turned"]
)
def test_a_plan_for_another_cell_is_packed_verified_executed_and_drawn(
    order: Path, turned: Path, cell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, plan = pack(order, "--cell", turned if cell == "turned" else cell)
    assert code == 0
    assert "cell: kr10_r1100, gripper 0.3 m, holds 3.24 kg, container" in capsys.readouterr().out
    assert json.loads(plan.read_text())["settings"]["cell"]["robot"]["name"] == "kr10_r1100"
    assert main(["verify", str(plan)]) == 0
    gif = order.parent / "execution.gif"
    assert main(["execute", str(plan), "--gif", str(gif)]) == 0
    assert gif.stat().st_size > 0
    assert main(["view", str(plan), "-o", str(order.parent / "plan.gif")]) == 0


def test_a_plan_is_not_one_for_another_cell(order: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the file says of the cell is what is checked: the same joints are no way for the TX90."""
    _, path = pack(order, "--cell", "kr10_r1100")
    document = json.loads(path.read_text())
    document["settings"]["cell"] = None
    path.write_text(json.dumps(document))
    capsys.readouterr()
    assert main(["verify", str(path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["unreachable_steps"] == [1, 2]


def test_a_plan_of_before_there_were_cells_is_for_the_tx90(order: Path) -> None:
    _, path = pack(order)
    document = json.loads(path.read_text())
    assert document["settings"].pop("cell") is None
    path.write_text(json.dumps(document))
    assert main(["verify", str(path)]) == 0
    assert cell_of(rp.load_plan(path)).setup == default_cell()


def test_a_cell_that_cannot_serve_is_an_answer(order: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = order.parent / "far.json"
    far.write_text(json.dumps({"robot": "tx90", "container": {"position_m": [3.0, 0.0, 0.0]}}))
    code, plan = pack(order, "--cell", far)
    assert code == 1
    left = json.loads(plan.read_text())["leftovers"]
    assert [row["reason"] for row in left] == ["unreachable-container"] * 2
    assert "3 m away" in left[0]["detail"]
    # Its edge is within reach, so every place is asked for.
    far.write_text(json.dumps({"robot": "tx90", "container": {"position_m": [0.897, -0.1, 0.0]}}))
    assert pack(order, "--cell", far)[0] == 1
    left = json.loads(plan.read_text())["leftovers"]
    assert [row["rejections"]["unreachable"] > 0 for row in left] == [True, True]


def test_a_wrong_cell_is_one_line_and_code_2(order: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = order.parent / "wrong.json"
    wrong.write_text(json.dumps({"robot": "tx90", "fricton": 1}))
    assert pack(order, "--cell", wrong)[0] == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "wrong.json has no key 'fricton'; did you mean 'friction'?" in error
    assert pack(order, "--cell", "tx99")[0] == 2
    assert "did you mean 'tx90'?" in capsys.readouterr().err


def test_a_script_gives_a_cell_in_any_way(tmp_path: Path) -> None:
    box, given = rp.Container(0.16, 0.12, 0.10), rp.Order.of("soap_bar")
    cells: list[Any] = ["kr10_r1100", KR10.to_mapping(), {"robot": "kr10_r1100"}, rp.load_cell("kr10_r1100")]
    plans = [rp.plan(given, box, cell=cell) for cell in cells]
    joints = [plan.placements[0].path.joints for plan in plans if plan.placements[0].path is not None]
    assert len(joints) == len(cells)
    for found in joints:
        np.testing.assert_array_equal(found, joints[0])
    rp.save_plan(plans[0], tmp_path / "plan.json")
    assert cell_of(rp.load_plan(tmp_path / "plan.json")).setup == CellSetup(KR10)
    assert rp.verify(plans[0]).ok


def test_the_usual_cell_by_name_is_none() -> None:
    assert PlanOptions(cell="tx90") == PlanOptions()  # type: ignore[arg-type]
    assert PlanOptions(cell=load_cell("tx90")).to_mapping()["cell"] is None
    assert PlanOptions().setup == default_cell()


def test_friction_is_the_cells_in_planning() -> None:
    """The bowl is leant on what lies there, and friction alone holds it; where there is less, it goes elsewhere."""
    slippery = replace(default_cell(), friction=0.2)
    order, box = rp.Order.of("pitcher", "spray_bottle", "power_drill", "bowl"), rp.Container(0.32, 0.32, 0.30)
    rough, smooth = (
        rp.plan(order, box, heuristic="hm", places="grid", stability="paper", sequence="given", cell=cell)
        for cell in (None, slippery)
    )
    assert rp.verify(rough).ok
    assert rp.verify(smooth).ok
    claimed = replace(rough, settings={**rough.settings, "cell": slippery.to_mapping()}, made_with=None)
    assert rp.verify(claimed).recheck.unstable_steps == (4,)


def test_physics_has_the_robot_where_the_planner_has_it(engine: str) -> None:
    from packenv.sim.engines import engine_config
    from packenv.sim.robot_model import RobotModel
    from packenv.sim.world import World, WorldConfig

    cell = load_cell(TURNED).with_container(rp.Container(0.16, 0.12, 0.10))
    joints = np.array([0.2, -1.4, 1.9, 0.3, 0.9, -2.0])
    with World(cell.container, WorldConfig(engine=engine_config(engine))) as world:
        robot = RobotModel(world, cell)
        robot._place(joints, rods := [*robot._arm_rods(), robot._gripper])
        frames = KR10.link_frames(joints)
        links = [p for p in KR10.shapes.primitives if p.link >= 2]
        for rod, primitive in zip(rods, links, strict=True):
            at, turn = world.engine.pose(rod.body)
            half = np.linalg.norm(np.subtract(primitive.end, primitive.start)) / 2.0
            axis = quaternion_to_rotation(turn)[:, 2]
            for end, point in ((-half, primitive.start), (half, primitive.end)):
                there = frames[primitive.link, :3, :3] @ point + frames[primitive.link, :3, 3]
                np.testing.assert_allclose(at + end * axis, cell.to_container(there), atol=1e-6)


def test_friction_is_the_cells_in_physics() -> None:
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.session import ExecutionConfig

    usual, smooth = (ExecutionConfig.of(CellSetup(KR10, friction=mu)) for mu in (0.7, 0.35))
    assert usual == ExecutionConfig()
    assert smooth.world.mu == 0.35
    drawn = [Disturbance(3).config(config).world.mu for config in (usual, smooth)]
    assert drawn[1] == pytest.approx(drawn[0] / 2)


def test_the_environment_is_of_its_cell() -> None:
    config = PackConfig.from_mapping({"cell": TURNED, "grid": COARSE})
    assert PackConfig.from_mapping(json.loads(json.dumps(config.to_mapping()))) == config
    assert config.cell == load_cell(TURNED)
    assert hash(config) == hash(PackConfig.from_mapping({"cell": TURNED, "grid": COARSE}))
    assert PackConfig.from_mapping({"cell": "tx90"}) == PackConfig()
    with pytest.raises(rp.InputError, match="did you mean 'tx90'"):
        PackConfig.from_mapping({"cell": "tx9"})


@pytest.mark.parametrize("physics", [False, True])
def test_an_episode_in_another_cell_is_a_plan_for_it(physics: bool) -> None:
    env = make_env(cell=TURNED, physics=physics)
    obs, _ = env.reset(seed=0)
    for _ in range(3):
        obs, _, ended, _, _ = env.step(best_action(obs, "dblf"))
        if ended:
            break
    plan = env.plan()
    assert cell_of(plan).setup == load_cell(TURNED)
    assert plan.placements
    if not physics:
        assert rp.verify(plan).recheck.ok
    env.close()


def keys_between(name: str) -> list[str]:
    """First words of a table's rows, more than one where a row names more."""
    rows = PAGE.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0].splitlines()
    return [key for row in rows if row.startswith("| `") for key in re.findall(r"`(\w+)`", row.split("|")[1])]


def nested(value: Any) -> set[str]:
    if isinstance(value, dict):
        return set(value).union(*map(nested, value.values()))
    return set().union(*map(nested, value)) if isinstance(value, list) else set()


def test_the_page_has_a_row_for_every_key() -> None:
    setup = CellSetup(KR10, container=Place(), pick=Place())
    assert set(keys_between("cell keys")) == {*setup.to_mapping(), "gripper"}
    assert keys_between("robot keys") == list(KR10.to_mapping())
    assert [key for key in nested(setup.to_mapping()) if f"`{key}`" not in PAGE] == []


def test_the_pages_example_is_a_cell() -> None:
    example = json.loads(PAGE.split("```json\n")[1].split("```")[0])
    assert load_cell(example).robot.gripper.heaviest == pytest.approx(0.961, abs=1e-3)


def test_the_pages_lengths_are_the_files() -> None:
    for robot in (default_cell().robot, KR10):
        row = next(line for line in PAGE.splitlines() if line.startswith("|") and robot.title[-6:] in line)
        told = [float(cell.replace("−", "-")) for cell in row.split("|")[2:9]]
        assert told == list(vars(robot.lengths).values())  # type: ignore[union-attr]


def test_the_urdf_is_printed() -> None:
    import subprocess
    import sys

    command = [sys.executable, "-m", "packenv.robot.urdf", "kr10_r1100"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == urdf_text(KR10)
