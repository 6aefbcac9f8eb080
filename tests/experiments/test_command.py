"""``robotpack bench`` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trimesh

from packenv.cli import main
from packenv.cli.bench import EXPERIMENTS, FURTHER
from packenv.cli.parser import command_line
from packenv.experiments.command import _pool
from packenv.experiments.registry import experiment
from packenv.experiments.spec import RunSpec
from packenv.experiments.words import USES, unused
from packenv.io.rows import read_rows
from packenv.sim.engines import is_there
from tests.cli.refusals import refused
from tests.experiments.other_run import other_run_at
from tests.shapes import cup

TIMES = ("cpu_s", "prepare_cpu_s", "seconds")


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven small items, one longer than the box."""
    folder = tmp_path_factory.mktemp("catalogue")
    trimesh.creation.box((0.10, 0.08, 0.05)).export(folder / "brick.ply")
    trimesh.creation.box((0.06, 0.05, 0.04)).export(folder / "small_brick.ply")
    trimesh.creation.box((0.12, 0.03, 0.03)).export(folder / "bar.ply")
    trimesh.creation.cylinder(0.03, 0.1, sections=24).export(folder / "can.ply")
    trimesh.creation.icosphere(2, 0.025).export(folder / "ball.ply")
    trimesh.creation.box((0.9, 0.02, 0.02)).export(folder / "pole.ply")
    beaker = cup(0.035, 0.08)
    trimesh.Trimesh(beaker.vertices, beaker.faces, process=False).export(folder / "beaker.ply")
    return folder


def _bench(name: str, catalogue: Path, out: Path, *more: str | Path) -> int:
    words = ["--catalogue", catalogue, "--items", 4, "--container", "0.2x0.2x0.15", "--out", out]
    return main(["bench", name, *map(str, (*words, "--no-report", *more))])


def _rows(out: Path, kind: str = "planning") -> dict[str, Mapping[str, Any]]:
    """Rows of a file without what a clock told, by key."""
    rows = read_rows(out / f"{kind}.jsonl")
    return {row["key"]: {name: row[name] for name in row if name not in TIMES} for row in rows}


FEW = ("--orders", "3", "--methods", "hm", "minz", "--settings", "default", "--constraints", "overlap")


def test_the_same_command_again_does_nothing_and_prints_the_same(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path / "h", *FEW) == 0
    first = capsys.readouterr().out
    content = (tmp_path / "h/planning.jsonl").read_bytes()
    assert "HM" in first
    assert "MinZ" in first
    assert _bench("heuristics", catalogue, tmp_path / "h", *FEW) == 0
    assert capsys.readouterr().out == first
    assert (tmp_path / "h/planning.jsonl").read_bytes() == content


def test_rows_say_how_they_were_made_and_lines_what_they_are_of(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert [line["method"] for line in document["rows"]] == ["hm", "minz"]
    for line in document["rows"]:
        assert line["constraints"] == "overlap"
        assert line["n"] == 3
        assert line["success"] == 1.0
        low, high = line["ci95"]
        assert 0.0 < low < high <= 1.0
        assert line["cpu_s_median"] > 0.0
    rows = list(read_rows(tmp_path / "planning.jsonl"))
    assert len(rows) == 3 * 4  # witnesses of feasibility, too
    for row in rows:
        assert row["status"] == "ok"
        assert row["options"]["heuristic"] == row["method"]
        assert row["revision"] in document["revisions"]
        assert "pole" not in row["order"]
        assert row["overlaps"] == row["protrusions"] == row["blocked"] == 0


def test_more_orders_go_on_from_fewer(catalogue: Path, tmp_path: Path) -> None:
    few = ("--methods", "hm", "--settings", "default", "--constraints", "overlap")
    assert _bench("heuristics", catalogue, tmp_path, "--orders", "2", *few) == 0
    before = (tmp_path / "planning.jsonl").read_bytes()
    assert _bench("heuristics", catalogue, tmp_path, "--orders", "3", *few) == 0
    after = (tmp_path / "planning.jsonl").read_bytes()
    assert after.startswith(before)
    assert after.count(b"\n") * 2 == before.count(b"\n") * 3


def test_shards_make_the_rows_of_the_whole(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path / "whole", *FEW) == 0
    for shard in ("1/2", "2/2"):
        assert _bench("heuristics", catalogue, tmp_path / "parts", *FEW, "--shard", shard) == 0
    capsys.readouterr()
    merge = ["bench", "merge", str(tmp_path / "parts"), "--out", str(tmp_path / "parts"), "--no-report"]
    assert main([*merge, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["missing_jobs"] == 0
    assert [line["n"] for line in document["rows"]] == [3, 3]
    assert _rows(tmp_path / "parts") == _rows(tmp_path / "whole")


def test_a_shard_leaves_rows_and_no_result_that_stands_for_the_whole(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--catalogue", str(catalogue), "--items", "4", "--out", str(tmp_path), *FEW]
    assert main(["bench", "heuristics", *words, "--shard", "1/2"]) == 0
    assert "robotpack bench merge writes the report" in capsys.readouterr().err
    assert {path.suffix for path in tmp_path.iterdir()} == {".jsonl", ".json", ".lock"}
    assert [path.name for path in tmp_path.glob("*.json")] == ["heuristics.spec.json"]


def test_a_missing_shard_is_told(catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _bench("heuristics", catalogue, tmp_path / "a", *FEW, "--shard", "1/2") == 0
    capsys.readouterr()
    assert main(["bench", "merge", str(tmp_path / "a"), "--out", str(tmp_path / "b"), "--no-report"]) == 1
    assert "4 jobs have no row yet" in capsys.readouterr().err


@pytest.mark.parametrize("workers", ["1", "2"])
def test_rows_are_the_same_on_any_number_of_workers(catalogue: Path, tmp_path: Path, workers: str) -> None:
    assert _bench("heuristics", catalogue, tmp_path / "serial", *FEW, "--backend", "serial") == 0
    pool = ("--backend", "pebble", "--workers", workers)
    assert _bench("heuristics", catalogue, tmp_path / "pool", *FEW, *pool) == 0
    assert _rows(tmp_path / "pool") == _rows(tmp_path / "serial")


def test_fallback_and_heuristics_share_their_rows(catalogue: Path, tmp_path: Path) -> None:
    few = ("--orders", "2", "--methods", "hm", "--settings", "default", "--constraints", "robot")
    assert _bench("heuristics", catalogue, tmp_path, *few) == 0
    before = (tmp_path / "planning.jsonl").read_bytes()
    assert _bench("fallback", catalogue, tmp_path, *few) == 0
    assert (tmp_path / "planning.jsonl").read_bytes() == before


def test_small_orders_and_the_5d_search_give_their_tables(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ("--orders", "2", "--methods", "hm", "--settings", "default", "--json")
    assert _bench("small-orders", catalogue, tmp_path, *few) == 0
    (line,) = json.loads(capsys.readouterr().out)["rows"]
    assert (line["method"], line["n"], line["paper_success"], line["paper_s"]) == ("hm", 2, 1.0, 8.54)
    assert sum(int(part.split()[-1]) for part in line["figures"]["boxes"].split(", ")) == 2
    assert _bench("search5d", catalogue, tmp_path, "--orders", "1", "--settings", "default", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert [line["method"] for line in document["rows"]] == ["prioritized", "5d alone"]
    (comparison,) = document["comparisons"]
    assert comparison["n"] == 1


def test_orders_of_unseen_items_are_lines_of_their_own(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = tmp_path / "names"
    names.write_text("ball\nbrick\nbar\ncan\n")
    assert _bench("heuristics", catalogue, tmp_path / "h", *FEW, "--unseen", str(names), "--json") == 0
    lines = json.loads(capsys.readouterr().out)["rows"]
    assert [(line["method"], line["items"]) for line in lines] == [
        ("hm", "all"),
        ("minz", "all"),
        ("hm", "unseen"),
        ("minz", "unseen"),
    ]
    own = [row for row in read_rows(tmp_path / "h/planning.jsonl") if row["items"] == "unseen"]
    assert {name for row in own for name in row["order"]} == {"ball", "brick", "bar", "can"}


@pytest.mark.parametrize("name", ["heuristics", "fallback", "search5d"])
def test_what_the_paper_reports_stands_beside_orders_of_its_size_alone(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    few = ("--orders", "1", "--methods", "hm", "--settings", "default", "--json")
    for more in ((), ("--items", "10", "--container", "0.32x0.32x0.30")):
        assert _bench(name, catalogue, tmp_path, *few, *more) == 0
        lines = json.loads(capsys.readouterr().out)["rows"]
        told = [line["paper_s"] is not None or "paper: of these 5D, %" in line["figures"] for line in lines]
        assert told == [bool(more)] * len(lines) != []


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--methods", "hmm"), ("hmm", "hm")),
        (("--columns", "papr"), ("--columns", "papr", "paper")),
        (("--settings", "papre"), ("papre", "paper")),
        (("--container", "0.2x0.2"), ("0.2x0.2",)),
        (("--shard", "3/2"), ("--shard 3/2", "2/8")),
        (("--ray-address", "auto"), ("--ray-address", "--backend ray")),
        (("--unseen", "nothing-here"), ("--unseen nothing-here", "second-half")),
        (("--catalogue", "nowhere"), ("nowhere",)),
    ],
)
def test_a_mistake_is_one_line(
    catalogue: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    told: tuple[str, ...],
) -> None:
    refused(capsys, _bench("heuristics", catalogue, tmp_path / "out", *more), *told)
    assert not (tmp_path / "out").exists()


def test_the_5d_search_is_not_asked_for_twice(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = _bench("search5d", catalogue, tmp_path / "out", "--settings", "default,search=5d")
    refused(capsys, code, "default,search=5d", "without it")


def test_workers_that_are_not_there_are_told(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = (
        "--orders",
        "1",
        "--methods",
        "hm",
        "--settings",
        " default",
        "--constraints",
        "overlap",
        "--workers",
        "2",
    )
    assert _bench("heuristics", catalogue, tmp_path, *one, "--backend", "serial") == 0
    assert "--workers 2: all jobs are done in this process" in capsys.readouterr().err
    content = (tmp_path / "planning.jsonl").read_bytes()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    one = (*one[:5], "default", *one[6:])
    assert _bench("heuristics", catalogue, tmp_path, *one) == 0
    assert "pip install 'robotpack[bench]'" in capsys.readouterr().err
    assert (tmp_path / "planning.jsonl").read_bytes() == content  # a setting with spaces is the same


def test_a_report_of_an_older_revision_says_that_its_plans_are_made_again(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW) == 0
    path = tmp_path / "planning.jsonl"
    told = "Plans that are shown were made again by revision"
    for older in (False, True):
        if older:
            rows = [{**row, "revision": "0.1+older"} for row in read_rows(path)]
            path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        assert main(["bench", "report", str(tmp_path)]) == 0
        assert (told in (tmp_path / "report.html").read_text(encoding="utf-8")) == older
        assert told not in capsys.readouterr().out  # where nothing is shown


def test_a_box_that_takes_no_item_is_a_mistake(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = _bench("heuristics", catalogue, tmp_path, "--container", "0.02x0.02x0.02")
    refused(capsys, code, "none of its items", "0.02x0.02x0.02", "--container")
    assert not list(tmp_path.iterdir())


def test_folders_that_hold_no_run_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, main(["bench", "report", str(tmp_path)]), str(tmp_path), "robotpack bench")
    refused(capsys, main(["bench", "merge", str(tmp_path), "--out", str(tmp_path / "b")]), str(tmp_path))


def test_shards_of_different_runs_do_not_merge(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, orders in (("a", "1"), ("b", "2")):
        words = ("--methods", "hm", "--settings", "default", "--constraints", "overlap", "--orders", orders)
        assert _bench("heuristics", catalogue, tmp_path / name, *words, "--shard", "1/2") == 0
    capsys.readouterr()
    folders = [str(tmp_path / name) for name in "ab"]
    refused(capsys, main(["bench", "merge", *folders, "--out", str(tmp_path / "c")]), str(tmp_path / "b"))
    assert not (tmp_path / "c").exists()


def test_a_run_that_is_refused_leaves_what_the_other_one_was_asked_for(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW) == 0
    spec = (tmp_path / "heuristics.spec.json").read_bytes()
    capsys.readouterr()
    with other_run_at(tmp_path / "planning.jsonl"):
        refused(
            capsys, _bench("heuristics", catalogue, tmp_path, *FEW, "--seed", "1"), "another run writes it"
        )
    assert (tmp_path / "heuristics.spec.json").read_bytes() == spec


def test_nothing_is_merged_into_rows_that_a_run_writes(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW) == 0
    capsys.readouterr()
    with other_run_at(tmp_path / "planning.jsonl"):
        code = main(["bench", "merge", str(tmp_path), "--out", str(tmp_path), "--no-report"])
        refused(capsys, code, "another run writes it")


def test_a_report_of_several_revisions_is_of_the_last_one_where_it_has_rows(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW) == 0
    path = tmp_path / "planning.jsonl"
    rows = list(read_rows(path))
    older = [{**row, "revision": f"{kind}-older"} for kind in ("a", "z") for row in rows]
    path.write_text("".join(json.dumps(row) + "\n" for row in [*older, *rows]))
    capsys.readouterr()
    refused(capsys, main(["bench", "report", str(tmp_path), "--no-report"]), "a-older", "--any-revision")
    assert main(["bench", "report", str(tmp_path), "--no-report", "--any-revision", "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["revisions"] == [rows[0]["revision"]]
    assert "older" not in printed.err


def test_a_report_of_a_run_that_was_stopped_says_what_is_missing(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench("heuristics", catalogue, tmp_path, *FEW) == 0
    path = tmp_path / "planning.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-2]))
    # an experiment that was stopped before its first row
    asked = json.loads((tmp_path / "heuristics.spec.json").read_text())
    (tmp_path / "robustness.spec.json").write_text(json.dumps({**asked, "orders": 1}))
    capsys.readouterr()
    report = ["bench", "report", str(tmp_path)]
    assert main(report) == 1
    assert "2 jobs have no row yet" in capsys.readouterr().out
    for name in ("report.md", "report.html"):
        assert "2 jobs have no row yet" in (tmp_path / name).read_text(encoding="utf-8")
    assert main([*report, "--no-report", "--json"]) == 1
    results = json.loads(capsys.readouterr().out)["results"]
    assert [result["missing_jobs"] for result in results] == [2, 4]


def test_a_report_of_shards_says_how_they_are_merged(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "two parts"
    assert _bench("heuristics", catalogue, out, *FEW, "--shard", "1/2") == 0
    capsys.readouterr()
    refused(capsys, main(["bench", "report", str(out)]), f"robotpack bench merge '{out}' --out '{out}'")


@pytest.mark.parametrize("name", [*EXPERIMENTS, *FURTHER])
def test_jobs_depend_on_the_options_that_an_experiment_uses_and_on_no_others(
    catalogue: Path, name: str
) -> None:
    asked = RunSpec(
        str(catalogue), orders=1, items=3, methods=("hm",), settings=("default",), columns=("script",)
    )
    others: dict[str, Any] = {
        "items": 4,
        "container": (0.3, 0.3, 0.2),
        "methods": ("auto", "gls"),
        "constraints": ("robot",),
        "settings": ("default,restarts=0",),
        "gls_plans": 7,
        "columns": ("pack",),
        "engine": "mujoco",
    }
    each = experiment(name)
    if name == "engines" and not is_there("bullet"):
        pytest.skip("needs both engines")

    def keys(spec: RunSpec) -> set[str]:
        each.prepare(spec, str(catalogue / "run"))
        return {job.key for job in each.jobs(spec)}

    if name == "heuristics":
        asked = replace(asked, methods=("hm", "gls"))
    differ = {
        field for field, value in others.items() if keys(replace(asked, **{field: value})) != keys(asked)
    }
    # "auto" is one of the engines, and may be this one
    assert differ | {"engine"} == USES[name] | {"engine"}
    for field, value in others.items():
        told = unused(name, replace(RunSpec(), **{field: value}))
        assert told == ([] if field in USES[name] else [f"--{field.replace('_', '-')}"])


def test_what_an_experiment_has_no_use_for_is_told(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ("--orders", "1", "--settings", "default")
    assert _bench("fallback", catalogue, tmp_path, *few, "--methods", "hm", "--columns", "pack") == 0
    assert "fallback has no use for --methods, --columns" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "methods", "settings"), [("heuristics", "minz", "paper"), ("small-orders", "gls", "default")]
)
def test_a_method_that_is_not_run_is_told(
    catalogue: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    methods: str,
    settings: str,
) -> None:
    asked = ("--methods", methods, "--settings", settings, "--orders", "1")
    assert _bench(name, catalogue, tmp_path, *asked, "--constraints", "overlap") == 0
    assert f"{name}: has no job for --methods {methods} with --settings {settings}" in capsys.readouterr().err


def test_failures_are_those_of_the_methods_that_were_asked_for(
    catalogue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ("--orders", "1", "--methods", "minz", "--settings", "default", "--constraints", "overlap")
    full = ("--items", "30", "--container", "0.13x0.10x0.06")  # more than fits
    assert _bench("heuristics", catalogue, tmp_path, *few, *full, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert len(list(read_rows(tmp_path / "planning.jsonl"))) == 4
    assert [failure["method"] for failure in document["failures"]] == ["minz"]
    assert document["rows"] == []  # no method packs it


@pytest.mark.parametrize(
    ("words", "workers"),
    [
        ((), 1),
        (("--workers", "3"), 3),
        (("--backend", "ray"), 1),
        (("--backend", "ray", "--ray-address", "auto"), None),
        (("--backend", "ray", "--ray-address", "auto", "--workers", "5"), 5),
    ],
)
def test_a_cluster_is_used_whole_unless_workers_are_named(
    words: tuple[str, ...], workers: int | None
) -> None:
    assert _pool(command_line().parse_args(["bench", "heuristics", *words])).workers == workers
