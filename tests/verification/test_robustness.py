"""What piles withstand, from a plan to its file, its page and ``verify``: the same figures, and no lie believed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import packenv as rp
from packenv.cli import main
from packenv.geometry.transforms import axis_rotation
from packenv.io.plans import read_plan, write_plan
from packenv.planning.robustness import LARGEST_TILT, Robustness, least_of, measure_robustness
from packenv.planning.search.offsets import LARGEST_OFFSET
from packenv.types import Container, Plan
from packenv.view.page import page_text
from packenv.view.show import scene_of
from tests.shelf_samples import shelf_of
from tests.verification.test_stability_and_reach import BOX, GRID, MESHES

SIDE = 0.05
CUBES = {"cube": trimesh.creation.box((SIDE, SIDE, SIDE))}
ROOM = Container(0.3, 0.3, 0.2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Items, and a plan of an order of them."""
    folder = tmp_path_factory.mktemp("items")
    trimesh.creation.box((0.10, 0.08, 0.04)).export(folder / "brick.ply")
    trimesh.creation.cylinder(0.03, 0.07, sections=24).export(folder / "can.ply")
    (folder / "objects.csv").write_text("name,file,mass_kg\nbrick,brick.ply,0.3\ncan,can.ply,0.2\n")
    (folder / "order.csv").write_text("item,qty\nbrick,2\ncan,2\n")
    words = ["order.csv", "--container", "0.2x0.14x0.2", "--out", "plan.json", "--constraints", "stability"]
    paths = [str(folder / w) if w.endswith((".csv", ".json")) else w for w in words]
    assert main(["pack", *paths, "--catalogue", str(folder), "--heuristic", "minz"]) == 0
    return folder


@pytest.fixture(scope="module")
def plan(folder: Path) -> Plan:
    return read_plan(folder / "plan.json")


def stated(plan: Plan) -> list[dict[str, Any]]:
    return [dict(p.details["robustness"]) for p in plan.placements]  # type: ignore[call-overload]


def cubes_at(*corners: tuple[float, float, float], turn: float = 0.0) -> Plan:
    """A plan of cubes at hand-made places."""
    made = rp.plan(rp.Order.of("cube"), ROOM, rp.load_catalogue(CUBES), constraints="stability")
    half = SIDE / 2
    rotation = axis_rotation(2, turn)
    placements = tuple(
        replace(
            made.placements[0],
            instance=k,
            rotation=rotation,
            position=np.array(corner) + half,
            corner=np.array(corner),
        )
        for k, corner in enumerate(corners, start=1)
    )
    return replace(made, placements=placements, order=(rp.OrderLine("cube", len(corners)),))


def measured(plan: Plan) -> list[Robustness]:
    return list(rp.verify(plan).robustness.values())


# Closed forms and laws on real contacts ------------------------------------------------------------------


def test_a_lone_cube_slides_and_one_in_the_middle_may_be_off_as_far_as_is_told():
    (found,) = measured(cubes_at((0.125, 0.125, 0.0)))
    assert found.tilt_deg == pytest.approx(np.degrees(np.arctan(0.7)), abs=0.01)
    assert found.push == pytest.approx(0.7, abs=1e-3)
    assert found.offset_m == LARGEST_OFFSET


def test_a_tower_tips_over_its_edge():
    tower = measured(cubes_at(*((0.125, 0.125, k * SIDE) for k in range(3))))
    for n, found in enumerate(tower, start=1):
        # Contacts are where surfaces are within 1.5 mm, so the edge is no farther out than that.
        assert np.tan(np.radians(found.tilt_deg)) == pytest.approx(min(0.7, 1.0 / n), rel=0.03)


def test_a_gap_to_a_wall_is_the_offset_to_a_cell_and_what_is_on_top_may_be_off():
    for gap in (0.0, 0.003, 0.0065, 0.012):
        first, second = measured(cubes_at((gap, 0.1, 0.0), (gap, 0.1, SIDE)))
        assert gap - 0.002 < first.offset_m <= gap + 1e-9
        assert second.offset_m == first.offset_m  # of the wall again: what is beneath is below the release


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_pile_has_the_same_figures(axis):
    corners = [(0.02, 0.05, 0.0), (0.075, 0.05, 0.0), (0.05, 0.06, SIDE), (0.2, 0.2, 0.0)]
    over = [tuple(0.3 - SIDE - v if i == axis else v for i, v in enumerate(c)) for c in corners]
    for one, other in zip(measured(cubes_at(*corners)), measured(cubes_at(*over)), strict=True):
        assert one.tilt_deg == pytest.approx(other.tilt_deg, abs=0.5)
        assert one.push == pytest.approx(other.push, abs=0.01)
        assert one.offset_m == pytest.approx(other.offset_m, abs=0.0021)


def test_what_floats_withstands_nothing_from_its_step_on():
    found = measured(cubes_at((0.0, 0.0, 0.0), (0.1, 0.1, 0.05), (0.2, 0.2, 0.0)))
    assert found[0].tilt_deg > 30.0
    assert [(f.tilt_deg, f.push) for f in found[1:]] == [(0.0, 0.0)] * 2


def test_an_item_outside_has_no_offset():
    found = measured(cubes_at((0.0, 0.0, 0.0), (0.28, 0.1, 0.0)))
    assert found[1].offset_m == 0.0


def test_a_placement_with_clearance_may_be_off_by_that():
    meshes = rp.load_catalogue({name: item.to_trimesh() for name, item in MESHES.items()})
    made = rp.plan(
        rp.Order.of("brick", "can", "book", "cup"), BOX, meshes, constraints="stability", clearance=0.006
    )
    told = [
        (float(p.details["clearance_m"]), s["offset_m"])
        for p, s in zip(made.placements, stated(made), strict=True)
    ]  # type: ignore[arg-type]
    assert max(clearance for clearance, _ in told) >= 0.006
    for clearance, offset in told:
        assert offset >= clearance - 1e-9


# From the plan to verify ---------------------------------------------------------------------------------


def test_every_step_and_the_least_of_all_are_in_the_plan(plan):
    rows = stated(plan)
    assert len(rows) == 4
    for row in rows:
        assert list(row) == ["tilt_deg", "push", "offset_m"]
        assert 0.0 < row["tilt_deg"] <= LARGEST_TILT
        assert 0.0 < row["push"] <= 1.0
        assert 0.0 <= row["offset_m"] <= LARGEST_OFFSET
    for name in rows[0]:
        assert plan.metrics[f"min_{name}"] == min(row[name] for row in rows)


def test_verify_finds_what_the_plan_says_from_the_file_and_in_memory(folder, plan, capsys):
    capsys.readouterr()
    assert main(["verify", str(folder / "plan.json"), "--catalogue", str(folder), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [row.pop("step") for row in report["robustness"]] == [1, 2, 3, 4]
    assert report["robustness"] == stated(plan)
    assert {name: report[name] for name in plan.metrics if name.startswith("min_")} == {
        name: value for name, value in plan.metrics.items() if name.startswith("min_")
    }
    assert "details.robustness" not in report["not_checked"]


def test_rounding_of_a_file_changes_no_figure(folder, plan, tmp_path):
    write_plan(tmp_path / "again.json", replace(plan, catalogue=str(folder)))
    again = read_plan(tmp_path / "again.json")
    assert least_of(rp.verify(again, folder).robustness.values()) == least_of(
        rp.verify(plan, folder).robustness.values()
    )


@pytest.mark.parametrize(
    ("lie", "where"),
    [
        (lambda d: row(d, 1).update(tilt_deg=45.0), "steps[1].details.robustness.tilt_deg"),
        (lambda d: row(d, 0).update(push=1.0), "steps[0].details.robustness.push"),
        (lambda d: row(d, 3).update(offset_m=0.05), "steps[3].details.robustness.offset_m"),
        (lambda d: row(d, 2).update(tilt_deg="much"), "steps[2].details.robustness.tilt_deg"),
        (lambda d: d["metrics"].update(min_tilt_deg=45.0), "metrics.min_tilt_deg"),
        (lambda d: d["metrics"].update(min_push=2), "metrics.min_push"),
        (lambda d: d["metrics"].update(min_offset_m=None), "metrics.min_offset_m"),
    ],
)
def test_a_plan_that_says_more_is_found(
    folder: Path, lie: Callable[[dict[str, Any]], object], where: str, tmp_path, capsys
):
    code, report = verified(folder, lie, tmp_path, capsys)
    assert code == 1
    assert [claim["where"] for claim in report["misstated_claims"]] == [where]


def test_a_plan_that_says_less_or_nothing_is_believed(folder, tmp_path, capsys):
    def modest(document: dict[str, Any]) -> None:
        row(document, 1).update(tilt_deg=1.0, push=0.01)
        document["steps"][0]["details"].pop("robustness")
        document["steps"][2]["details"]["robustness"] = "strong"
        del document["metrics"]["min_push"]

    code, report = verified(folder, modest, tmp_path, capsys)
    assert code == 0
    assert len(report["robustness"]) == 4


def row(document: dict[str, Any], step: int) -> dict[str, Any]:
    found: dict[str, Any] = document["steps"][step]["details"]["robustness"]
    return found


def verified(folder, lie, tmp_path, capsys) -> tuple[int, dict[str, Any]]:
    document = json.loads((folder / "plan.json").read_text())
    lie(document)
    path = tmp_path / "tampered.json"
    path.write_text(json.dumps(document))
    capsys.readouterr()
    code = main(["verify", str(path), "--catalogue", str(folder), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_words_for_people_tell_each_step_and_the_least(folder, plan, capsys):
    capsys.readouterr()
    main(["verify", str(folder / "plan.json"), "--catalogue", str(folder)])
    told = capsys.readouterr().out
    assert [f"step  {k} takes a tilt of" in told for k in (1, 2, 3, 4)] == [True] * 4
    assert f"every step takes a tilt of {plan.metrics['min_tilt_deg']:.1f}°" in told


def test_the_page_shows_each_step_and_the_least(folder, plan):
    scene = scene_of(plan, folder)
    for step, row_of in zip(scene.steps, stated(plan), strict=True):
        assert str(step.figures["Pile takes tilt"]).startswith(f"{row_of['tilt_deg']:.1f}°")
        assert "of its weight" in str(step.figures["Pile takes push"])
        assert "mm" in str(step.figures["Item may be off"])
    assert json.dumps(f"{plan.metrics['min_tilt_deg']:.1f}° tilt")[:-1] in page_text(scene)
    odd = replace(scene, metrics={"min_tilt_deg": "much"})
    assert "Pile takes tilt" in page_text(odd)  # of the steps


# Where nothing is asked ----------------------------------------------------------------------------------


def test_no_figures_without_force_balance_or_margins():
    order, catalogue = rp.Order.of("cube"), rp.load_catalogue(CUBES)
    for words in ({"constraints": "overlap"}, {"constraints": "stability", "margins": False}):
        made = rp.plan(order, ROOM, catalogue, **words)  # type: ignore[arg-type]
        assert "robustness" not in made.placements[0].details
        assert not any(name.startswith("min_") for name in made.metrics)
        assert len(rp.verify(made).robustness) == (words["constraints"] != "overlap")


def test_what_lay_there_before_has_no_figures_and_carries_as_the_floor_does():
    catalogue = rp.load_catalogue(CUBES)
    first = rp.plan(
        rp.Order.of("cube", "cube"), Container(0.11, 0.06, 0.2), catalogue, constraints="stability"
    )
    both = rp.plan(rp.Order.of("cube"), None, catalogue, start=first, constraints="stability")
    assert both.lying == 2
    assert [("robustness" in p.details) for p in both.placements[2:]] == [True]
    assert list(rp.verify(both).robustness) == [3]
    (found,) = rp.verify(both).robustness.values()
    assert found.tilt_deg == pytest.approx(np.degrees(np.arctan(0.7)), abs=1.0)


def test_measured_on_the_shelf_as_on_the_catalogue():
    shelf = shelf_of(MESHES, GRID)
    options = rp.PlanOptions(grid=GRID, constraints="stability")
    made = rp.plan(rp.Order.of("brick"), BOX, shelf, options)
    again = measure_robustness(made, shelf.shapes, shelf.fields, options)
    assert least_of(again.values()) == {
        name: value for name, value in made.metrics.items() if name.startswith("min_")
    }
