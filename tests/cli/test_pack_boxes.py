"""``robotpack pack --boxes-max``: a file for each box, and none of them over a file that is read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import packenv as rp
from packenv.cli import main
from tests.cli.refusals import refused
from tests.mesh_samples import write_three

SIZE = ["--container", "0.1x0.08x0.05", "--constraints", "overlap", "--cell-size", "0.005"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_three(tmp_path)
    (tmp_path / "order.csv").write_text("item,qty\nbook,2\nbrick,1\n")
    return tmp_path


def pack(folder: Path, *words: object) -> int:
    return main(["pack", str(folder / "order.csv"), "--catalogue", str(folder), *SIZE, *map(str, words)])


def test_each_box_has_files_of_its_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {
        option: folder / f"p{suffix}"
        for option, suffix in (("out", ".json"), ("html", ".html"), ("png", ".png"))
    }
    words = [word for option, path in files.items() for word in (f"--{option}", path)]
    assert pack(folder, "--boxes-max", 4, *words) == 0
    printed = capsys.readouterr().out
    assert (
        printed.splitlines()[-1] == "3 boxes: 0.1x0.08x0.05 m, 0.1x0.08x0.05 m, 0.1x0.08x0.05 m: 3 of 3 items"
    )
    for path in files.values():
        assert not path.exists()
        for k in (1, 2, 3):
            numbered = path.with_stem(f"p-{k}")
            assert numbered.stat().st_size > 100
            assert f"wrote {numbered}" in printed
    packed = []
    for k in (1, 2, 3):
        assert main(["verify", str(folder / f"p-{k}.json")]) == 0
        plan = rp.load_plan(folder / f"p-{k}.json")
        packed += [p.item for p in plan.placements]
        assert plan.complete
    assert sorted(packed) == ["book", "book", "brick"]


def test_one_box_has_the_names_that_were_given(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "order.csv").write_text("item\nbook\n")
    assert pack(folder, "--boxes-max", 3, "--out", folder / "many.json") == 0
    assert pack(folder, "--out", folder / "one.json") == 0
    assert (folder / "many.json").read_bytes() == (folder / "one.json").read_bytes()
    assert "boxes:" not in capsys.readouterr().out


def test_json_is_a_list_of_plans_where_several_boxes_are_allowed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pack(folder, "--boxes-max", 2, "--json") == 1
    plans = json.loads(capsys.readouterr().out)
    assert [len(plan["steps"]) for plan in plans] == [1, 1]
    assert [len(plan["leftovers"]) for plan in plans] == [0, 1]
    (folder / "order.csv").write_text("item\nbook\n")
    assert pack(folder, "--boxes-max", 2, "--json") == 0
    assert len(json.loads(capsys.readouterr().out)) == 1
    assert pack(folder, "--boxes-max", 1, "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["steps"]) == 1


@pytest.mark.parametrize("number", [1, 3])
def test_no_numbered_file_replaces_one_that_is_read(
    number: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = folder / f"p-{number}.json"
    order.write_text(json.dumps(["book", "book", "brick"]))
    words = [str(order), "--catalogue", str(folder), *SIZE, "--out", str(folder / "p.json")]
    refused(capsys, main(["pack", *words, "--boxes-max", "3"]), f"--out of box {number}", "which is read")
    assert not (folder / "p.json").exists()
    if number == 3:
        assert main(["pack", *words, "--boxes-max", "2"]) == 1
    assert json.loads(order.read_text()) == ["book", "book", "brick"]


@pytest.mark.parametrize("word", ["0", "-1", "two", "1.5"])
def test_a_number_of_boxes_that_is_none_is_refused(
    word: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        pack(folder, f"--boxes-max={word}")
    assert ended.value.code == 2
    assert "--boxes-max" in capsys.readouterr().err
