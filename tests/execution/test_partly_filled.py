"""A box that is not empty: what lies there stays, what comes goes around and onto it, and the whole is a plan."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.cli import main
from packenv.config import GridConfig
from packenv.geometry.transforms import rotation_to_quaternion
from packenv.io.plans import plan_to_json
from packenv.items.catalogue import Catalogue
from packenv.types import Container, Order
from tests.cli.refusals import refused
from tests.mesh_samples import write_three
from tests.shapes import box, cup

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
BOX = Container(0.22, 0.18, 0.14)
_SIZES = np.random.default_rng(5).integers(2, 11, (12, 3)) * 0.01
ITEMS = {f"b{k:02}": box(*size, f"b{k:02}") for k, size in enumerate(_SIZES.tolist())}
NAMES = [*sorted(ITEMS), "cup", "cup"]
CATALOGUE = Catalogue.of_items({**ITEMS, "cup": cup(0.03, 0.06, name="cup")})


def planned(*names: str, start: Any = None, **words: Any) -> rp.Plan:
    words = {"grid": GRID, "constraints": "overlap", "sequence": "given", **words}
    return rp.plan(Order.of(*names), None if start else BOX, CATALOGUE, start=start, **words)


def drawn(seed: int, count: int) -> list[str]:
    return [str(name) for name in np.random.default_rng(seed).choice(NAMES, count)]


def where(plan: rp.Plan) -> list[tuple[str, bytes, bytes]]:
    return [(p.item, p.rotation.tobytes(), p.position.tobytes()) for p in plan.placements]


@pytest.mark.parametrize("heuristic", ["minz", "hm", "dblf", "mta"])
@pytest.mark.parametrize("seed", range(4))
def test_two_more_items_go_where_they_would_have_gone_at_once(seed: int, heuristic: str) -> None:
    """With exact heights and places: nesting cups and flush boxes."""
    names = drawn(seed, 7)
    whole = planned(*names, heuristic=heuristic, restarts=0)
    # Items that found no place at first come back in the end: then the sequences differ.
    assert [p.item for p in whole.placements] == names
    first = planned(*names[:5], heuristic=heuristic, restarts=0)
    rest = planned(*names[5:], start=first, heuristic=heuristic, restarts=0)
    assert where(rest) == where(whole)
    assert rest.lying == 5
    assert rest.metrics["utilization"] == pytest.approx(whole.metrics["utilization"])
    assert rp.verify(rest, CATALOGUE).ok


@pytest.mark.parametrize("constraints", ["stability", "robot"])
def test_what_is_packed_onto_a_plan_verifies(constraints: str) -> None:
    first = planned("b03", "cup", "b05", constraints=constraints)
    made = planned("cup", "b01", "b02", start=first, constraints=constraints)
    assert made.complete
    assert made.lying == 3
    assert where(made)[:3] == where(first)
    assert all(p.path is None for p in made.placements[:3])
    assert Counter(line.item for line in made.order for _ in range(line.qty)) == Counter(
        ["b03", "cup", "b05", "cup", "b01", "b02"]
    )
    assert sorted(p.instance for p in made.placements if p.item == "cup") == [1, 2]
    assert rp.verify(made, CATALOGUE).ok
    again = planned("cup", start=made, constraints=constraints)
    assert again.lying == 6
    assert rp.verify(again, CATALOGUE).ok


def test_measured_items_are_in_the_way_where_they_lie() -> None:
    first = planned("b03", "cup")
    shift = np.array([0.0313, 0.0271, 0.0])
    measured = [(p.item, rp.Pose(p.rotation, p.position + shift)) for p in first.placements[:1]]
    made = planned("b01", "b02", start=rp.PartlyFilled(BOX, tuple(measured)))
    assert made.lying == 1
    np.testing.assert_array_equal(made.placements[0].position, first.placements[0].position + shift)
    np.testing.assert_allclose(made.placements[0].corner, first.placements[0].corner + shift, atol=1e-12)
    assert rp.verify(made, CATALOGUE).ok
    assert made.complete


def test_nothing_in_the_box_is_an_empty_box() -> None:
    empty = planned("b01", "b02", start=rp.PartlyFilled(BOX, ()))
    assert where(empty) == where(planned("b01", "b02"))
    assert empty.lying == 0


def test_what_lies_there_counts_for_what_the_box_may_hold() -> None:
    light = replace(BOX, max_kg=1.5 * ITEMS["b03"].mass)
    start = rp.PartlyFilled(light, (("b03", rp.Pose(np.eye(3), np.zeros(3))),))
    made = planned("b03", start=start)
    assert [left.reason for left in made.leftovers] == ["box-overweight"]


def test_a_rehearsed_plan_starts_from_what_lies_there() -> None:
    first = planned("b03", constraints="robot", geometry="parts")
    made = planned("b01", start=first, constraints="robot", rehearse=1, heuristic="minz")
    assert made.lying == 1
    assert made.metrics["rehearsal_worlds"] == 1
    assert rp.execute(made, CATALOGUE).success


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda first: rp.plan(Order.of("b01")), ("container is None", "start from")),
        (
            lambda first: rp.plan(Order.of("b01"), Container(0.2, 0.2, 0.2), start=first),
            ("items lie in", "leave"),
        ),
        (lambda first: rp.plan(Order.of("b01"), start=first, catalogue="builtin"), ("is not in",)),
        (lambda first: rp.plan(Order.of("nobody"), start=first), ("nobody",)),
        (
            lambda first: rp.PartlyFilled.of_plan(first, [("cup", first.placements[0].pose)]),
            ("step 1", "b03"),
        ),
    ],
)
def test_a_start_that_cannot_be_is_refused(call: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(rp.InputError) as problem:
        call(planned("b03", "cup"))
    assert "\n" not in str(problem.value)
    for word in words:
        assert word in str(problem.value)


def test_a_start_of_another_mesh_is_refused() -> None:
    other = Catalogue.of_items({**ITEMS, "b03": box(0.03, 0.03, 0.03, "b03")})
    with pytest.raises(rp.InputError, match="is not the mesh that the plan was made of"):
        rp.plan(Order.of("b01"), start=planned("b03"), catalogue=other)


# --------------------------------------------------------------------------------- command line


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_three(tmp_path)
    (tmp_path / "order.csv").write_text("item\nbook\nbrick\n")
    (tmp_path / "more.csv").write_text("item\ncan\nbrick\n")
    return tmp_path


def pack(order: Path, *words: object) -> int:
    return main(["pack", str(order), "--constraints", "stability", *map(str, words)])


@pytest.fixture
def first(folder: Path, capsys: pytest.CaptureFixture[str]) -> rp.Plan:
    """A plan in ``first.json``, and its items a centimetre off in ``poses.json`` and, with the box, in ``box.json``."""
    size = ["--container", "0.2x0.2x0.12", "--catalogue", folder]
    assert pack(folder / "order.csv", *size, "--out", folder / "first.json") == 0
    capsys.readouterr()
    plan = rp.load_plan(folder / "first.json")
    poses = [
        {
            "item": p.item,
            "position": np.add(p.position, (0.01, 0.01, 0.0)).tolist(),
            "quat_xyzw": rotation_to_quaternion(p.rotation).tolist(),
        }
        for p in plan.placements
    ]
    (folder / "poses.json").write_text(json.dumps(poses))
    document = {"container": {"size": [0.2, 0.2, 0.12]}, "items": poses}
    (folder / "box.json").write_text(json.dumps(document))
    return plan


def test_the_command_line_starts_from_a_plan_and_from_measured_poses(
    folder: Path, first: rp.Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    starts = {
        "plan": ["--start", folder / "first.json"],
        "measured": ["--start", folder / "first.json", "--measured", folder / "poses.json"],
        "bare": ["--start", folder / "box.json", "--catalogue", folder],
    }
    for name, words in starts.items():
        out = folder / f"{name}-next.json"
        assert pack(folder / "more.csv", *words, "--out", out) == 0
        assert main(["verify", str(out)]) == 0
        assert main(["view", str(out), "-o", str(folder / f"{name}.png")]) == 0
        made = rp.load_plan(out)
        assert made.lying == 2
        assert len(made.placements) == 4
        shift = 0.0 if name == "plan" else 0.01
        moved = made.placements[0].position - first.placements[0].position
        np.testing.assert_allclose(moved, [shift, shift, 0.0], atol=1e-12)
    measured, bare = (json.loads((folder / f"{name}-next.json").read_text()) for name in ("measured", "bare"))
    assert [s["position"] for s in measured["steps"]] == [s["position"] for s in bare["steps"]]
    assert "packed 4 of 4 items" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--measured", "poses.json"], ["--start"]),
        (["--start", "first.json", "--boxes-max", "2"], ["--boxes-max", "--start"]),
        (["--start", "box.json", "--measured", "poses.json", "--catalogue", "."], ["box.json", "itself"]),
        (["--start", "first.json", "--container", "0.3x0.2x0.12"], ["items lie in 0.2x0.2x0.12"]),
        (["--start", "first.json", "--catalogue", "builtin"], ["name its folder by --catalogue"]),
        (["--start", "first.json", "--out", "first.json"], ["--out", "which is read"]),
        (
            ["--start", "first.json", "--measured", "poses.json", "--out", "poses.json"],
            ["--out", "which is read"],
        ),
        (["--start", "first.json", "--measured", "bad.json"], ["bad.json", "items[0].position"]),
        (["--start", "first.json", "--measured", "order.csv"], ["order.csv", "JSON"]),
        (["--start", "none.json"], ["none.json"]),
    ],
)
def test_starts_that_cannot_be_are_one_line(
    words: list[str], told: list[str], folder: Path, first: rp.Plan, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    bad = [{"item": "brick", "position": [0, 0], "quat_xyzw": [0, 0, 0, 1]}]
    (folder / "bad.json").write_text(json.dumps(bad))
    order = "order.csv" if "builtin" not in words else "kitchen.csv"
    (folder / "kitchen.csv").write_text("item\nmug\n")
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    refused(capsys, pack(Path(order), *words), *told)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_a_plan_says_the_same_to_a_script_and_on_the_command_line(
    folder: Path, first: rp.Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pack(folder / "more.csv", "--start", folder / "first.json", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    order = rp.load_order(folder / "more.csv", str(folder))
    made = rp.plan(order, start=rp.load_plan(folder / "first.json"), constraints="stability")
    assert json.loads(json.dumps(plan_to_json(made))) == printed
