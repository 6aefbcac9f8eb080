"""Options of experiments on random orders."""

from __future__ import annotations

import pytest

from packenv.experiments.runs import order_options
from packenv.planning.search.heuristics import HEURISTICS


@pytest.mark.parametrize("name", ["HM", "nothing", ""])
def test_an_unknown_heuristic_is_refused_before_any_job(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--heuristics", "hm", name])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert all(known in said for known in HEURISTICS)


OWN = "examples.my_heuristic:flattest"


def test_own_heuristics_go_by_module_and_name() -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    assert parser.parse_args(["--heuristics", OWN]).heuristics == [OWN]


def test_every_heuristic_can_be_asked_for() -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    assert parser.parse_args(["--heuristics", *HEURISTICS]).heuristics == list(HEURISTICS)
