"""What is too heavy for the cup is left over, and a plan that says otherwise is not believed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

import packenv as rp
from packenv.robot.files import default_cell
from packenv.robot.gripper import Gripper
from packenv.robot.opw import gripper_to_mapping
from packenv.robot.records import gripper_from

BOX = rp.Container(0.2, 0.2, 0.2)


def catalogue(folder: Path, mass: float) -> Path:
    """A folder with a block of 6 cm of this mass, kg."""
    trimesh.creation.box((0.06, 0.06, 0.06)).export(folder / "block.stl")
    (folder / "objects.csv").write_text(f"name,file,mass_kg\nblock,block.stl,{mass!r}\n")
    return folder


def planned(folder: Path, mass: float, payload: float | None = None) -> rp.Plan:
    cell = default_cell()
    robot = cell.robot.with_gripper(replace(cell.robot.gripper, payload=payload))
    return rp.plan(rp.Order.of("block"), BOX, catalogue(folder, mass), cell=replace(cell, robot=robot))


@pytest.mark.parametrize("radius", [0.005, 0.01, 0.03])
def test_air_carries_its_pressure_times_the_cups_area(radius: float) -> None:
    assert Gripper(radius=radius).heaviest == pytest.approx(101_325 * math.pi * radius**2 / 9.81, rel=1e-12)
    assert Gripper(radius=radius, payload=1.5).heaviest == 1.5


def test_less_vacuum_and_a_safety_factor_hold_in_proportion() -> None:
    full = Gripper()
    assert full.heaviest == pytest.approx(3.245, abs=1e-3)
    record = gripper_to_mapping(full)
    assert set(record) == {"length_m", "radius_m", "mass_kg", "payload_kg"}
    # 60 kPa on 20 mm are 18.85 N: with a factor of 2, 0.961 kg.
    made = gripper_from(record | {"vacuum_kpa": 60, "safety_factor": 2}, "arm.json: gripper")
    assert made.heaviest == pytest.approx(18.850 / 9.81 / 2.0, rel=1e-4)
    assert gripper_from(gripper_to_mapping(made), "again") == made
    for vacuum, safety in ((101.325, 4.0), (20.0, 1.0), (75.5, 2.5)):
        made = gripper_from(record | {"vacuum_kpa": vacuum, "safety_factor": safety}, "arm.json: gripper")
        assert made.heaviest == pytest.approx(full.heaviest * vacuum / 101.325 / safety, rel=1e-12)
        assert replace(made, payload=5.0).heaviest == 5.0
        assert gripper_from(gripper_to_mapping(made), "again") == made


def test_a_cell_file_says_how_the_cup_holds(tmp_path: Path) -> None:
    gripper = {"length_m": 0.3, "radius_m": 0.01, "mass_kg": 0.25, "vacuum_kpa": 60, "safety_factor": 2}
    cell = rp.load_cell({"robot": "tx90", "gripper": gripper})
    order = rp.Order.of("block")
    plan = rp.plan(order, BOX, catalogue(tmp_path, 0.95), cell=cell)
    assert plan.complete
    assert plan.settings["cell"]["robot"]["gripper"]["safety_factor"] == 2.0
    assert rp.verify(plan, tmp_path).ok
    heavier = catalogue(tmp_path, 0.97)
    (left,) = rp.plan(order, BOX, heavier, cell=cell).leftovers
    assert left.reason == "too-heavy"
    assert "0.961 kg" in left.detail
    assert not rp.verify(plan, heavier).ok


@pytest.mark.parametrize("payload", [None, 0.5, 5.0])
def test_the_limit_decides_and_nothing_else(payload: float | None, tmp_path: Path) -> None:
    # 31.8 N at full vacuum on 20 mm.
    most = 31.83 / 9.81 if payload is None else payload
    for mass in (0.1, 0.99 * most):
        assert planned(tmp_path, mass, payload).complete
    plan = planned(tmp_path, 1.01 * most, payload)
    (left,) = plan.leftovers
    assert left.reason == "too-heavy"
    assert f"{1.01 * most:.3g} kg" in left.detail
    assert f"{most:.3g} kg" in left.detail


def test_without_a_robot_nothing_is_too_heavy(tmp_path: Path) -> None:
    heavy = catalogue(tmp_path, 60.0)
    assert rp.plan(rp.Order.of("block"), BOX, heavy, constraints="stability").complete


def test_verify_does_not_believe_that_a_cup_holds_more(tmp_path: Path) -> None:
    plan = planned(tmp_path, 1.0, 2.0)
    assert rp.verify(plan, tmp_path).ok
    rp.save_plan(plan, tmp_path / "p.json")
    document = json.loads((tmp_path / "p.json").read_text())
    document["settings"]["cell"]["robot"]["gripper"]["payload_kg"] = 0.5
    (tmp_path / "p.json").write_text(json.dumps(document))
    told = rp.load_plan(tmp_path / "p.json", tmp_path)
    assert rp.verify(told, tmp_path).recheck.unreachable_steps == (1,)
