"""The folder of a run: shards, and how they come together."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from packenv.errors import InputError
from packenv.experiments.folder import RunFolder, Shard, merge_rows
from packenv.experiments.spec import RunSpec
from packenv.experiments.words import commands_of


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_every_order_is_in_one_shard(count: int) -> None:
    shards = [Shard(k, count) for k in range(1, count + 1)]
    for index in range(40):
        assert sum(index in shard for shard in shards) == 1


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "a/b", "1/0", "-1/2"])
def test_what_is_no_part_of_a_whole_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        Shard.parse(text)


def _write(path: Path, *rows: dict[str, object]) -> Path:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_merging_keeps_each_job_once_and_sound_rows_first(tmp_path: Path) -> None:
    bad = {"key": "a", "revision": "r", "error": "x"}
    good = {"key": "a", "revision": "r", "n": 1}
    other = {"key": "b", "revision": "r", "n": 2}
    older = {"key": "a", "revision": "q", "n": 3}
    files = [_write(tmp_path / "1", bad, other), _write(tmp_path / "2", good, older)]
    whole = tmp_path / "whole"
    assert merge_rows(files, whole) == 3
    rows = [json.loads(line) for line in whole.read_text().splitlines()]
    assert sorted(rows, key=str) == sorted([good, other, older], key=str)
    before = whole.read_bytes()
    assert merge_rows([whole, *files], whole) == 3  # merged again it is the same
    assert whole.read_bytes() == before


def test_a_foreign_file_is_not_merged(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    with pytest.raises(InputError, match="no row of results"):
        merge_rows([_write(tmp_path / "1", {"name": "b"})], whole)
    assert not whole.exists()


def test_a_folder_remembers_what_was_asked_for(tmp_path: Path) -> None:
    spec = RunSpec(catalogue="x", orders=7, methods=("hm",), container=(0.4, 0.3, 0.2), settings=("default",))
    folder = RunFolder(tmp_path / "run")
    folder.keep_spec("heuristics", spec)
    assert folder.specs() == {"heuristics": spec}
    (folder.path / "heuristics.spec.json").write_text('{"ordres": 3}')
    with pytest.raises(InputError, match="did you mean 'orders'"):
        folder.specs()


def test_the_command_that_is_told_asks_for_the_same() -> None:
    from packenv.cli.parser import command_line
    from packenv.experiments.command import spec_of

    spec = RunSpec(
        catalogue="my parts",
        unit="mm",
        orders=7,
        seed=3,
        methods=("hm", "gls"),
        container=(0.4, 0.33333333, 0.2),
        settings=("default,grasp=paper",),
        unseen="second-half",
    )
    import shlex

    (command,) = commands_of({"heuristics": spec}, Path("runs/h"))
    program, *words = shlex.split(command)
    assert program == "robotpack"
    arguments = command_line().parse_args(words)
    assert spec_of(arguments) == spec
    assert arguments.out == Path("runs/h")
