"""The terminal's table: a line a Line, with its numbers, aligned."""

from __future__ import annotations

import subprocess
import sys

import pytest

from packenv.experiments.report import text_table

from .samples import HOSTILE, comparison, line, result

PAPER = {"paper_success": 0.999, "paper_s": 15.7}


def test_every_line_is_a_line_with_its_numbers() -> None:
    text = text_table(result(line("hm", 19, **PAPER), line("dblf", 7, **PAPER), line("own:rule", 0)))
    (hm,) = (row for row in text.splitlines() if row.startswith("HM "))
    assert hm.split() == [
        "HM",
        "20",
        "95.0",
        "76.4",
        "to",
        "99.1",
        "99.9",
        "0.0313",
        "0.0412",
        "1.24",
        "15.7",
        "381",
    ]
    (dblf,) = (row for row in text.splitlines() if row.startswith("DBLF "))
    assert "35.0" in dblf.split()
    (own,) = (row for row in text.splitlines() if row.startswith("own:rule "))
    assert own.split()[-1] == "–", "the paper knows nothing of it"


def test_lines_end_in_one_column() -> None:
    text = text_table(result(line("hm", **PAPER), line("dblf", cpu_s_max=123.0, **PAPER)))
    hm, dblf = (row for row in text.splitlines() if row.startswith(("HM", "DBLF")))
    assert len(hm) == len(dblf)
    assert hm.index("0.0412") == dblf.index("0.0412")


def test_usual_tables_are_narrow() -> None:
    lines = [
        line(m, 1000, 1000, **PAPER, figures={"height, cm": 14.21, "fallback, %": 3.21})
        for m in ("hm", "minz", "gls")
    ]
    assert max(map(len, text_table(result(*lines)).splitlines())) < 120


def test_lines_are_grouped_by_what_each_method_was_run_under() -> None:
    lines = [line(m, constraints=c) for c in ("overlap", "robot") for m in ("hm", "mta")]
    rows = text_table(result(*lines)).splitlines()
    heads = [k for k, row in enumerate(rows) if row.startswith("[")]
    assert [rows[k] for k in heads] == [
        "[non-overlap · setting default]",
        "[all constraints · setting default]",
    ]
    assert heads[1] - heads[0] == 3


def test_what_belongs_to_the_method_is_a_column() -> None:
    lines = [
        line(m, constraints=c, world=w, setting="")
        for w in ("nominal", "disturbed")
        for m, c in (("overlap only", "overlap"), ("default", "robot"))
    ]
    rows = text_table(result(*lines)).splitlines()
    assert [row for row in rows if row.startswith("[")] == [
        "[nominal world]",
        "[disturbed world]",
    ]
    assert sum("all constraints" in row for row in rows) == 2


def test_figures_are_columns_and_what_is_missing_is_a_dash() -> None:
    text = text_table(
        result(
            line("hm", figures={"drop, cm": 1.357}), line("mta", figures={"shift, cm": None, "pieces": 12})
        )
    )
    hm, mta = (next(r.split() for r in text.splitlines() if r.startswith(m)) for m in ("HM", "MTA"))
    assert hm[-3:] == ["1.36", "–", "–"]
    assert mta[-3:] == ["–", "–", "12"]


def test_an_empty_result_and_one_order() -> None:
    assert "no orders to tell of" in text_table(result())
    assert "100.0" in text_table(result(line(hits=1, n=1)))


def test_no_text_commands_the_terminal() -> None:
    text = text_table(result(line(HOSTILE), title=HOSTILE, remarks=(HOSTILE,)))
    assert "\x1b" not in text
    assert "alert(1)" in text


def test_differences_are_told_after_holm() -> None:
    text = text_table(result(line(), comparisons=(comparison(), comparison(b="dblf", a_only=5))))
    assert "HM over MTA by 60.0 points" in text
    assert "HM over DBLF" not in text, "p = 0.06"
    assert "The other one is not." in text
    assert "No difference" in text_table(result(line(), comparisons=(comparison(a_only=1),)))


def test_broken_jobs_are_told() -> None:
    assert "2 jobs broke" in text_table(result(line(), broken=2))
    assert "broke" not in text_table(result(line()))


def test_it_needs_no_extra() -> None:
    code = (
        "import sys; sys.modules['matplotlib'] = sys.modules['jinja2'] = None\n"
        "from packenv.experiments.report import text_table\n"
        "from tests.experiments.report.samples import line, result\n"
        "print(text_table(result(line())))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "95.0" in done.stdout


@pytest.mark.parametrize("n", [1000, 10_000])
def test_one_failed_order_is_never_rounded_away(n: int) -> None:
    (hm,) = (row for row in text_table(result(line(hits=n - 1, n=n))).splitlines() if row.startswith("HM "))
    assert hm.split()[2] in ("99.9", "99.99")
