"""Results that nobody measured, to lay out."""

from __future__ import annotations

from packenv.experiments.results import Comparison, Failure, Interval, Line, Result
from packenv.experiments.spec import RunSpec

HOSTILE = '<script src="https://evil.example/x.js">alert(1)</script> | a_b *c* `d`\n\x1b[31m"&\''


def wilson(hits: int, n: int) -> Interval:
    from scipy.stats import binomtest

    found = binomtest(hits, n).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def line(method: str = "hm", hits: int = 19, n: int = 20, **words: object) -> Line:
    given = {
        "method": method,
        "constraints": "overlap",
        "setting": "default",
        "items": "all",
        "n": n,
        "success": hits / n,
        "ci95": wilson(hits, n),
        "cpu_s_median": 0.0313,
        "cpu_s_mean": 0.0412,
        "cpu_s_max": 1.237,
    }
    return Line(**(given | words))  # type: ignore[arg-type]


def comparison(
    a: str = "hm", b: str = "mta", a_only: int = 12, b_only: int = 0, **words: object
) -> Comparison:
    from scipy.stats import binomtest

    given = {
        "a": a,
        "b": b,
        "constraints": "overlap",
        "setting": "default",
        "items": "all",
        "world": "",
        "n": 20,
        "a_only": a_only,
        "b_only": b_only,
        "p": float(binomtest(a_only, a_only + b_only).pvalue) if a_only + b_only else 1.0,
        "difference": (a_only - b_only) / 20,
        "difference_ci95": ((a_only - b_only) / 20 - 0.1, (a_only - b_only) / 20 + 0.1),
        "time_ratio": 0.913,
        "time_ratio_ci95": (0.81, 1.13),
    }
    return Comparison(**(given | words))  # type: ignore[arg-type]


def failure(key: str = "k0", index: int = 3, **words: str) -> Failure:
    given = {
        "method": "mta",
        "constraints": "overlap",
        "setting": "default",
        "items": "all",
        "why": "too tall",
    }
    return Failure(key=key, index=index, **(given | words))


def result(*lines: Line, **words: object) -> Result:
    given = {"experiment": "heuristics", "title": "Ten items", "spec": RunSpec(orders=20)}
    return Result(lines=lines, **(given | words))  # type: ignore[arg-type]
