"""What a result says, in sentences that are made of its numbers."""

from __future__ import annotations

from ..results import Comparison, Line, Result
from .tables import PAPER, SIGNIFICANT, Sorting, adjusted, circumstances, times_faster
from .words import count, interval, method_name, number, percent, plain

_LEAD = "hm"
"""The paper's own method, of which the summary speaks where it was run."""


def summary(result: Result) -> list[str]:
    """Sentences for the head of the report: success beside the paper's, times, differences, broken jobs."""
    said = [
        _group_words(title, lines) for title, lines in Sorting.of(result.lines).groups(result.lines).items()
    ]
    return [*said, *_time_words(result), *verdict(result), *broken_words(result)]


def _group_words(title: str, lines: list[Line]) -> str:
    return (
        f"{title[:1].upper()}{title[1:]}: " + "; ".join(_line_words(line) for line in _told_of(lines)) + "."
    )


def _told_of(lines: list[Line]) -> list[Line]:
    """The paper's method where it is among them; else what the paper tells of, and what succeeds most."""
    lead = [line for line in lines if line.method == _LEAD]
    if lead:
        return lead
    told = [line for line in lines if line.paper_success is not None]
    best = max(lines, key=lambda line: line.success)
    return told if best in told else [*told, best]


def _line_words(line: Line) -> str:
    name = method_name(line.method)
    done = f"plans of “{name}” are carried out in" if line.world else f"{name} packs"
    words = (
        f"{done} {percent(line.success, line.n)} % of {count(line.n, 'order')} "
        f"(95 % interval {interval(line.ci95, line.n)} %)"
    )
    if line.paper_success is not None:
        low, high = line.ci95
        paper = line.paper_success
        place = "inside" if low <= paper <= high else "below" if paper < low else "above"
        words += f"; the paper reports {percent(paper)} %, {place} the interval"
    for name, value in line.figures.items():
        paper_figure = line.figures.get(PAPER + name)
        if value is not None and paper_figure is not None:
            what, _, unit = plain(name).partition(", ")
            words += f"; {what} {number(value)} {unit} (paper {number(paper_figure)})"
    return words


def _time_words(result: Result) -> list[str]:
    ratios = sorted(
        (ratio, method_name(line.method), line) for line in result.lines if (ratio := times_faster(line))
    )
    if not ratios:
        return []
    ratio, name, line = ratios[0]
    return [
        f"The paper's mean times are at least {number(ratio)} times ours: {number(line.paper_s)} s against "
        f"{number(float(line.cpu_s_mean))} CPU-seconds by {name} ({circumstances(line)}), on another machine."
    ]


def verdict(result: Result) -> list[str]:
    """Which differences in success are significant and which are not."""
    if not result.comparisons:
        return []
    pairs = list(zip(result.comparisons, adjusted(result), strict=True))
    after = f", after Holm over {len(pairs)} comparisons" if len(pairs) > 1 else ""
    groups: dict[str, list[str]] = {}
    for comparison, p in pairs:
        if p < SIGNIFICANT:
            groups.setdefault(circumstances(comparison), []).append(_difference_words(comparison))
    if not groups:
        return [f"No difference in success is significant (McNemar's exact test{after})."]
    told = "; ".join(f"{title}: {', '.join(words)}" for title, words in groups.items())
    rest = len(pairs) - sum(map(len, groups.values()))
    others = "" if rest == 0 else " The other one is not." if rest == 1 else f" The other {rest} are not."
    return [
        f"Significant differences in success (p < {SIGNIFICANT:g}, McNemar's exact test{after}): {told}.{others}"
    ]


def _difference_words(c: Comparison) -> str:
    better, worse, difference = (c.a, c.b, c.difference) if c.difference > 0 else (c.b, c.a, -c.difference)
    return f"{method_name(better)} over {method_name(worse)} by {percent(difference, c.n)} points"


def broken_words(result: Result) -> list[str]:
    """Jobs that gave no figures."""
    told = []
    if result.broken:
        told.append(
            f"{count(result.broken, 'job')} broke (failed, died or took too long) and "
            f"count{'s' * (result.broken == 1)} in no figure: the same command does "
            f"{'them' if result.broken > 1 else 'it'} again."
        )
    if result.missing:
        has = "have" if result.missing > 1 else "has"
        told.append(
            f"{count(result.missing, 'job')} {has} no row yet: the figures are of those that are there."
        )
    return told
