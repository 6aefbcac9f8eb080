"""The one way from an order to a plan, as a script takes it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import packenv as rp
from packenv import api
from packenv.cli import main
from packenv.config import GridConfig
from packenv.io.containers import read_boxes
from packenv.io.plans import plan_to_json
from packenv.planning.options import PlanOptions
from tests.conftest import REPO
from tests.memory_samples import BOX, COARSE, ORDER, QUICK, meshes
from tests.mesh_samples import write_three


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three items and an order of all of them."""
    folder = tmp_path_factory.mktemp("items")
    write_three(folder)
    (folder / "order.csv").write_text("item,qty\nbrick,1\nbook,1\ncan,1\n")
    return folder


@pytest.fixture(scope="module")
def catalogue() -> rp.Catalogue:
    return rp.load_catalogue(meshes())


@pytest.fixture(scope="module")
def plan(catalogue: rp.Catalogue) -> rp.Plan:
    """A plan for a robot, of items in memory."""
    return rp.plan(ORDER, BOX, catalogue, **QUICK)


def document(plan: rp.Plan) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(plan_to_json(plan)))
    return found


def told(problem: pytest.ExceptionInfo[rp.InputError], *words: str) -> None:
    """One line that has all of these words."""
    message = str(problem.value)
    assert "\n" not in message
    for word in words:
        assert word in message


# ------------------------------------------------------------------------------------------- the way


def test_the_lines_of_the_docstring_run(tmp_path: Path) -> None:
    doc = api.__doc__ or ""
    lines = textwrap.dedent(doc.split("::", 1)[1])
    assert len([line for line in lines.splitlines() if line.strip()]) == 7
    done = subprocess.run(
        [sys.executable, "-c", lines], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**__import__("os").environ, "PYTHONPATH": str(REPO)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "plan.html").read_text().lower().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--rehearse", "0"], {}),
        (["--rehearse", "2"], {"rehearse": 2}),
        (["--constraints", "overlap", "--heuristic", "random", "--seed", "3"],
         {"constraints": "overlap", "heuristic": "random", "seed": 3}),
        (["--preset", "paper", "--constraints", "stability", "--max-checked", "7", "--tie-break", "0.5"],
         {"constraints": "stability", "max_checked": 7, "tie_break": 0.5}),
    ],
    ids=["default", "rehearsed", "overlap", "paper"],
)  # fmt: skip
def test_a_script_plans_as_the_command_line_does(
    flags: list[str], words: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["pack", folder / "order.csv", "--catalogue", folder, "--container", "0.2x0.2x0.12", "--json"]
    assert main([*map(str, arguments), *flags]) == 0
    printed = json.loads(capsys.readouterr().out)
    opened = rp.load_catalogue(folder)
    options = PlanOptions.paper() if "paper" in flags else None
    order = rp.load_order(folder / "order.csv", opened)
    planned = rp.plan(order, BOX, opened, options, **words)
    assert document(planned) == printed
    assert document(rp.plan(order, BOX, str(folder), options, **words)) == printed
    made_by = "minz" if planned.settings["heuristic"] == "auto" else "planner"
    assert planned.made_by == printed["made_by"]
    assert planned.made_by == made_by or "rehearse" in words  # which may choose another one
    assert planned.settings == PlanOptions.from_mapping(printed["settings"]).to_mapping()


def test_options_by_keyword_by_record_and_by_preset(catalogue: rp.Catalogue) -> None:
    overlap = {"constraints": "overlap", "grid": COARSE}
    by_word = rp.plan(ORDER, BOX, catalogue, heuristic="mta", **overlap)
    by_record = rp.plan(ORDER, BOX, catalogue, PlanOptions(heuristic="mta", **overlap))
    mixed = rp.plan(ORDER, BOX, catalogue, PlanOptions(heuristic="dblf", **overlap), heuristic="mta")
    assert document(by_word) == document(by_record) == document(mixed)
    paper = rp.plan(ORDER, BOX, catalogue, PlanOptions.paper(constraints="overlap"))
    assert paper.settings == PlanOptions.paper(constraints="overlap").to_mapping()
    assert (paper.settings["tie_break"], paper.settings["restarts"]) == (1.0, 0)


def test_a_function_is_a_heuristic_and_an_object_a_constraint(catalogue: rp.Catalogue) -> None:
    class Low(rp.Constraint):
        def check(self, trial: rp.Trial, surface: Any, state: Any) -> rp.Verdict:
            return rp.Verdict(trial.z + trial.oriented.extents[2] < 0.07, "too-high")

    planned = rp.plan(
        ORDER,
        BOX,
        catalogue,
        heuristic=lambda candidates, rng: -candidates.corners[:, 2],
        own_constraints=[Low()],
        **{**QUICK, "constraints": "stability"},
    )
    assert planned.placements
    assert all(p.corner[2] + p.extents[2] < 0.07 for p in planned.placements)
    assert (planned.settings["heuristic"], planned.settings["own_constraints"]) == ("<own>", ["<own>"])
    assert rp.verify(planned).unchecked == ("<own>",)


# --------------------------------------------------------------------------------------- containers


def test_a_container_comes_in_many_forms(catalogue: rp.Catalogue) -> None:
    def box(container: Any) -> rp.Container:
        return rp.plan(ORDER, container, catalogue, constraints="overlap", **QUICK).container

    boxes = sorted(read_boxes(), key=lambda each: each.volume)
    assert box(BOX) == BOX
    assert box("0.32x0.32x0.30") == rp.Container(0.32, 0.32, 0.30)
    assert box(boxes[-1].name) == boxes[-1]
    small, large = rp.Container(0.05, 0.05, 0.05), rp.Container(0.4, 0.4, 0.3)
    assert box([large, small, BOX]) == BOX
    assert box([small]) == small
    automatic = box("auto")
    assert automatic in boxes
    assert automatic == box(boxes) == box("AUTO")
    smaller = boxes[: boxes.index(automatic)]
    for each in smaller:
        assert not rp.plan(ORDER, each, catalogue, constraints="overlap", **QUICK).complete


def test_a_container_s_size_is_in_the_unit_of_the_meshes(folder: Path) -> None:
    """As on the command line: where it can be no metres."""
    small = meshes(1000.0)
    planned = rp.plan(ORDER, "200x150x120", small, unit="mm", constraints="overlap", **QUICK)
    assert planned.container == rp.Container(0.2, 0.15, 0.12)
    with pytest.raises(rp.InputError) as problem:
        rp.plan(ORDER, "200x150x120", meshes(), constraints="overlap", **QUICK)
    told(problem, "200x150x120mm")


def test_no_container_is_one_line(catalogue: rp.Catalogue) -> None:
    wrongs: tuple[tuple[Any, str], ...] = (
        ([], "no container"),
        ("0.3x0.3", "0.3x0.3"),
        ("NOBOX", "NOBOX"),
        ((0.3, 0.3, 0.3), "packenv.Container"),
        (0.3, "packenv.Container"),
        (None, "packenv.Container"),
    )
    for wrong, word in wrongs:
        with pytest.raises(rp.InputError) as problem:
            rp.plan(ORDER, wrong, catalogue)
        told(problem, word)


# ------------------------------------------------------------------------------------------ mistakes


@pytest.mark.parametrize("name", ["brick.ply", "objects.csv", "order.json", "link.json", "boxes.csv"])
def test_a_saved_plan_replaces_no_input(name: str, tmp_path: Path) -> None:
    write_three(tmp_path)
    (tmp_path / "objects.csv").write_text("name,file\nbrick,brick.ply\ncan,can.ply\n")
    (tmp_path / "order.json").write_text('["brick", "can"]')
    (tmp_path / "boxes.csv").write_text("box_id,length_m,width_m,height_m\nS,0.2,0.15,0.12\n")
    (tmp_path / "link.json").symlink_to("order.json")
    order = rp.load_order(tmp_path / "order.json", str(tmp_path))
    planned = rp.plan(
        order, read_boxes(tmp_path / "boxes.csv"), str(tmp_path), constraints="overlap", **QUICK
    )
    before = (tmp_path / name).read_bytes()
    with pytest.raises(rp.InputError) as problem:
        rp.save_plan(planned, tmp_path / name)
    told(problem, name, "save_plan")
    assert (tmp_path / name).read_bytes() == before
    rp.save_plan(planned, tmp_path / "plan.json")
    rp.save_plan(rp.load_plan(tmp_path / "plan.json"), tmp_path / "plan.json")


def test_an_unknown_item_is_one_line(catalogue: rp.Catalogue) -> None:
    with pytest.raises(rp.InputError) as problem:
        rp.plan(rp.Order.of("brik"), BOX, catalogue)
    told(problem, "'brik'", "memory", "did you mean 'brick'")


@pytest.mark.parametrize(
    ("words", "right"),
    [
        ({"heuristc": "hm"}, "did you mean 'heuristic'"),
        ({"colour": "red"}, "the options are"),
        ({"heuristic": "mts"}, "did you mean 'mta'"),
        ({"stability": "papper"}, "did you mean 'paper'"),
        ({"max_checked": 0}, "from 1"),
        ({"clearance": 0.2}, "0.05"),
        ({"heuristic": 7}, "a function"),
        ({"own_constraints": ["FlatOnly"]}, "my_module:MyRule"),
        ({"own_constraints": "mod:FlatOnly"}, "list"),
        ({"cell_size": 0.0033}, "multiple"),
        ({"grid": {"cell_size": 0.002}}, "GridConfig"),
        ({"geometry": "mesh", "rehearse": 1}, "geometry"),
    ],
    ids=str,
)
def test_a_wrong_option_is_one_line(words: dict[str, Any], right: str, catalogue: rp.Catalogue) -> None:
    with pytest.raises(rp.InputError) as problem:
        rp.plan(ORDER, BOX, catalogue, **words)
    told(problem, next(iter(words)), right)


def test_the_grid_s_numbers_are_options_by_name_too(catalogue: rp.Catalogue) -> None:
    planned = rp.plan(
        ORDER, BOX, catalogue, constraints="overlap", cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2
    )
    assert document(planned) == document(rp.plan(ORDER, BOX, catalogue, constraints="overlap", **QUICK))


def test_an_empty_order_is_one_line(catalogue: rp.Catalogue) -> None:
    for make in (lambda: rp.Order.of(), lambda: rp.plan(rp.Order(()), BOX, catalogue)):
        with pytest.raises(rp.InputError) as problem:
            make()
        told(problem, "order is empty", "at least one")


# ----------------------------------------------------------------------------------------- catalogues


@pytest.mark.parametrize("order", [["brick", "can"], "brick", None])
def test_what_is_no_order_is_one_line(order: Any, catalogue: rp.Catalogue) -> None:
    with pytest.raises(rp.InputError) as problem:
        rp.plan(order, BOX, catalogue)
    told(problem, "packenv.Order.of")


def test_an_item_of_another_catalogue_takes_its_new_name(catalogue: rp.Catalogue) -> None:
    both = rp.load_catalogue({"stone": catalogue.item("brick"), "can": catalogue.item("can")})
    assert (both.item("stone").name, both.item("can").name) == ("stone", "can")
    planned = rp.plan(rp.Order.of("stone", "can"), BOX, both, **QUICK)
    assert sorted(p.item for p in planned.placements) == ["can", "stone"]
    assert rp.verify(planned).ok
    assert rp.execute(planned, closed_loop=True).success


def test_a_catalogue_from_a_folder_and_from_memory_is_the_same(folder: Path) -> None:
    files = rp.load_catalogue(folder)
    memory = rp.load_catalogue({name: trimesh.load_mesh(folder / f"{name}.ply") for name in files.names})
    items = rp.load_catalogue({name: files.item(name) for name in files.names})
    assert set(memory.names) == set(items.names) == {"brick", "book", "can"}
    for name in files.names:
        for other in (memory, items):
            np.testing.assert_allclose(other.item(name).extents, files.item(name).extents, atol=1e-7)
            assert other.item(name).volume == pytest.approx(files.item(name).volume, rel=1e-5)
        assert items.item(name) is files.item(name)
    assert rp.load_catalogue("builtin").label == rp.load_catalogue().label == "builtin"


def test_anything_with_vertices_and_faces_is_a_mesh() -> None:
    class Plain:
        vertices = meshes()["brick"].vertices.tolist()
        faces = meshes()["brick"].faces.tolist()

    item = rp.load_catalogue({"thing": Plain()}).item("thing")
    assert item.name == "thing"
    assert item.volume == pytest.approx(0.08 * 0.06 * 0.04)


@pytest.mark.parametrize("name", ["brick", "book", "can"])
def test_an_item_from_trimesh_and_back_is_the_same(name: str) -> None:
    """Mass properties against the library's own."""
    mesh = meshes()[name]
    item = rp.Item.from_trimesh(mesh, name, mass=0.3)
    back = item.to_trimesh()
    assert (back.units, back.metadata["name"], item.mass_estimated) == ("m", name, False)
    assert back.mass == pytest.approx(0.3)
    np.testing.assert_allclose(back.center_mass, item.com, atol=1e-12)
    np.testing.assert_allclose(back.moment_inertia, item.inertia, rtol=1e-9, atol=1e-12)
    again = rp.Item.from_trimesh(back, name, mass=0.3)
    assert again.sha256 == item.sha256
    back.vertices[:] = 0.0
    assert item.volume == again.volume
    np.testing.assert_array_equal(item.vertices, again.vertices)
    back = again.to_trimesh()
    back.apply_scale(1000.0)
    for wrong in ({"mass": -1.0}, {"unit": "ell"}):
        with pytest.raises(rp.InputError):
            rp.Item.from_trimesh(mesh, name, **wrong)
    assert rp.Item.from_trimesh(back, name, unit="mm").extents == pytest.approx(item.extents)


def test_a_scene_is_a_catalogue_of_its_geometries() -> None:
    solids = meshes()
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0, 0])
    scene.add_geometry(solids["brick"], "one", "brick", transform=turn)
    scene.graph.update("two", matrix=trimesh.transformations.translation_matrix([1, 1, 1]), geometry="brick")
    double = np.diag([2.0, 2.0, 2.0, 1.0])
    scene.add_geometry(solids["can"], "three", "can", transform=double)
    opened = rp.load_catalogue(scene)
    assert sorted(opened.names) == ["brick", "can"]
    assert opened.item("brick").volume == pytest.approx(solids["brick"].volume)
    assert opened.item("can").volume == pytest.approx(8 * solids["can"].volume)
    assert opened.item("can").extents == pytest.approx(2 * solids["can"].extents)
    scene.graph.update("four", matrix=double, geometry="brick")
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue(scene)
    told(problem, "'brick'", "different ways")


def test_units_are_stated_or_given() -> None:
    size = meshes()["brick"].extents
    stated = meshes(1000.0)
    for mesh in stated.values():
        mesh.units = "mm"
    inches = meshes(1 / 0.0254)
    scene = trimesh.Scene({"brick": meshes(1000.0)["brick"]})
    scene.units = "millimeters"
    for opened in (
        rp.load_catalogue(stated),
        rp.load_catalogue(meshes(1000.0), unit="mm"),
        rp.load_catalogue(meshes(100.0), unit="cm"),
        rp.load_catalogue(inches, unit="in"),
        rp.load_catalogue(scene),
    ):
        assert opened.item("brick").extents == pytest.approx(size)
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue(meshes(1000.0))
    told(problem, "brick", "unit", "mm")
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue(meshes(), unit="ell")
    told(problem, "'ell'", "mm")
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue(unit="ell")
    told(problem, "'ell'", "mm")


def _open(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Without one side."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces[2:], process=False)


def _with_nan(mesh: trimesh.Trimesh) -> Any:
    class Broken:
        vertices = np.array(mesh.vertices)
        faces = np.array(mesh.faces)

    Broken.vertices[3, 1] = np.nan
    return Broken()


def _with_strange_face(mesh: trimesh.Trimesh) -> Any:
    class Broken:
        vertices = np.array(mesh.vertices)
        faces = np.array(mesh.faces)

    Broken.faces[0, 0] = 99
    return Broken()


@pytest.mark.parametrize(
    ("broken", "word"),
    [
        (lambda mesh: trimesh.Trimesh(mesh.vertices, np.empty((0, 3), int), process=False), "no faces"),
        (lambda mesh: trimesh.Trimesh(), "no faces"),
        (_with_nan, "finite numbers"),
        (_open, "hole"),
        (_with_strange_face, "face names vertex 99"),
        (lambda mesh: trimesh.Trimesh(mesh.vertices * [1, 1, 0], mesh.faces, process=False), "flat"),
        (lambda mesh: mesh.vertices, "vertices and faces"),
        (lambda mesh: "brick.ply", "vertices and faces"),
        (lambda mesh: trimesh.PointCloud(mesh.vertices), "vertices and faces"),
    ],
    ids=["no-faces", "empty", "nan", "open", "strange-face", "flat", "array", "text", "points"],
)
def test_a_broken_mesh_in_memory_is_refused_by_name(broken: Any, word: str) -> None:
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue({**meshes(), "my brick": broken(meshes()["brick"])})
    told(problem, "'my brick'", word)


@pytest.mark.parametrize(("source", "word"), [({}, "no mesh"), (trimesh.Scene(), "no mesh"), (7, "int")])
def test_what_is_no_catalogue_is_one_line(source: Any, word: str) -> None:
    with pytest.raises(rp.InputError) as problem:
        rp.load_catalogue(source)
    told(problem, word)


# --------------------------------------------------------------------------------- a plan in memory


def test_a_plan_of_meshes_in_memory_needs_no_file(plan: rp.Plan, tmp_path: Path) -> None:
    assert (plan.catalogue, plan.source, plan.complete) == ("<memory>", None, True)
    found = rp.verify(plan)
    assert found.ok
    assert found.to_json()["ok"] is True
    assert (found.placed, found.left_over) == (3, 0)
    executed = rp.execute(plan)
    assert executed.success
    for name in ("p.html", "p.png", "p.glb"):
        rp.show(plan, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000


def test_a_saved_plan_of_memory_needs_its_catalogue(
    plan: rp.Plan, catalogue: rp.Catalogue, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    rp.save_plan(plan, path)
    again = rp.load_plan(path, catalogue)
    assert again.source == path
    one, other = document(plan), document(again)
    for step in (*one["steps"], *other["steps"]):
        step["quat_xyzw"] = [round(q, 12) for q in step["quat_xyzw"]]
    assert one == other
    assert rp.verify(again).ok
    assert rp.verify(again, catalogue).ok
    with pytest.raises(rp.InputError) as problem:
        rp.load_plan(path)
    told(problem, "p.json", "memory", "catalogue")
    for command in (["verify"], ["execute"], ["view", "-o", str(tmp_path / "v.html")]):
        assert main([*command, str(path)]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        for word in ("p.json", "memory", "--catalogue"):
            assert word in line
    assert not (tmp_path / "v.html").exists()
    other_items = rp.load_catalogue({**meshes(), "brick": trimesh.creation.box((0.08, 0.06, 0.041))})
    with pytest.raises(rp.InputError) as problem:
        rp.load_plan(path, other_items)
    told(problem, "brick", "sha256")
    with pytest.raises(rp.InputError) as problem:
        rp.load_plan(path, rp.load_catalogue({"brick": meshes()["brick"]}))
    told(problem, "p.json", "is not in <memory>")


def test_a_plan_s_scene_needs_its_meshes(plan: rp.Plan) -> None:
    assert len(plan.to_scene().graph.nodes_geometry) == 3
    with pytest.raises(rp.InputError) as problem:
        replace(plan, items={}).to_scene()
    told(problem, "load_plan")


def test_a_tampered_plan_does_not_verify(plan: rp.Plan) -> None:
    first, second, *rest = plan.placements
    moved = replace(second, position=first.position, rotation=first.rotation)
    found = rp.verify(replace(plan, placements=(first, moved, *rest)))
    assert not found.ok
    assert found.audit.overlaps
    assert 2 in found.misstated


@pytest.mark.parametrize("key", ["constraints", "stability", "contacts", "grasp", "cell_size"])
def test_a_plan_without_a_claim_is_refused(key: str, plan: rp.Plan) -> None:
    settings = {name: value for name, value in plan.settings.items() if name != key}
    with pytest.raises(rp.InputError) as problem:
        rp.verify(replace(plan, settings=settings))
    told(problem, key)


# ------------------------------------------------------------------------------------- rest of a plan


@pytest.fixture(scope="module")
def executed(plan: rp.Plan) -> rp.ExecutedPlan:
    return rp.execute(plan)


def pieces(plan: rp.Plan) -> list[tuple[str, int]]:
    return sorted((piece.item, piece.instance) for piece in (*plan.placements, *plan.leftovers))


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("closed_loop", [False, True], ids=["open", "closed"])
def test_the_rest_of_a_plan_is_planned_from_where_its_items_lie(
    count: int, closed_loop: bool, plan: rp.Plan, executed: rp.ExecutedPlan
) -> None:
    measured = executed.execution.final[:count]
    rest = rp.plan_rest(plan, measured)
    assert pieces(rest) == pieces(plan)
    assert [p.item for p in rest.placements[:count]] == [p.item for p in plan.placements[:count]]
    for placement, pose in zip(rest.placements, measured, strict=False):
        np.testing.assert_array_equal(placement.rotation, pose.rotation)
        np.testing.assert_array_equal(placement.position, pose.position)
        assert placement.path is None
    assert rest.complete
    assert all(p.path is not None for p in rest.placements[count:])
    assert rest.metrics["utilization"] == pytest.approx(plan.metrics["utilization"])
    carried = rp.execute(rest, placed=measured, closed_loop=closed_loop)
    assert carried.success
    assert len(carried.execution.final) == len(plan.placements)
    assert len(carried.execution.items) == len(plan.placements) - count
    told_in_file = carried.to_json()
    assert len(told_in_file["items"]) == len(plan.placements) - count
    assert pieces(carried.plan) == pieces(plan)


def test_the_rest_of_a_whole_execution_is_the_plan_where_it_was_measured(
    plan: rp.Plan, executed: rp.ExecutedPlan, tmp_path: Path
) -> None:
    measured = executed.execution.final
    rest = rp.plan_rest(plan, measured)
    assert [(p.item, p.instance) for p in rest.placements] == [(p.item, p.instance) for p in plan.placements]
    for placement, pose in zip(rest.placements, measured, strict=True):
        assert placement.pose == pose or (
            (placement.rotation == pose.rotation).all() and (placement.position == pose.position).all()
        )
        placed = pose.apply(plan.items[placement.item].vertices)
        np.testing.assert_allclose(placement.corner, placed.min(axis=0), atol=1e-12)
        np.testing.assert_allclose(placement.corner + placement.extents, placed.max(axis=0), atol=1e-12)
    assert rest.leftovers == ()
    assert rest.settings == plan.settings
    again = rp.execute(rest, placed=measured)
    assert again.execution.items == ()
    assert again.success


def test_pieces_of_one_name_keep_their_number(catalogue: rp.Catalogue) -> None:
    order = rp.Order.of("can", "brick", "can", "can")
    planned = rp.plan(order, BOX, catalogue, **QUICK)
    final = rp.execute(planned).execution.final
    for count in range(len(planned.placements) + 1):
        rest = rp.plan_rest(planned, final[:count])
        assert pieces(rest) == [("brick", 1), ("can", 1), ("can", 2), ("can", 3)]


def test_leftovers_get_another_chance(catalogue: rp.Catalogue) -> None:
    planned = rp.plan(ORDER, BOX, catalogue, **QUICK)
    short = replace(
        planned,
        placements=planned.placements[:2],
        leftovers=(rp.Leftover(planned.placements[2].item, 1, "no-legal-candidate", "no room"),),
    )
    final = rp.execute(short).execution.final
    assert rp.plan_rest(short, final).complete


def test_leftovers_of_a_saved_plan_of_memory_are_at_hand(catalogue: rp.Catalogue, tmp_path: Path) -> None:
    planned = rp.plan(ORDER, rp.Container(0.11, 0.09, 0.06), catalogue, **QUICK)
    assert planned.placements
    assert planned.leftovers
    rp.save_plan(planned, tmp_path / "p.json")
    again = rp.load_plan(tmp_path / "p.json", catalogue)
    poses = [p.pose for p in again.placements]
    assert pieces(rp.plan_rest(again, poses)) == pieces(planned)
    executed = rp.execute(again, closed_loop=True)
    assert pieces(executed.plan) == pieces(planned)
    assert not executed.success
    assert executed.to_json()["cause"] == "left-over"


def test_a_partly_filled_container_is_shown_too(
    plan: rp.Plan, executed: rp.ExecutedPlan, tmp_path: Path
) -> None:
    measured = executed.execution.final[:1]
    rest = rp.plan_rest(plan, measured)
    carried = rp.execute(rest, placed=measured, record=True)
    for suffix in ("html", "png", "gif", "glb"):
        rp.show(carried, tmp_path / f"e.{suffix}")
        rp.show(rest, tmp_path / f"p.{suffix}")
    assert len(trimesh.load(tmp_path / "e.glb").graph.nodes_geometry) == 3


def test_more_poses_than_items_are_refused(plan: rp.Plan, executed: rp.ExecutedPlan) -> None:
    four = (*executed.execution.final, executed.execution.final[0])
    for refused in (lambda: rp.plan_rest(plan, four), lambda: rp.execute(plan, placed=four)):
        with pytest.raises(rp.InputError) as problem:
            refused()
        told(problem, "4", "3 items")


def test_other_options_may_plan_the_rest(plan: rp.Plan, executed: rp.ExecutedPlan) -> None:
    options = PlanOptions(heuristic="mta", grid=GridConfig(0.002, 0.02, 2, 2))
    rest = rp.plan_rest(plan, executed.execution.final[:1], options=options)
    assert rest.settings == options.to_mapping()
    assert rest.complete


# -------------------------------------------------------------------------------------------- names


def test_importing_the_package_is_light_and_tells_its_names() -> None:
    code = (
        "import sys, packenv\n"
        "heavy = {'numba', 'pybullet', 'torch', 'trimesh', 'scipy', 'PIL'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "missing = set(packenv.__all__) - set(dir(packenv))\n"
        "assert not missing, missing\n"
        "heavy = {'numba', 'pybullet', 'torch', 'trimesh', 'scipy', 'PIL'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=REPO, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", rp.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(rp, name) is not None


def test_the_names_that_are_loaded_are_those_that_checkers_see() -> None:
    text = (REPO / "packenv" / "__init__.py").read_text(encoding="utf-8")
    assert {*re.findall(r"(\w+) as \1\b", text)} == set(rp.__all__)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'plam'"):
        _ = rp.plam
