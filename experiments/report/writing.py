"""Put a report together and write it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.version import __version__
from packenv.watcher import SILENT, Watcher

from ..experiment import Row
from ..extras import require_extras
from ..results import Result
from .document import (
    PAGES,
    PICTURES,
    PLOTS,
    Block,
    Command,
    Document,
    Gallery,
    Heading,
    Plot,
    Plots,
    Points,
    Section,
    Text,
)
from .gallery import Pictures, Showcase, Shown
from .markdown import markdown_text
from .page import page_text
from .paper_figures import figures_section
from .plots import plots_of
from .sentences import summary
from .tables import Cell, Column, Group, Table, comparisons_table, failures_table, results_table
from .words import count, plain, printable

_FAILURES = 20
_READING = (
    "Success is the share of orders that are packed whole, or carried out; its 95 % interval is Wilson's: of 20 such "
    "intervals about 19 hold the rate behind them, and more orders make them narrower. All methods get the same "
    "orders, so two of them are compared order by order: p is the chance, by McNemar's exact test, of numbers so "
    "unlike if both were equally good. Holm's correction allows for the number of comparisons in a table. Intervals "
    "of differences and of time ratios (first by second, geometric mean) are bootstrapped over the orders. Columns "
    "on yellow are what the paper reports: other items, another machine, seconds of wall time. Ours are CPU-seconds."
)


def write_report(
    folder: Path,
    results: Sequence[Result],
    rows: Mapping[str, Sequence[Row]],
    pictures: Pictures,
    *,
    command: str,
    watcher: Watcher = SILENT,
) -> tuple[Path, ...]:
    """Write ``report.html``, a page by itself, and ``report.md``, whose plots and pictures are beside it.

    Where ``robotpack bench figures`` wrote into ``folder/figures``, the paper's figures are in them, too.

    Args:
        folder: where they go.
        results: of each experiment.
        rows: of each experiment, by its name.
        pictures: where plans come from that are shown.
        command: what makes the report again, a line for each command.
        watcher: is told of progress, and of plans that cannot be shown.

    Returns:
        all files that were written, the two reports first.

    Raises:
        InputError: a package is missing, or a file cannot be written.
    """
    require_extras("report.html and report.md", "jinja2", "matplotlib")
    commands = tuple(map(printable, command.splitlines()))
    for name in (PLOTS, PICTURES, PAGES):
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise InputError(f"{folder / name}: cannot be made ({problem.strerror})") from None
    showcase = Showcase(pictures, folder, watcher)
    sections, files = [_head(results, commands)], list[Path]()
    for result in results:
        own = rows.get(result.experiment, ())
        seen = showcase.of(result, own)
        plots = plots_of(result, own)
        sections.append(_experiment(result, plots, seen))
        content = {folder / PLOTS / f"{plot.name}.svg": plot.svg.encode() for plot in plots}
        content |= {folder / PICTURES / f"{shot.name}.png": shot.png for shot in seen.shots}
        for path, some in content.items():
            write_whole(path, some)
        files += [*content, *(folder / address for address in seen.pages.values())]
    if (figures := figures_section(folder)) is not None:
        sections.append(figures)
        for block in figures.blocks:
            if isinstance(block, Gallery):
                files += [folder / PICTURES / f"{shot.name}.png" for shot in block.shots]
                for shot in block.shots:
                    write_whole(folder / PICTURES / f"{shot.name}.png", shot.png)
    sections.append(_foot(commands))
    document = Document("RobotPack: the paper's experiments, and ours", tuple(sections))
    texts = {"report.html": page_text(document), "report.md": markdown_text(document)}
    for name, text in texts.items():
        write_whole(folder / name, text.encode())
    return (*(folder / name for name in texts), *dict.fromkeys(files))


def _head(results: Sequence[Result], commands: Sequence[str]) -> Section:
    """What was run, and what it says."""
    blocks: list[Block] = [Command(tuple(commands)), _run_table(results)]
    for result in results:
        said = summary(result)
        blocks += [Heading(plain(result.title)), Points(tuple(said) or ("No orders to tell of.",))]
    return Section("summary", "What was run, and what it says", tuple(blocks))


def _run_table(results: Sequence[Result]) -> Table:
    """What was asked for, once where all experiments agree."""
    told: dict[str, list[str]] = {}
    for result in results:
        spec = result.spec
        facts = {
            "catalogue": spec.catalogue,
            "orders asked for": f"{spec.orders:,}",
            "seed of the draw": str(spec.seed),
            "large order": f"{count(spec.items, 'item')} in {spec.box.full_label}",
            "constraints": ", ".join(spec.constraints),
            "settings": "; ".join(spec.settings),
            "items that nothing was tuned on": spec.unseen or "",
            "revision of RobotPack": ", ".join(result.revisions),
        }
        for name, fact in facts.items():
            if fact and fact not in told.setdefault(name, []):
                told[name].append(fact)
    broken = sum(result.broken for result in results)
    told["jobs that broke"] = [f"{broken:,}"]
    if missing := sum(result.missing for result in results):
        told["jobs without a row yet"] = [f"{missing:,}"]
    rows = tuple((Cell(name), Cell(plain("; ".join(facts)))) for name, facts in told.items() if facts)
    return Table("", (Column("this run", "name"), Column("", "text")), (Group("", rows),))


def _experiment(result: Result, plots: tuple[Plot, ...], seen: Shown) -> Section:
    """An experiment's table, plots, differences, pictures and failures."""
    blocks: list[Block] = []
    if result.lines:
        blocks.append(results_table(result))
    else:
        blocks.append(Text("No orders to tell of."))
    if result.remarks:
        blocks.append(Points(tuple(map(plain, result.remarks))))
    if plots:
        blocks.append(Plots(plots))
    if result.comparisons:
        blocks += [Heading("Differences on the same orders"), comparisons_table(result)]
    if seen.shots:
        blocks += [Heading("Packed boxes"), Gallery(seen.shots)]
    if result.failures:
        blocks += [Heading("What failed"), failures_table(result, seen.pages, _FAILURES)]
    if seen.left_out:
        blocks.append(Points(seen.left_out))
    return Section(f"experiment-{_anchor(result.experiment)}", plain(result.title), tuple(blocks))


def _anchor(name: str) -> str:
    return "".join(c if c.isalnum() and c.isascii() else "-" for c in name)


def _foot(commands: Sequence[str]) -> Section:
    """How to read it, and how to run it again."""
    return Section(
        "reading",
        "How to read this, and how to run it again",
        (
            Text(_READING),
            Command(("pip install 'robotpack[bench]'", *commands)),
            Text(
                "The same command with the same folder does only what has no row yet, and makes this report again. "
                f"It was made by RobotPack {__version__}."
            ),
        ),
    )
