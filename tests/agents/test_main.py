"""The command line: mistakes end in one line and code 2."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from packenv.agents.__main__ import main, read_document
from packenv.errors import InputError


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--agent", "hmm"], "agent 'hmm' is not known; did you mean 'hm'?"),
        (["--agent", "hm,,dblf"], "agent '' is not known"),
        (["--agent", "hm,dblf,hm"], "names hm more than once"),
        (["--agent", "learned"], "agent learned: needs --weights"),
        (["--agent", "hm", "--weights", "somewhere"], "for the agent learned"),
        (["--agent", "hm", "--trust"], "for the agent learned"),
        (["--agent", "hm", "--env-config", '{"mask": '], "--env-config: is not JSON"),
        (["--agent", "hm", "--env-config", '{"masks": "legal"}'], "did you mean 'mask'?"),
        (["--agent", "hm", "--env-config", '{"mask": "leagl"}'], "mask is 'leagl'"),
        (
            ["--agent", "hm", "--env-config", "no-such-file"],
            "--env-config no-such-file: cannot be read (No such file",
        ),
        (["--agent", "hm", "--order-generator", '{"kind": "randon"}'], "randon"),
        (["--agent", "hm", "--order-generator", "{}x"], "line 1 column 3"),
        (["--agent", "hm", "--env-config", '{"catalogue": "no-such-folder"}'], "no-such-folder"),
    ],
)
def test_a_mistake_ends_in_one_line_and_code_2(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--episodes", "1"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("agents: ")
    assert printed.err.count("\n") == 1
    assert said in printed.err


@pytest.mark.parametrize("arguments", [["--episodes", "0"], ["--workers", "-1"], ["--seed", "-3"], []])
def test_numbers_out_of_range_end_in_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([*(["--agent", "hm"] if arguments else []), *arguments])
    assert end.value.code == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("content", [b"[1]", b"3", b"\xff\xfe", b"", b'{"a"'])
def test_a_file_that_holds_no_mapping_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "settings.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"^--env-config .*settings\.json: is "):
        read_document(str(path), "--env-config")


def test_a_mapping_may_be_written_out_or_be_a_file(tmp_path: Path) -> None:
    text = json.dumps({"mask": "legal", "containers": [[0.3, 0.3, 0.3]]}, indent=1)
    path = tmp_path / "settings.json"
    path.write_text(text)
    assert read_document(str(path), "x") == read_document("  " + text, "x") == json.loads(text)


def test_a_file_of_something_else_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("my notes")
    assert main(["--agent", "hm", "--episodes", "1", "--out", str(path)]) == 2
    assert "notes.txt, line 1: is no row of results" in capsys.readouterr().err
    assert path.read_text() == "my notes"


def test_own_agents_and_generators_go_by_module_and_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own_agents_of_mine.py").write_text(
        "from packenv.env.orders import GeneratedOrder\n"
        "class Deferrer:\n"
        "    def act(self, obs, info):\n"
        "        return len(obs['action_mask']) - 1\n"
        "    def reset(self, seed=None):\n"
        "        pass\n"
        "class Soap:\n"
        "    def generate(self, rng):\n"
        "        return GeneratedOrder(('soap_bar', 'golf_ball'))\n"
    )
    monkeypatch.chdir(tmp_path)
    options = ["--env-config", '{"mask": "legal"}', "--episodes", "1", "--json"]
    agent, orders = "own_agents_of_mine:Deferrer", "own_agents_of_mine:Soap"
    assert main(["--agent", f"hm,{agent}", "--order-generator", orders, *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["order_generator"] == orders
    assert [row["agent"] for row in told["agents"]] == ["hm", agent]
    assert told["agents"][0]["packed_share"]["mean"] == 1.0
    assert told["agents"][1]["packed_share"]["mean"] == 0.0
    assert main(["--agent", "own_agents_of_mine:Nobody", *options]) == 2
    assert "own_agents_of_mine has no 'Nobody'" in capsys.readouterr().err
