"""Words that ask for a run: the command, from what was asked for, and which of them an experiment uses."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from packenv.cli.bench import EXPERIMENTS

from .spec import RunSpec

_LARGE = frozenset({"items", "container"})
_EXECUTED = frozenset({"columns", "engine"})
USES: Mapping[str, frozenset[str]] = {
    "small-orders": frozenset({"methods", "settings"}),
    "heuristics": _LARGE | {"methods", "constraints", "settings", "gls_plans"},
    "fallback": _LARGE | {"settings"},
    "search5d": _LARGE | {"settings"},
    "execution-small": _EXECUTED,
    "execution": _LARGE | _EXECUTED,
    "engines": _LARGE | {"columns"},
    "early-rest": _LARGE | _EXECUTED,
    "robustness": _LARGE | {"engine"},
}
"""Fields of a specification that an experiment uses, beside those of :data:`ALWAYS`."""
ALWAYS = frozenset({"catalogue", "unit", "orders", "seed", "unseen"})


def unused(experiment: str, spec: RunSpec) -> list[str]:
    """Options that were given to an experiment that has no use for them."""
    useless = [f for f in fields(spec) if f.name not in ALWAYS | USES[experiment]]
    return [_option(f.name) for f in useless if getattr(spec, f.name) != f.default]


def commands_of(specs: Mapping[str, RunSpec], out: Path) -> tuple[str, ...]:
    """The command lines that make some runs again.

    Args:
        specs: what was asked for, by experiment.
        out: folder of the rows.
    """
    if list(specs) == list(EXPERIMENTS) and len(set(specs.values())) == 1:
        specs = {"all": next(iter(specs.values()))}
    return tuple(
        shlex.join(["robotpack", "bench", name, *_words(spec), "--out", str(out)])
        for name, spec in specs.items()
    )


def _words(spec: RunSpec) -> Sequence[str]:
    """What differs from what is asked for without words."""
    words: list[str] = []
    for f in fields(spec):
        value = getattr(spec, f.name)
        if value == f.default:
            continue
        text = "x".join(map(repr, value)) if f.name == "container" else value
        given = map(str, text) if isinstance(text, tuple) else (str(text),)
        words += [_option(f.name), *given]
    return words


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
