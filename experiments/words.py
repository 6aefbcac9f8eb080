"""The command that asks for a run, from what was asked for: a report of rows that are there knows it, too."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from packenv.cli.bench import EXPERIMENTS

from .spec import RunSpec


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
        text = "x".join(f"{side:g}" for side in value) if f.name == "container" else value
        given = map(str, text) if isinstance(text, tuple) else (str(text),)
        words += [f"--{f.name.replace('_', '-')}", *given]
    return words
