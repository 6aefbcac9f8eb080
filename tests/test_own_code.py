"""A plan file may name own code; it is never imported for that."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv import extensions
from packenv.cli import main
from packenv.planning import assembly
from tests.conftest import REPO
from tests.memory_samples import BOX, ORDER, QUICK
from tests.mesh_samples import write_three

NAMED = {
    "heuristic": {"heuristic": "os:getcwd"},
    "constraint": {"own_constraints": ["os:getcwd"]},
    "nameless": {"own_constraints": ["<own>"]},
    "nameless-heuristic": {"heuristic": "<own>"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Items, and a plan of them."""
    folder = tmp_path_factory.mktemp("items")
    write_three(folder)
    rp.save_plan(rp.plan(ORDER, BOX, folder, **QUICK), folder / "p.json")
    return folder


@pytest.fixture
def guarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be imported by name."""

    def load(text: str, what: str) -> Any:
        raise AssertionError(f"{text} was imported for {what}")

    monkeypatch.setattr(extensions, "load_extension", load)
    monkeypatch.setattr(assembly, "load_extension", load)


def naming(folder: Path, settings: dict[str, Any]) -> Path:
    document = json.loads((folder / "p.json").read_text())
    document["settings"].update(settings)
    path = folder / "named.json"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("settings", NAMED.values(), ids=NAMED)
@pytest.mark.usefixtures("guarded")
def test_no_command_imports_what_a_file_names(
    settings: dict[str, Any], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = naming(folder, settings)
    assert main(["verify", str(path)]) == 0
    printed = capsys.readouterr().out
    for name in settings.get("own_constraints", ()):
        assert f"not checked: own constraint {name}" in printed
    assert main(["verify", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["unchecked_constraints"] == settings.get("own_constraints", [])
    for kind in ("html", "png", "gif", "glb"):
        assert main(["view", str(path), "-o", str(tmp_path / f"v.{kind}")]) == 0
    assert main(["execute", str(path)]) == 0
    plan = rp.load_plan(path)
    assert rp.execute(plan, feel=True).success
    capsys.readouterr()
    assert main(["execute", str(path), "--closed-loop"]) == 2
    printed_too = capsys.readouterr()
    assert printed_too.out == ""
    (line,) = printed_too.err.strip().splitlines()
    named = settings.get("heuristic") or settings["own_constraints"][0]
    for word in ("named.json", named, "--heuristic", "--constraint"):
        assert word in line
    with pytest.raises(rp.InputError, match="own code"):
        rp.execute(plan, closed_loop=True)


@pytest.mark.parametrize("settings", NAMED.values(), ids=NAMED)
@pytest.mark.usefixtures("guarded")
def test_planning_again_from_a_file_does_not_import_either(settings: dict[str, Any], folder: Path) -> None:
    plan = rp.load_plan(naming(folder, settings))
    with pytest.raises(rp.InputError) as problem:
        rp.plan_rest(plan, [plan.placements[0].pose])
    assert "own code" in str(problem.value)
    with pytest.raises(rp.InputError) as problem:
        rp.rehearse(plan)
    assert "own code" in str(problem.value)


def test_a_module_of_the_current_folder_is_not_run(folder: Path, tmp_path: Path) -> None:
    """Really not: the module would leave a file behind."""
    (tmp_path / "evil.py").write_text("open('ran', 'w').close()\nclass Rule: pass\n")
    path = naming(folder, {"heuristic": "evil:Rule", "own_constraints": ["evil:Rule"]})
    for command in (
        ["verify", str(path)],
        ["view", str(path), "-o", "v.html"],
        ["execute", str(path)],
        ["execute", str(path), "--closed-loop"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "packenv", *command],
            cwd=tmp_path,
            env={**__import__("os").environ, "PYTHONPATH": str(REPO)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == (2 if "--closed-loop" in command else 0), done.stderr
    assert not (tmp_path / "ran").exists()


def test_own_code_that_the_user_names_plans_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second item is planned inside the first one, so the rest is planned again, by the given rules."""
    document = json.loads((folder / "p.json").read_text())
    first, second = document["steps"][:2]
    shift = np.subtract(first["corner"], second["corner"])
    for key in ("position", "corner"):
        second[key] = (np.array(second[key]) + shift).tolist()
    document["settings"].update(heuristic="os:getcwd", own_constraints=["os:getcwd"])
    path = folder / "broken.json"
    path.write_text(json.dumps(document))
    rules = ["--heuristic", "tests.own_rules:flattest", "--constraint", "tests.own_rules:LowOnly"]
    assert main(["execute", str(path), "--closed-loop", "--json", *rules]) in (0, 1)
    told = json.loads(capsys.readouterr().out)
    assert told["plans"] > 1
    for item in told["items"][1:]:
        assert item["planned"]["position"][2] < 0.05
    assert main(["execute", str(path), "--closed-loop", "--heuristic", "hm"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "os:getcwd" in line
    assert "--constraint" in line
    assert main(["execute", str(path), "--closed-loop", "--constraint", "tests.own_rules:LowOnly"]) == 2
    assert "--heuristic" in capsys.readouterr().err


@pytest.mark.parametrize("flags", [["--heuristic", "hm"], ["--constraint", "tests.own_rules:LowOnly"]])
def test_rules_for_planning_again_need_the_closed_loop(
    flags: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["execute", str(folder / "p.json"), *flags]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert flags[0] in line
    assert "--closed-loop" in line


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        (["--constraint", "os:getcwd"], "packenv.Constraint"),
        (["--constraint", "tests.own_rules:LowOnyl"], "did you mean 'LowOnly'"),
        (["--constraint", "LowOnly"], "my_module:MyRule"),
        (["--heuristic", "tests.own_rules:LOW"], "function"),
        (["--heuristic", "best"], "one of"),
        (["--heuristic", "no_such_module_here:x"], "no_such_module_here"),
    ],
)
def test_a_wrong_name_is_one_line(
    flags: list[str], word: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = folder / "order.csv"
    order.write_text("item,qty\ncan,1\n")
    pack = ["pack", str(order), "--catalogue", str(folder), "--container", "0.2x0.2x0.12"]
    for command in (pack, ["execute", str(folder / "p.json"), "--closed-loop"]):
        assert main([*command, *flags]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.strip().splitlines()
        assert word in line
