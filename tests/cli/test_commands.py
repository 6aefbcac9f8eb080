"""The command line as a user meets it: results, exit codes, one line for a mistake, nothing half-written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from packenv import api
from packenv.cli import main
from packenv.planning.options import rules
from packenv.planning.search.heuristics import HEURISTICS
from packenv.types import Plan
from tests.cli.refusals import refused
from tests.conftest import REPO
from tests.shapes import cup

SIZE = "0.2x0.2x0.15"
HEURISTIC_NAMES = rules()["heuristic"].words


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalogue of four small items, one longer than any container here."""
    folder = tmp_path_factory.mktemp("shelf")
    trimesh.creation.box((0.10, 0.08, 0.05)).export(folder / "brick.ply")
    trimesh.creation.cylinder(0.03, 0.1, sections=32).export(folder / "can.stl")
    trimesh.creation.box((0.9, 0.02, 0.02)).export(folder / "pole.obj")
    beaker = cup(0.035, 0.08)
    trimesh.Trimesh(beaker.vertices, beaker.faces, process=False).export(folder / "beaker.off")
    (folder / "objects.csv").write_text(
        "name,file,mass_kg\nbrick,brick.ply,0.5\ncan,can.stl,0.3\npole,pole.obj,0.2\nbeaker,beaker.off,\n"
    )
    return folder


@pytest.fixture
def order(tmp_path: Path) -> Path:
    path = tmp_path / "order.csv"
    path.write_text("item,qty\nbrick,2\ncan,1\nbeaker,2\n")
    return path


def _pack(order: Path, shelf: Path, *more: str | Path) -> int:
    arguments = [order, "--catalogue", shelf, "--container", SIZE, *more]
    return main(["pack", *map(str, arguments)])


def test_pack_then_verify_then_view(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "p.json"
    assert _pack(order, shelf, "--out", plan, "--html", tmp_path / "p.html", "--png", tmp_path / "p.png") == 0
    assert "packed 5 of 5" in capsys.readouterr().out
    assert (tmp_path / "p.html").read_text().lower().startswith("<!doctype html>")
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert main(["verify", str(plan), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is True
    assert report["overlaps"] == report["protrusions"] == report["blocked"] == []
    assert main(["verify", str(plan)]) == 0
    assert main(["view", str(plan), "-o", str(tmp_path / "v.html")]) == 0
    assert main(["view", str(plan), "-o", str(tmp_path / "v.png")]) == 0
    assert (tmp_path / "v.png").read_bytes() == (tmp_path / "p.png").read_bytes()


@pytest.mark.parametrize("heuristic", HEURISTIC_NAMES)
def test_every_heuristic_gives_a_plan_that_passes_the_audit(
    heuristic: str, order: Path, shelf: Path, tmp_path: Path
) -> None:
    plan = tmp_path / "p.json"
    assert _pack(order, shelf, "--heuristic", heuristic, "--seed", "4", "--out", plan) == 0
    assert main(["verify", str(plan)]) == 0


def test_the_parser_offers_every_heuristic(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(HEURISTIC_NAMES) == {"auto", *HEURISTICS}
    with pytest.raises(SystemExit):
        main(["pack", "--help"])
    assert f"{{{','.join(HEURISTIC_NAMES)}}}|MODULE:NAME" in capsys.readouterr().out


def test_pack_says_what_is_odd_about_its_meshes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two solids in one file, a part that was mended, and one of 100 times the others' size."""
    block = trimesh.creation.box((0.01, 0.01, 0.01))
    far = block.copy().apply_translation((0.02, 0, 0))
    trimesh.util.concatenate([block, far]).export(tmp_path / "two.stl")
    turned = block.copy()
    turned.invert()
    turned.export(tmp_path / "turned.stl")
    block.export(tmp_path / "small.stl")
    block.copy().apply_scale(100).export(tmp_path / "large.stl")
    order = tmp_path / "o.csv"
    order.write_text("item,qty\ntwo,1\nturned,1\nsmall,2\nlarge,1\n")
    assert main(
        [
            "pack",
            str(order),
            "--catalogue",
            str(tmp_path),
            "--container",
            "1.2x1.2x1.2",
            "--constraints",
            "overlap",
        ]
    ) in (0, 1)
    lines = [line.removeprefix("robotpack: ") for line in capsys.readouterr().err.splitlines()]
    assert "two.stl: 2 disjoint bodies: taken as one rigid item" in lines
    assert "turned.stl: repaired: turned inside out (the faces pointed inward)" in lines
    said = [line for line in lines if "suspicious" in line]
    assert len(said) == 1
    assert said[0].startswith("large.stl: suspicious: 1 m, 100 times longer")


def test_verify_finds_a_tampered_plan(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    _pack(order, shelf, "--out", path)
    capsys.readouterr()
    plan = json.loads(path.read_text())
    plan["steps"][1]["position"] = plan["steps"][0]["position"]
    plan["steps"][1]["quat_xyzw"] = plan["steps"][0]["quat_xyzw"]
    plan["steps"][2]["position"][0] -= 0.5
    path.write_text(json.dumps(plan))
    assert main(["verify", str(path), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    assert {(o["step_a"], o["step_b"]) for o in report["overlaps"]} >= {(1, 2)}
    assert any(p["step"] == 3 and p["axis"] == "x" for p in report["protrusions"])
    assert main(["verify", str(path)]) == 1
    assert "overlap" in capsys.readouterr().out


def test_verify_finds_a_plan_that_lost_an_item(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    _pack(order, shelf, "--out", path)
    plan = json.loads(path.read_text())
    lost = plan["steps"].pop()
    path.write_text(json.dumps(plan))
    capsys.readouterr()
    assert main(["verify", str(path), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    ordered = {"brick": 2, "can": 1, "beaker": 2}[lost["item"]]
    assert report["miscounted"] == [{"item": lost["item"], "ordered": ordered, "in_plan": ordered - 1}]


def test_same_seed_same_bytes(order: Path, shelf: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        _pack(order, shelf, "--heuristic", "random", "--seed", "7", "--out", tmp_path / f"{name}.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_auto_takes_the_smallest_box_that_takes_all(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boxes = tmp_path / "boxes.csv"
    boxes.write_text(
        "box_id,length_m,width_m,height_m\nBIG,0.4,0.4,0.3\nTINY,0.1,0.1,0.1\nFAIR,0.2,0.2,0.15\n"
    )
    code = main(
        [
            "pack",
            str(order),
            "--catalogue",
            str(shelf),
            "--container",
            "auto",
            "--boxes",
            str(boxes),
            "--json",
        ]
    )
    assert code == 0
    assert json.loads(capsys.readouterr().out)["container"]["name"] == "FAIR"


def test_an_item_larger_than_the_container_is_reported_not_refused(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.json"
    order.write_text('{"items": [{"item": "pole", "qty": 1}, {"item": "can", "qty": 1}]}')
    assert _pack(order, shelf, "--out", tmp_path / "p.json") == 1
    assert "larger than" in capsys.readouterr().out
    plan = json.loads((tmp_path / "p.json").read_text())
    assert [step["item"] for step in plan["steps"]] == ["can"]
    assert plan["leftovers"][0]["reason"] == "larger-than-container"
    assert main(["verify", str(tmp_path / "p.json")]) == 0


def test_the_given_sequence_is_kept(order: Path, shelf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _pack(order, shelf, "--sequence", "given", "--json") == 0
    steps = json.loads(capsys.readouterr().out)["steps"]
    assert [step["item"] for step in steps] == ["brick", "brick", "can", "beaker", "beaker"]
    assert [step["instance"] for step in steps] == [1, 2, 1, 1, 2]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", ["order.csv", "empty"]),
        ("item,qty\n", ["order.csv", "empty"]),
        ("item,qty\nbrick,0\n", ["order.csv", "0"]),
        ("item,qty\nbrick,-1\n", ["-1"]),
        ("item,qty\nbrick,1.5\n", ["1.5"]),
        ('item,qty\nbrick,"1,5"\n', ["1,5"]),
        ("item,qty\nbrik,1\n", ["brik", "brick"]),
        ("qty\n1\n", ["item"]),
    ],
)
def test_a_wrong_order_is_one_line(
    text: str, names: list[str], shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.csv"
    order.write_text(text)
    out = tmp_path / "out"
    out.mkdir()
    code = _pack(order, shelf, "--out", out / "p.json", "--html", out / "p.html", "--png", out / "p.png")
    refused(capsys, code, *names)
    assert list(out.iterdir()) == []


def test_a_byte_order_mark_is_accepted(shelf: Path, tmp_path: Path) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item,qty\ncan,1\n", encoding="utf-8-sig")
    assert _pack(order, shelf) == 0


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--container", "0.3x0.3"], ["0.3x0.3"]),
        (["--container", "300x300x300"], ["300x300x300mm"]),
        (["--container", "-1x1x1"], ["-1"]),
        (["--container", "NOBOX"], ["NOBOX"]),
        (["--catalogue", "/nowhere/at/all"], ["/nowhere/at/all"]),
        (["--boxes", "/nowhere/boxes.csv"], ["/nowhere/boxes.csv"]),
        (["--out", "/nowhere/p.json"], ["/nowhere"]),
        (["--html", "/nowhere/p.html"], ["/nowhere"]),
        (["--png", "/"], ["folder"]),
        (["--png", "/dev/null"], ["regular"]),
        (["--out", "x" * 300], ["long"]),
        (["--catalogue", "x" * 300], ["long"]),
    ],
)
def test_a_wrong_option_is_one_line(
    arguments: list[str], names: list[str], order: Path, shelf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joined = [f"{arguments[0]}={arguments[1]}"]  # so that a value may begin with a dash
    refused(capsys, _pack(order, shelf, *joined), *names)


def test_a_mesh_in_millimetres_asks_for_the_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.box((100, 80, 50)).export(tmp_path / "brick.stl")
    order = tmp_path / "order.csv"
    order.write_text("item,qty\nbrick,1\n")
    refused(capsys, _pack(order, tmp_path), "brick.stl", "--unit")
    assert _pack(order, tmp_path, "--unit", "mm") == 0


def test_a_changed_mesh_is_not_verified(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trimesh.creation.box((0.1, 0.08, 0.05)).export(tmp_path / "brick.ply")
    order = tmp_path / "order.csv"
    order.write_text("item,qty\nbrick,1\n")
    assert _pack(order, tmp_path, "--out", tmp_path / "p.json") == 0
    trimesh.creation.box((0.1, 0.08, 0.051)).export(tmp_path / "brick.ply")
    capsys.readouterr()
    refused(capsys, main(["verify", str(tmp_path / "p.json")]), "brick.ply", "sha256")


@pytest.mark.parametrize("command", ["verify", "view"])
def test_a_missing_plan_is_one_line(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ["-o", str(tmp_path / "v.html")] if command == "view" else []
    refused(capsys, main([command, str(tmp_path / "none.json"), *more]), "none.json")


def test_a_view_of_unknown_kind_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, main(["view", "p.json", "-o", str(tmp_path / "v.pdf")]), ".pdf", ".html")


def test_items_check_lists_every_mesh(shelf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["items", "check", str(shelf)]) == 0
    table = capsys.readouterr().out
    for name in ("brick", "can", "pole", "beaker"):
        assert name in table


def test_items_check_goes_on_after_a_bad_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.stl").write_bytes(b"")
    trimesh.creation.box((0.1, 0.08, 0.05)).export(tmp_path / "good.ply")
    assert main(["items", "check", str(tmp_path), "--json"]) == 1
    status = {row["name"]: row["status"] for row in json.loads(capsys.readouterr().out)}
    assert status == {"bad": "error", "good": "ok"}


def test_items_prepare_fills_the_cache_once(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROBOTPACK_CACHE", str(tmp_path))
    counts = []
    for _ in range(2):
        assert main(["items", "prepare", str(shelf), "--json"]) == 0
        figures = json.loads(capsys.readouterr().out)
        counts.append((figures["prepared"], figures["cached"]))
    assert counts == [(4, 0), (0, 4)]


def _process(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "packenv", *arguments],
        cwd=REPO,
        capture_output=True,
        text=True,
        check=False,
    )


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from packenv.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'pybullet', 'scipy', 'numba', 'trimesh', 'fcl', 'torch', 'PIL'} & set(sys.modules)\n"
        "sys.exit(' '.join(sorted(heavy)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=REPO, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["pack"],
        ["pack", "o.csv", "--heuristic", "magic"],
        ["fly"],
        ["pack", "o.csv", "--seed=-1"],
        ["pack", "o.csv", "--seed", "x"],
    ],
)
def test_wrong_usage_is_exit_code_2(arguments: list[str]) -> None:
    done = _process(*arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def test_a_reader_that_goes_away_is_no_error(shelf: Path) -> None:
    script = f"{sys.executable} -m packenv items check {shelf} | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], cwd=REPO, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.strip() in ("0", "141")


def test_the_plan_depends_on_nothing_in_the_environment(order: Path, shelf: Path, tmp_path: Path) -> None:
    """Another process, hash seed and cache folder: the same bytes."""
    plans = []
    for seed in ("0", "1"):
        out = tmp_path / f"{seed}.json"
        environment = {
            **os.environ,
            "PYTHONHASHSEED": seed,
            "ROBOTPACK_CACHE": str(tmp_path / f"cache{seed}"),
        }
        arguments = ["pack", str(order), "--catalogue", str(shelf), "--container", SIZE, "--out", str(out)]
        subprocess.run(
            [sys.executable, "-m", "packenv", *arguments],
            cwd=REPO,
            env=environment,
            check=True,
            capture_output=True,
        )
        plans.append(out.read_bytes())
    assert plans[0] == plans[1]


def test_poses_in_the_plan_are_rigid_motions(order: Path, shelf: Path, tmp_path: Path) -> None:
    _pack(order, shelf, "--places", "grid", "--out", tmp_path / "p.json")
    for step in json.loads((tmp_path / "p.json").read_text())["steps"]:
        assert np.linalg.norm(step["quat_xyzw"]) == pytest.approx(1, abs=1e-12)
        on_grid = np.array(step["corner"][:2]) / 0.01
        np.testing.assert_allclose(on_grid, np.round(on_grid), atol=1e-9)


@pytest.mark.parametrize("same", ["order.csv", "p.json"])
def test_no_output_replaces_another_file(
    same: str, order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = order.read_bytes()
    refused(capsys, _pack(order, shelf, "--out", tmp_path / "p.json", "--html", tmp_path / same), same)
    assert order.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["order.csv"]


def test_a_link_is_followed(order: Path, shelf: Path, tmp_path: Path) -> None:
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    assert _pack(order, shelf, "--out", tmp_path / "link.json") == 0
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text())["schema_version"] == 1


def test_a_plan_that_fails_its_audit_can_be_looked_at(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    _pack(order, shelf, "--out", path)
    plan = json.loads(path.read_text())
    plan["steps"][1]["position"][1] -= 1
    path.write_text(json.dumps(plan))
    capsys.readouterr()
    assert main(["view", str(path), "-o", str(tmp_path / "v.html")]) == 0
    assert "no heightmap" in capsys.readouterr().err
    assert main(["verify", str(path), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["misstated_boxes"] == [2]
    assert [p["step"] for p in report["protrusions"]] == [2]


@pytest.mark.parametrize("cell", [0.0, -0.002, 1e-7, "0.002", None])
def test_a_wrong_cell_size_in_a_plan_is_one_line(
    cell: object, order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    _pack(order, shelf, "--out", path)
    plan = json.loads(path.read_text())
    plan["settings"]["cell_size"] = cell
    path.write_text(json.dumps(plan))
    capsys.readouterr()
    refused(capsys, main(["view", str(path), "-o", str(tmp_path / "v.html")]), "cell_size")


def test_an_ascii_terminal_is_no_error(order: Path, shelf: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    arguments = ["pack", str(order), "--catalogue", str(shelf), "--container", SIZE]
    done = subprocess.run(
        [sys.executable, "-m", "packenv", *arguments],
        cwd=REPO,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_full_disk_is_one_line(order: Path, shelf: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "packenv", "items", "check", str(shelf)],
            cwd=REPO,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def test_the_grid_can_be_chosen(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.json"
    flags = ["--cell-size", "0.004", "--grid-step", "0.008", "--poses", "2", "--yaws", "3"]
    assert _pack(order, shelf, *flags, "--out", plan) in (0, 1)
    settings = json.loads(plan.read_text())["settings"]
    chosen = {name: settings[name] for name in ("cell_size", "grid_step", "n_poses", "n_yaws")}
    assert chosen == {"cell_size": 0.004, "grid_step": 0.008, "n_poses": 2, "n_yaws": 3}
    capsys.readouterr()
    assert _pack(order, shelf, "--grid-step", "0.003") == 2
    assert "a multiple of cell_size" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--out", "--html", "--png"])
@pytest.mark.parametrize(
    "read", ["brick.ply", "brick.parts.obj", "objects.csv", "boxes.csv", "cell.json", "arm.json"]
)
def test_no_output_replaces_what_is_read(
    option: str, read: str, order: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trimesh.creation.box((0.10, 0.08, 0.05)).export(tmp_path / "brick.ply")
    (tmp_path / "brick.parts.obj").write_text(
        trimesh.creation.box((0.10, 0.08, 0.05)).export(file_type="obj")
    )
    (tmp_path / "objects.csv").write_text("name,file\nbrick,brick.ply\n")
    (tmp_path / "boxes.csv").write_text("box_id,length_m,width_m,height_m\nB,0.2,0.2,0.15\n")
    (tmp_path / "arm.json").write_bytes((REPO / "assets" / "robots" / "tx90.json").read_bytes())
    (tmp_path / "cell.json").write_text('{"robot": "arm.json"}')
    order.write_text("item\nbrick\n")
    # Under another name: a link to the file, with the ending that the option asks for.
    link = tmp_path / f"link{ {'--out': '.json', '--html': '.html', '--png': '.png'}[option] }"
    link.symlink_to(tmp_path / read)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    more = ["--boxes", tmp_path / "boxes.csv", "--cell", tmp_path / "cell.json"]
    for path in (link, tmp_path / read):
        refused(capsys, _pack(order, tmp_path, *more, option, path), option, read, "which is read")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("command", ["view", "export", "execute"])
def test_what_a_plan_reads_is_not_replaced_either(
    command: str, order: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, plan = tmp_path / "brick.glb", tmp_path / "p.json"
    trimesh.creation.box((0.10, 0.08, 0.05)).export(mesh)
    order.write_text("item\nbrick\n")
    assert _pack(order, tmp_path, "--out", plan) == 0
    capsys.readouterr()
    before = mesh.read_bytes()
    refused(capsys, main([command, str(plan), "--out", str(mesh)]), "--out", "brick.glb", "which is read")
    assert mesh.read_bytes() == before


@pytest.mark.parametrize(
    ("option", "name", "right"),
    [("--out", "p.html", ".json"), ("--html", "p.json", ".html"), ("--png", "p.jpg", ".png")],
)
def test_the_ending_of_a_file_is_that_of_its_format(
    option: str,
    name: str,
    right: str,
    order: Path,
    shelf: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused(capsys, _pack(order, shelf, option, tmp_path / name), option, name, right)
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (
            ["pack", "o.csv", "--contaner", "0.3x0.3x0.3"],
            "unknown argument '--contaner'; did you mean '--container'?",
        ),
        (
            ["pack", "o.csv", "--Container=auto"],
            "unknown argument '--Container'; did you mean '--container'?",
        ),
        (["pack", "o.csv", "more.csv"], "unknown argument 'more.csv'"),
        (["verify", "p.json", "--catalog", "x", "--jsn"], "unknown argument '--jsn'; did you mean '--json'?"),
        (["items", "check", "x", "--unt", "mm"], "unknown argument '--unt'; did you mean '--unit'?"),
        (["pack", "o.csv", "--preset", "Paper"], "invalid choice: 'Paper'; did you mean 'paper'?"),
        (["pack", "o.csv", "--unit", "MM"], "invalid choice: 'MM'; did you mean 'mm'?"),
        (["pack", "o.csv", "--unit", "furlong"], "choose from m, cm, mm, in"),
        (["pck", "o.csv"], "invalid choice: 'pck'; did you mean 'pack'?"),
        (["items", "chek", "x"], "did you mean 'check'?"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_nearest(
    words: list[str], hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert hint in line


def test_the_unit_is_the_containers_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.box((100, 80, 50)).export(tmp_path / "brick.stl")
    order = tmp_path / "order.csv"
    order.write_text("item\nbrick\n")
    words = ["pack", str(order), "--catalogue", str(tmp_path), "--unit", "mm", "--json", "--container"]
    for size in ("200x150x120", "0.2x0.15x0.12", "20x15x12cm"):
        assert main([*words, size]) == 0
        found = json.loads(capsys.readouterr().out)["container"]
        assert found["size"] == [0.2, 0.15, 0.12]


def test_every_bad_mesh_of_an_order_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.box((0.10, 0.08, 0.05)).export(tmp_path / "brick.ply")
    for name in ("one.stl", "two.obj", "not_asked_for.ply"):
        (tmp_path / name).write_text("garbage")
    order = tmp_path / "order.csv"
    order.write_text("item\none\nbrick\ntwo\n")
    code = _pack(order, tmp_path)
    line = capsys.readouterr().err
    assert code == 2
    assert line.count("\n") == 1
    assert "one.stl" in line
    assert "two.obj" in line
    assert "not_asked_for" not in line


def test_the_box_is_told_with_its_size_and_why_smaller_ones_do_not_do(
    order: Path, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boxes = tmp_path / "boxes.csv"
    boxes.write_text(
        "box_id,length_m,width_m,height_m\nFAIR,0.2,0.2,0.15\nTINY,0.09,0.09,0.09\nLOW,0.3,0.3,0.055\n"
    )
    words = ["pack", str(order), "--catalogue", str(shelf), "--boxes", str(boxes)]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert "into FAIR (0.2x0.2x0.15 m) with" in printed.out
    assert "box LOW (0.3x0.3x0.055 m) does not take all: beaker does not fit" in printed.err
    (line,) = [line for line in printed.err.splitlines() if "TINY" in line]
    assert "box TINY (0.09x0.09x0.09 m) does not take all: the items' volume exceeds the container's" in line


def test_equal_leftovers_are_one_line(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item,qty\npole,3\ncan,1\n")
    assert _pack(order, shelf) == 1
    told = [line for line in capsys.readouterr().out.splitlines() if "not packed" in line]
    assert len(told) == 1
    assert "pole x 3  not packed: " in told[0]


@pytest.mark.parametrize(
    ("survived", "made_by", "code", "words"),
    [
        (2, "first", 0, ["rehearsed: success in 2 of 2", "with hm (auto):"]),
        (1, "dblf", 1, ["FAILED IN REHEARSAL", "success in 1 of 2", "with dblf (auto):", "this one: dblf"]),
        (0, "spare 1 hm late", 1, ["FAILED IN REHEARSAL", "with hm (auto):", "this one: spare 1 hm late"]),
    ],
)
def test_a_plan_that_fails_its_rehearsals_is_a_failure(
    survived: int,
    made_by: str,
    code: int,
    words: list[str],
    order: Path,
    shelf: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """How worlds judge a plan is tested elsewhere; here a plan is judged so, and told to people."""
    made = api.plan

    def judged(*given: Any, **named: Any) -> Plan:
        figures = {"rehearsal_worlds": 2, "rehearsal_survived": survived, "rehearsal_plans": 3}
        plan = made(*given, **named)
        return replace(plan, metrics={**plan.metrics, **figures}, made_by=made_by)

    monkeypatch.setattr(api, "plan", judged)
    assert _pack(order, shelf, "--constraints", "overlap") == code
    out = capsys.readouterr().out
    for word in words:
        assert word in out


def test_a_density_gives_the_masses_that_the_table_does_not(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order, plan = tmp_path / "order.csv", tmp_path / "p.json"
    order.write_text("item\nbrick\nbeaker\n")
    assert _pack(order, shelf, "--density", "500", "--out", plan) == 0
    document = json.loads(plan.read_text())
    beaker, brick = (document["meshes"][name] for name in ("beaker", "brick"))
    assert beaker["mass"] == pytest.approx(500 * beaker["volume"])
    assert (beaker["mass_estimated"], brick["mass"], document["density"]) == (False, 0.5, 500.0)
    assert api.load_plan(plan).items["beaker"].mass == beaker["mass"]
    capsys.readouterr()
    assert main(["verify", str(plan)]) == 0
    for wrong in ("0", "-5", "nan", "30000"):
        capsys.readouterr()
        refused(capsys, _pack(order, shelf, f"--density={wrong}"), "density is", "kg/m³ from 1 to 22,600")
