"""Robot files and cell files: what is read is what was written, and every mistake is named in one line."""

import copy
import json

import pytest

from packenv.errors import InputError
from packenv.robot.cell import CellSetup, Place
from packenv.robot.files import load_cell, load_robot, robot_names
from packenv.robot.gripper import Gripper
from tests.robot.sampling import KR10, ROBOTS, TX90


def changed(record, path, value):
    record = copy.deepcopy(record)
    table = record
    for key in path[:-1]:
        table = table[key]
    if value is ...:
        del table[path[-1]]
    else:
        table[path[-1]] = value
    return record


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)
def test_a_robot_file_round_trips(robot, tmp_path):
    file = tmp_path / "arm.json"
    file.write_text(json.dumps(robot.to_mapping()), encoding="utf-8")
    again = load_robot(file)
    assert again == robot
    assert hash(again) == hash(robot)
    assert again.urdf() == robot.urdf()


def test_the_robots_that_come_along():
    assert robot_names() == ["kr10_r1100", "tx90"]
    for name in robot_names():
        assert load_robot(name).name == name


def test_a_cell_round_trips(tmp_path):
    setup = CellSetup(
        KR10.with_gripper(Gripper(0.25, 0.015, 0.4, 3.0)),
        base=Place((0.1, 0.2, 0.3), 33.3),
        container=Place((0.6, -0.1, 0.05), -77.7),
        pick=Place((0.0, 0.5, 0.1), 90.0),
        friction=0.45,
        release_height=0.005,
        rim_clearance=0.02,
    )
    file = tmp_path / "cell.json"
    file.write_text(json.dumps(setup.to_mapping()), encoding="utf-8")
    assert load_cell(file) == setup
    assert load_cell(setup.to_mapping()) == setup
    assert load_cell(setup) is setup


def test_a_robot_is_named_by_word_file_or_record(tmp_path):
    (tmp_path / "arm.json").write_text(json.dumps(KR10.to_mapping()), encoding="utf-8")
    for robot in ("kr10_r1100", "arm.json", str(tmp_path / "arm.json"), KR10.to_mapping()):
        file = tmp_path / "cell.json"
        file.write_text(json.dumps({"robot": robot, "friction": 0.5}), encoding="utf-8")
        assert load_cell(file) == CellSetup(KR10, friction=0.5)
    assert load_cell(tmp_path / "arm.json") == load_cell("kr10_r1100") == CellSetup(KR10)
    assert load_cell({"robot": "tx90"}) == CellSetup(TX90)


def test_a_cells_gripper_takes_the_place_of_the_robots():
    gripper = {"length_m": 0.2, "radius_m": 0.02, "mass_kg": 0.5}
    found = load_cell({"robot": "tx90", "gripper": gripper}).robot
    assert found == TX90.with_gripper(Gripper(0.2, 0.02, 0.5))
    assert found.shapes.primitives[-1].end == (0.0, 0.0, 0.2)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (["joint"], [], "has no key 'joint'; did you mean 'joints'?"),
        (["lengths_m"], ..., "lengths_m is missing"),
        (["lengths_m", "c2"], ..., "lengths_m: c2 is missing"),
        (["lengths_m", "c2"], 0.0, "c2 is 0.0, give a number above 0"),
        (["lengths_m", "a1"], "0.1", "a1 is '0.1', give a number"),
        (["lengths_m", "a1"], float("nan"), "lengths_m.a1 is NaN, give a finite number"),
        (["lengths_m"], [1, 2], "lengths_m is [1, 2], give an object with a1"),
        (["joints"], [], "joints is [], give a list of 6"),
        (["joints", 2, "lower_rad"], 3.0, "joints[2]: upper_rad is"),
        (["joints", 2, "sign"], 2, "joints[2]: sign is 2, give 1 or -1"),
        (["joints", 2, "sign"], 1.0, "joints[2]: sign is 1.0, give 1 or -1"),
        (["joints", 2, "name"], "joint_1", "the name 'joint_1' is there twice"),
        (["joints", 2, "name"], 'a"b', "give one word"),
        (["joints", 2, "velocity_rad_s"], 0, "velocity_rad_s is 0, give a number above 0"),
        (["links", 6, "name"], "tool", "the name 'tool' is there twice"),
        (["links", 0, "shapes"], [], "shapes is [], give a list of one or more"),
        (["links", 0, "shapes", 0, "end_m"], [0, 0], "end_m is [0, 0], give three numbers"),
        (["links", 0, "shapes", 0, "end_m"], [0, 0, 0], "give another point than start_m"),
        (["links", 0, "shapes", 0, "round"], 1, "round is 1, give true or false"),
        (["links", 0, "mass_kg"], -1, "mass_kg is -1, give a number above 0"),
        (["gripper", "payload_kg"], "2", "payload_kg is '2', give a number"),
        (["gripper", "vacuum_kpa"], -60, "vacuum_kpa is -60, give a number above 0 to 101.325"),
        (["gripper", "vacuum_kpa"], 60000, "vacuum_kpa is 60000, give a number above 0 to 101.325"),
        (["gripper", "vacuum_kpa"], 0, "vacuum_kpa is 0, give a number above 0"),
        (["gripper", "safety_factor"], 0.5, "safety_factor is 0.5, give a number from 1 to 100"),
        (["gripper", "safety_factor"], "2", "safety_factor is '2', give a number from 1"),
        (["gripper", "vacuum"], 60, "has no key 'vacuum'; did you mean 'vacuum_kpa'?"),
        (["near_edge_m"], 0.1, "near_edge_m is 0.1, give at least 0.222"),
        (["source"], "", "source is '', give some text"),
    ],
)
def test_a_mistake_in_a_robot_file_is_one_line(path, value, says, tmp_path):
    file = tmp_path / "arm.json"
    file.write_text(json.dumps(changed(TX90.to_mapping(), path, value)), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_cell(file)
    assert says in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({}, "robot is missing"),
        ({"robot": "tx90", "contaner": {}}, "has no key 'contaner'; did you mean 'container'?"),
        ({"robot": "tx9"}, "did you mean 'tx90'?"),
        ({"robot": 3}, "robot is 3, give a robot's name"),
        ({"robot": "tx90", "friction": 0}, "friction is 0, give a number above 0"),
        ({"robot": "tx90", "container": {"position_m": [0, 0]}}, "container: position_m is [0, 0]"),
        ({"robot": "tx90", "container": {"yaw_deg": 3}}, "container: position_m is missing"),
        (
            {"robot": "tx90", "release_height_m": 0.02},
            "release_height_m is 0.02, give a number from 0 to rim_clearance_m, 0.01",
        ),
        ([], "give an object with robot"),
    ],
)
def test_a_mistake_in_a_cell_file_is_one_line(record, says, tmp_path):
    file = tmp_path / "cell.json"
    file.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_cell(file)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_file_and_no_json_are_named(tmp_path):
    with pytest.raises(InputError, match="is no file, give a cell file"):
        load_cell(tmp_path / "nothing.json")
    broken = tmp_path / "broken.json"
    broken.write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match="is not JSON"):
        load_cell(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not text"):
        load_cell(broken)
