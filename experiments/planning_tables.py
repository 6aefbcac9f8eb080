"""What rows of planned orders say: the paper's first table, its small orders, its 5D search and its fallback."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .experiment import Row
from .results import Comparison, Failure, Line, Result
from .spec import RunSpec
from .statistics import Group, Trial, compare, line

PAPER: Mapping[tuple[str, str], tuple[float | None, float | None]] = {
    ("overlap", "hm"): (0.999, 15.7),
    ("overlap", "dblf"): (0.984, 14.2),
    ("overlap", "mta"): (0.889, 14.1),
    ("overlap", "gls"): (0.789, 502.0),
    ("robot", "hm"): (0.971, 34.9),
    ("robot", "dblf"): (0.963, 50.1),
    ("robot", "mta"): (0.863, 95.4),
}
"""Success and mean seconds by constraints and method (Sec. V-B, Table 1)."""
PAPER_SMALL = (1.0, 8.54)
"""Small orders by HM, all constraints (Sec. V-A)."""
PAPER_5D_S = 522.0
"""Mean seconds of a 5D search alone (Sec. V-B)."""
PAPER_FALLBACK = {"by fallback, %": 3.2, "of these later, %": 51.0, "of these 5D, %": 49.0}
"""Items that are placed by the fallback, and by which of its two routes (Sec. V-B)."""


@dataclass(frozen=True)
class _Rows:
    """Rows of one method in one group, by the order's index."""

    method: str
    group: Group
    rows: Mapping[int, Row]

    @property
    def trials(self) -> dict[int, Trial]:
        """What each order gave."""
        return {index: Trial(bool(row["complete"]), float(row["cpu_s"])) for index, row in self.rows.items()}


def _grouped(rows: Sequence[Row]) -> list[_Rows]:
    """Rows of jobs that did not break, by group and method, in the sequence of the first of each."""
    groups: dict[tuple[str, Group], dict[int, Row]] = defaultdict(dict)
    for row in rows:
        if "error" not in row:
            group = Group(row["constraints"], row["setting"], row["items"])
            groups[row["method"], group][row["index"]] = row
    return [_Rows(method, group, found) for (method, group), found in groups.items()]


def _without(groups: Sequence[_Rows], feasible: Mapping[str, set[int]]) -> list[_Rows]:
    """The same for feasible orders alone."""
    kept = (
        _Rows(g.method, g.group, {k: row for k, row in g.rows.items() if k in feasible[g.group.items]})
        for g in groups
    )
    return [group for group in kept if group.rows]


def feasible_orders(rows: Sequence[Row]) -> dict[str, set[int]]:
    """Indices of the orders that some method packs, by the items that they are drawn from (paper Sec. V-B)."""
    found: dict[str, set[int]] = defaultdict(set)
    for row in rows:
        if row.get("complete"):
            found[row["items"]].add(row["index"])
    return found


def _figures(rows: Sequence[Row]) -> dict[str, float | int | str | None]:
    """Columns that all tables of plans have."""
    whole = [row for row in rows if row["complete"]]
    items = sum(len(row["order"]) for row in rows)
    return {
        "items placed, %": 100.0 * sum(row["placed"] for row in rows) / items,
        "height, cm": 100.0 * statistics.fmean(row["height"] for row in whole) if whole else None,
        "audit findings": sum(row["overlaps"] + row["protrusions"] + row["blocked"] for row in rows),
    }


def _failures(rows: Sequence[Row]) -> list[Failure]:
    found = []
    for row in rows:
        if "error" in row:
            why = f"job {row['status']}: {row['error']}"
        elif not row["complete"]:
            why = "left over: " + ", ".join(f"{item} ({reason})" for item, reason in row["leftovers"])
        else:
            continue
        head = {name: row[name] for name in ("key", "method", "constraints", "setting", "items", "index")}
        found.append(Failure(**head, why=why))
    return found


def _result(
    name: str,
    title: str,
    spec: RunSpec,
    rows: Sequence[Row],
    lines: Sequence[Line],
    comparisons: Sequence[Comparison] = (),
    remarks: Sequence[str] = (),
) -> Result:
    return Result(
        name,
        title,
        spec,
        tuple(lines),
        tuple(comparisons),
        tuple(_failures(rows)),
        tuple(remarks),
        tuple(sorted({str(row["revision"]) for row in rows})),
        sum("error" in row for row in rows),
    )


def _against_first(groups: Sequence[_Rows]) -> list[Comparison]:
    """Of each group, its first method against each other one."""
    first: dict[Group, _Rows] = {}
    found = []
    for group in groups:
        reference = first.setdefault(group.group, group)
        if reference is not group:
            found.append(compare(reference.method, group.method, group.group, reference.trials, group.trials))
    return [comparison for comparison in found if comparison is not None]


def heuristics_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """The paper's first table, over the orders that some method packs."""
    feasible = feasible_orders(rows)
    asked = [row for row in rows if _asked_for(spec, row)]
    groups = _without(_grouped(asked), feasible)
    paper = PAPER if spec.as_paper else {}
    lines = [
        line(
            g.method,
            g.group,
            list(g.trials.values()),
            paper_success=paper.get((g.group.constraints, g.method), (None, None))[0],
            paper_s=paper.get((g.group.constraints, g.method), (None, None))[1],
            figures=_figures(list(g.rows.values())),
        )
        for g in groups
    ]
    indices: dict[str, set[int]] = defaultdict(set)
    for row in rows:
        indices[row["items"]].add(row["index"])
    remarks = []
    for items, drawn in indices.items():
        left_out = len(drawn) - len(feasible[items])
        remarks.append(
            f"Of {len(drawn)} orders drawn of {items} items {left_out} that no method packs are left out, as the "
            "paper leaves them out."
        )
    result = _result(
        "heuristics", "Heuristics on large orders", spec, rows, lines, _against_first(groups), remarks
    )
    return replace(
        result, failures=tuple(_failures([r for r in rows if "error" in r or _asked_for(spec, r)]))
    )


def _asked_for(spec: RunSpec, row: Row) -> bool:
    """Whether a row is of a line of the table of heuristics: a witness of feasibility may be of none."""
    return (
        row["constraints"] in spec.constraints
        and (not spec.methods or row["method"] in spec.methods)
        and (not spec.settings or row["setting"] in spec.settings)
    )


def small_orders_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """The paper's small orders: all that were drawn."""
    groups = _grouped(rows)
    lines = []
    for g in groups:
        own = list(g.rows.values())
        paper = PAPER_SMALL if g.method == "hm" else (None, None)
        boxes = Counter(row["container"] for row in own if row["complete"])
        figures = {**_figures(own), "boxes": ", ".join(f"{name} {n}" for name, n in sorted(boxes.items()))}
        lines.append(
            line(
                g.method,
                g.group,
                list(g.trials.values()),
                paper_success=paper[0],
                paper_s=paper[1],
                figures=figures,
            )
        )
    return _result("small-orders", "Small orders", spec, rows, lines, _against_first(groups))


def search_named(setting: str) -> tuple[str, str]:
    """Method and setting of the line that rows of a setting belong to, where searches are compared."""
    plain = setting.replace(",search=5d", "")
    return "prioritized" if plain == setting else "5d alone", plain


def search5d_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """Prioritized search with the fallback, and all orientations at once."""
    feasible = feasible_orders(rows)
    named = []
    for g in _without(_grouped(rows), feasible):
        method, setting = search_named(g.group.setting)
        named.append(_Rows(method, Group(g.group.constraints, setting, g.group.items), g.rows))
    lines = []
    for g in named:
        own = list(g.rows.values())
        paper_s = PAPER_5D_S if g.method == "5d alone" else PAPER["robot", "hm"][1]
        paper_s = paper_s if spec.as_paper else None
        first = {"maps of the items, CPU-s": statistics.median(row["prepare_cpu_s"] for row in own)}
        figures = {**_figures(own), **first}
        lines.append(line(g.method, g.group, list(g.trials.values()), paper_s=paper_s, figures=figures))
    return _result("search5d", "5D search alone", spec, rows, lines, _against_first(named))


def fallback_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """Which items the fallback places, and by which route, of the orders that HM packs whole."""
    lines = []
    for g in _grouped(rows):
        routes: Counter[str] = Counter()
        for row in g.rows.values():
            if row["complete"]:
                routes.update(row["routes"])
        late = routes["later"] + routes["5d"]
        figures: dict[str, float | int | str | None] = {"items": routes.total()}
        shares = ((late, routes.total()), (routes["later"], late), (routes["5d"], late))
        for (name, paper), (part, whole) in zip(PAPER_FALLBACK.items(), shares, strict=True):
            figures[name] = 100.0 * part / whole if whole else None
            if spec.as_paper:
                figures[f"paper: {name}"] = paper
        lines.append(line(g.method, g.group, list(g.trials.values()), figures=figures))
    return _result("fallback", "Fallback", spec, rows, lines)
