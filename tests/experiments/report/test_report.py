"""report.html and report.md: all numbers in both, nothing from outside, nothing unescaped, the same every time."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from packenv import api
from packenv.experiments.report import write_report
from packenv.experiments.results import Result
from packenv.experiments.spec import RunSpec
from packenv.types import Container, Order, Plan
from packenv.watcher import Watcher

from .samples import HOSTILE, comparison, failure, line, result

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

PAPER = {"paper_success": 0.9871, "paper_s": 15.73}
COMMAND = "robotpack bench heuristics --orders 20 --out runs/h"


def row(key: str, index: int = 0, method: str = "hm", **words: Any) -> dict[str, Any]:
    told = {
        "key": key,
        "status": "ok",
        "method": method,
        "constraints": "overlap",
        "setting": "default",
        "items": "all",
        "index": index,
        "order": ["mug", "banana"],
        "boxes": ["0.2x0.2x0.2"],
        "complete": True,
        "container": "0.2x0.2x0.2",
        "routes": {"first-pass": 2},
        "cpu_s": 0.03 + 0.01 * index,
    }
    return {**told, **words}


class Plans:
    """Plans the row's order, which nothing is wrong with."""

    catalogue = "builtin"

    def plan_of(self, experiment: str, row: Mapping[str, Any]) -> Plan:
        return api.plan(Order.of(*row["order"]), Container(0.2, 0.2, 0.2), heuristic="minz", margins=False)


class NoPlans(Plans):
    def plan_of(self, experiment: str, row: Mapping[str, Any]) -> Plan:
        raise ArithmeticError(HOSTILE)


class Heard(Watcher):
    def __init__(self) -> None:
        self.remarks: list[str] = []

    def remark(self, text: str) -> None:
        self.remarks.append(text)


class Page(HTMLParser):
    """Tags that are open, all addresses, and the text."""

    VOID = ("meta", "img", "br", "link", "hr", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.identities: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "data", "action", "srcset", "poster"):
                self.addresses.append(value or "")
            if name == "id":
                self.identities.append(value or "")
            assert not name.startswith("on")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def written(
    folder: Path, *results: Result, rows: Mapping[str, Sequence[Any]] | None = None, pictures: Any = None
) -> tuple[Page, str]:
    files = write_report(folder, results, rows or {}, pictures or NoPlans(), command=COMMAND)
    assert files[:2] == (folder / "report.html", folder / "report.md")
    assert all(path.stat().st_size for path in files)
    page = Page(files[0].read_text(encoding="utf-8"))
    assert page.open == []
    return page, files[1].read_text(encoding="utf-8")


def cells(markdown: str) -> Iterator[list[str]]:
    """Rows of all Markdown tables, as GitHub splits them."""
    for text in markdown.splitlines():
        if text.startswith("|"):
            yield [cell.strip(" *") for cell in re.split(r"(?<!\\)\|", text)[1:-1]]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Page, str]:
    folder = tmp_path_factory.mktemp("report")
    found = result(
        line("hm", 19, **PAPER, figures={"height, cm": 14.23, "fallback, %": None}),
        line("mta", 7, cpu_s_mean=0.0777, figures={"height, cm": 21.07}),
        comparisons=(comparison(),),
        failures=(failure("k1", 1), failure("broken", 2, why="job timeout: took 1800 s")),
        remarks=("Of 25 orders 5 are left out.",),
        revisions=("0.1.0 abcdef",),
        broken=1,
    )
    rows = [
        row("k0"),
        row("k0-mta", method="mta"),
        row("k1", 1, "mta", complete=False),
        row("broken", 2, "mta", status="timeout", error="took 1800 s"),
    ]
    page, markdown = written(folder, found, rows={"heuristics": rows}, pictures=Plans())
    return folder, page, markdown


def test_every_number_is_in_both(usual: tuple[Path, Page, str]) -> None:
    _, page, markdown = usual
    hm = ["HM", "20", "95.0", "76.4 to 99.1", "98.7", "0.0313", "0.0412", "1.24", "15.7", "382", "14.2", "–"]
    mta = ["MTA", "20", "35.0", "18.1 to 56.7", "–", "0.0313", "0.0777", "1.24", "–", "–", "21.1", "–"]
    versus = ["HM against MTA", "20", "12", "0", "+60.0 (+50.0 to +70.0)", "< 0.001", "< 0.001", "yes"]
    table = [[cell.replace("\\", "") for cell in cells] for cells in cells(markdown)]
    for expected in (hm, mta, versus):
        assert any(cells[: len(expected)] == expected for cells in table)
        assert " ".join(expected) in page.text
    for told in ("Of 25 orders 5 are left out.", "0.1.0 abcdef", COMMAND, "took 1800 s", "too tall"):
        assert told in page.text
        assert told in markdown.replace("\\", "")


def test_what_it_says_is_made_of_the_numbers(usual: tuple[Path, Page, str], tmp_path: Path) -> None:
    _, page, _ = usual
    assert (
        "HM packs 95.0 % of 20 orders (95 % interval 76.4 to 99.1 %); the paper reports 98.7 %, inside"
        in page.text
    )
    assert "at least 382 times ours: 15.7 s against 0.0412 CPU-seconds by HM" in page.text
    assert "HM over MTA by 60.0 points" in page.text
    assert "1 job broke" in page.text
    other, _ = written(tmp_path, result(line("hm", 3, **PAPER)))
    assert "the paper reports 98.7 %, above the interval" in other.text
    assert "broke (" not in other.text


def test_nothing_is_loaded_or_run(usual: tuple[Path, Page, str]) -> None:
    _, page, markdown = usual
    assert not {"script", "iframe", "object", "embed", "link", "base"} & set(page.tags)
    for address in page.addresses:
        assert address.startswith(("data:image/png;base64,", "#", "report/pages/")), address
    for address in re.findall(r"\]\(([^)]*)\)", markdown):
        assert address.startswith("report/"), address
    assert len(page.identities) == len(set(page.identities)), "a part of one plot is none of another"


def test_all_that_is_linked_is_there(usual: tuple[Path, Page, str]) -> None:
    folder, page, markdown = usual
    linked = {a for a in page.addresses if a.startswith("report/")}
    assert linked == {"report/pages/heuristics-k1.html"}, "the plan that failed, and not the job that broke"
    assert linked <= set(re.findall(r"\]\(([^)]*)\)", markdown))
    for address in re.findall(r"\]\(([^)]*)\)", markdown):
        assert (folder / address).is_file()
    viewer = (folder / "report/pages/heuristics-k1.html").read_text(encoding="utf-8")
    assert "Content-Security-Policy" in viewer
    assert "banana" in viewer


def test_pictures_and_plots_are_inside(usual: tuple[Path, Page, str]) -> None:
    folder, page, _ = usual
    (inside,) = (a for a in page.addresses if a.startswith("data:"))
    picture = base64.b64decode(inside.partition(",")[2])
    assert picture == (folder / "report/pictures/heuristics-k0.png").read_bytes()
    assert page.tags.count("svg") == 2
    assert "Order 0 by HM: 2 items in 0.2x0.2x0.2 m: mug, banana" in page.text
    # What a plot shows is also text: labels, and the legend.
    assert {"HM", "MTA", "paper", "success, %"} <= set(page.words)


def test_the_same_twice(usual: tuple[Path, Page, str], tmp_path: Path) -> None:
    found = result(line(), line("mta", 4), failures=(failure("k1", 1),))
    rows = {"heuristics": [row("k0"), row("k1", 1, "mta", complete=False)]}
    for name in ("a", "b"):
        write_report(tmp_path / name, [found], rows, Plans(), command=COMMAND)
    first, second = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in (tmp_path / "a", tmp_path / "b")
    )
    assert len(first) == 6
    assert first == second


def test_no_text_is_obeyed(tmp_path: Path) -> None:
    found = result(
        line(HOSTILE, constraints=HOSTILE, setting=HOSTILE, figures={HOSTILE: HOSTILE}, **PAPER),
        line("hm", items=HOSTILE),
        title=HOSTILE,
        experiment="../../" + HOSTILE,
        comparisons=(comparison(a=HOSTILE),),
        failures=(failure(f"../{HOSTILE}", method=HOSTILE, why=HOSTILE),),
        remarks=(HOSTILE,),
        revisions=(HOSTILE,),
    )
    rows = [row(f"../{HOSTILE}", method=HOSTILE, order=[HOSTILE], setting=HOSTILE, constraints=HOSTILE)]
    heard = Heard()
    files = write_report(
        tmp_path / "in", [found], {found.experiment: rows}, NoPlans(), command=HOSTILE, watcher=heard
    )
    assert {path.resolve().relative_to(tmp_path / "in") for path in files}
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
    page = Page(files[0].read_text(encoding="utf-8"))
    assert "script" not in page.tags
    assert '<script src="https://evil.example/x.js">alert(1)</script> | a_b *c* `d` ' in page.text
    markdown = files[1].read_text(encoding="utf-8")
    text = "\n".join(line for line in markdown.splitlines() if not line.startswith("    "))
    assert not re.search(r"(?<!\\)<", text)
    assert "://" not in text
    tables = [[*cells(part)] for part in markdown.split("\n\n") if part.startswith("|")]
    assert len(tables) == 5
    assert all(len({len(row) for row in table}) == 1 for table in tables), "a bar in a name makes no column"
    assert "\x1b" not in markdown + page.text
    assert len(heard.remarks) == 2, "the picture and the page that could not be made"


def test_what_cannot_be_planned_again_is_left_out_with_a_remark(tmp_path: Path) -> None:
    heard = Heard()
    rows = {"heuristics": [row("k0", 4)]}
    write_report(tmp_path, [result(line())], rows, NoPlans(), command=COMMAND, watcher=heard)
    (remark,) = heard.remarks
    assert remark.startswith("Order 4 by HM is not shown: ")
    assert "Order 4 by HM is not shown" in (tmp_path / "report.md").read_text(encoding="utf-8")
    assert not list((tmp_path / "report/pictures").iterdir())


def test_rows_of_two_experiments_are_drawn_once(tmp_path: Path) -> None:
    rows = [row("k0"), row("k1", 1, complete=False)]
    both = [
        result(line(), experiment=name, failures=(failure("k1", 1),)) for name in ("heuristics", "fallback")
    ]
    page, _ = written(tmp_path, *both, rows=dict.fromkeys(("heuristics", "fallback"), rows), pictures=Plans())
    assert page.tags.count("img") == 1
    assert page.addresses.count("report/pages/heuristics-k1.html") == 2
    assert [path.name for path in (tmp_path / "report/pages").iterdir()] == ["heuristics-k1.html"]


@pytest.mark.parametrize("lines", [(), (line(hits=1, n=1),), (line(hits=0, n=1, cpu_s_mean=0.0, **PAPER),)])
def test_few_orders(tmp_path: Path, lines: tuple[Any, ...]) -> None:
    page, markdown = written(tmp_path, result(*lines))
    for text in (page.text, markdown.lower()):
        assert ("no orders to tell of" in text.lower()) == (not lines)


def test_only_some_failures_are_listed_and_all_are_counted(tmp_path: Path) -> None:
    found = result(line(), failures=tuple(failure(f"k{k}", 1000 + k) for k in range(33)))
    page, markdown = written(tmp_path, found)
    assert "33 failures, the first 20 of them" in page.text
    assert sum(cells[0].startswith("1,0") for cells in cells(markdown)) == 20


def test_executions_have_their_own_plots(tmp_path: Path) -> None:
    def execution(index: int, success: bool) -> dict[str, Any]:
        told = {"success": success, "drop_m": [0.01 + 0.001 * index] * 3, "shift_m": [0.002], "cpu_s": 2.0}
        return row(
            f"k{index}", index, "closed loop", planned=False, nominal=told, disturbed=told, complete=False
        )

    lines = [
        line("closed loop", world=world, figures={"drop, cm": 1.15, "paper: drop, cm": 1.36})
        for world in ("nominal", "disturbed")
    ]
    rows = {"execution": [execution(k, k > 1) for k in range(4)]}
    page, _ = written(tmp_path, result(*lines, experiment="execution"), rows=rows)
    names = sorted(path.name for path in (tmp_path / "report/plots").iterdir())
    assert names == [f"execution-{kind}-1.svg" for kind in ("drop", "shift", "success")]
    assert "plans of “closed loop” are carried out in 95.0 % of 20 orders" in page.text
    assert "drop 1.15 cm (paper 1.36)" in page.text
    assert {"nominal world", "disturbed world", "drop, cm"} <= set(page.words)


def test_many_orders_make_no_large_plot(tmp_path: Path) -> None:
    rows = {"heuristics": [row(f"k{k}", k, cpu_s=0.01 * 1.001**k, complete=False) for k in range(5000)]}
    written(tmp_path, result(line(hits=0, n=5000)), rows=rows)
    assert (tmp_path / "report/plots/heuristics-time-1.svg").stat().st_size < 50_000


def test_routes_of_the_fallback(tmp_path: Path) -> None:
    rows = {"fallback": [row("k0", routes={"first-pass": 7, "later": 2, "5d": 1})]}
    page, _ = written(tmp_path, result(line(), experiment="fallback"), rows=rows)
    assert {"later in the sequence", "5D search", "paper"} <= set(page.words)
    assert "of 10 items" in page.text
    fewer, _ = written(tmp_path, result(line(), experiment="fallback", spec=RunSpec(items=4)), rows=rows)
    assert "5D search" in fewer.words
    assert "paper" not in fewer.words


def test_times_of_both_searches(tmp_path: Path) -> None:
    rows = {"search5d": [row("k0"), row("k1", setting="default,search=5d")]}
    lines = line("prioritized"), line("5d alone", paper_s=522.0)
    page, _ = written(tmp_path, result(*lines, experiment="search5d"), rows=rows)
    drawn = Page((tmp_path / "report/plots/search5d-time-1.svg").read_text(encoding="utf-8"))
    assert {"prioritized", "5d alone", "paper's means"} <= set(drawn.words)
    assert "; 1 of each method" in page.text
    assert "5d alone 522 s" in page.text


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
def test_a_missing_package_is_one_line(tmp_path: Path, package: str) -> None:
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from packenv.experiments.report import write_report\n"
        "from packenv.errors import InputError\n"
        "from pathlib import Path\n"
        "try:\n"
        f"    write_report(Path({str(tmp_path)!r}), [], {{}}, None, command='')\n"
        "except InputError as problem:\n"
        "    print(problem)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.endswith(f"{package}, which is not installed: pip install 'robotpack[bench]'\n"), (
        done.stderr
    )
    assert not list(tmp_path.iterdir())
