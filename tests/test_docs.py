"""The documents: short lines, and links, paths, modules and commands that are there."""

from __future__ import annotations

import importlib
import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from packenv.cli import main
from tests.conftest import REPO

DOCUMENTS = sorted([*REPO.glob("*.md"), *(REPO / "docs").glob("*.md")])
LONGEST = 120
FOLDERS = "packenv|agents|train|experiments|benchmarks|examples|assets|docs|tests"
PATH = re.compile(rf"(?:{FOLDERS})/[\w./-]*\w|\.ci/\w+|[A-Za-z]\w*\.(?:md|toml|cff)")
CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
MODULE = re.compile(r"python -m (\w+(?:\.\w+)*)")
DOTTED = re.compile(r"packenv(?:\.\w+)+")
IMPORT = re.compile(r"^from (packenv[\w.]*) import (\w+)$", re.MULTILINE)
NUMBERED = re.compile(r"\border \d+")
"""An order by its number tells a reader nothing: say what is in it, or its index."""
FENCED = re.compile(r"^```\w*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def long_lines(text: str) -> list[int]:
    """Numbers of the lines that are too long, but for those with an address."""
    lines = enumerate(text.splitlines(), start=1)
    return [k for k, line in lines if len(line) > LONGEST and "://" not in line]


def missing_paths(text: str) -> list[str]:
    """Paths in backticks that are not in the repository."""
    named = [code for code in CODE.findall(text) if PATH.fullmatch(code)]
    return [path for path in named if not (REPO / path).exists() and not (REPO / "docs" / path).exists()]


def anchor(heading: str) -> str:
    """What a link to a heading ends in."""
    return re.sub(r"[^\w\- ]", "", heading.strip("# ").lower()).replace(" ", "-")


def broken_links(text: str, page: Path) -> list[str]:
    """Relative links of a page that lead to no file or to no heading."""
    broken = []
    for link in LINK.findall(text):
        if "://" in link:
            continue
        file, _, part = link.partition("#")
        there = (page.parent / file).resolve() if file else page
        if not there.exists() or (part and part not in headings(there)):
            broken.append(link)
    return broken


def headings(page: Path) -> set[str]:
    """Anchors of a page."""
    lines = FENCED.sub("", page.read_text(encoding="utf-8")).splitlines()
    return {anchor(line) for line in lines if line.startswith("#")}


def missing_modules(text: str) -> list[str]:
    """Modules that a command of the text runs, and which are not there."""
    ours = [name for name in MODULE.findall(text) if name.split(".")[0] in FOLDERS.split("|")]
    return [name for name in ours if importlib.util.find_spec(name) is None]


def missing_names(text: str) -> list[str]:
    """Dotted names of the package, in backticks or imported by an example, that lead nowhere."""
    named = {name for code in CODE.findall(text) for name in DOTTED.findall(code)}
    named |= {f"{module}.{name}" for module, name in IMPORT.findall(text)}
    return sorted(name for name in named if not leads_somewhere(name))


def leads_somewhere(name: str) -> bool:
    """Whether a module has that name, or something in it."""
    try:
        if importlib.util.find_spec(name) is not None:
            return True
    except ImportError:
        pass
    owner, _, last = name.rpartition(".")
    if "." in owner and not leads_somewhere(owner):
        return False
    try:
        return hasattr(importlib.import_module(owner), last)
    except ModuleNotFoundError:  # a class: what it has is read from it
        above, _, middle = owner.rpartition(".")
        return hasattr(getattr(importlib.import_module(above), middle), last)


def commands(text: str) -> Iterator[list[str]]:
    """The words of every ``robotpack`` command in the text's fences."""
    for block in FENCED.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("robotpack "):
                yield shlex.split(line, comments=True)[1:]


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.name)
def test_document(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert long_lines(text) == []
    assert missing_paths(text) == []
    assert broken_links(text, page) == []
    assert missing_modules(text) == []
    assert missing_names(text) == []
    assert NUMBERED.findall(text) == []


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.name)
def test_commands_have_the_options_that_are_shown(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        names = words[: 2 if words[0] in ("items", "bench") else 1]
        with pytest.raises(SystemExit) as end:
            main([*names, "--help"])
        assert end.value.code == 0
        known = re.findall(r"(?<![\w-])--?[a-z][\w-]*", capsys.readouterr().out)
        assert [word for word in words if word.startswith("-") and word not in known] == []


def test_the_checks_find_what_is_wrong() -> None:
    page = REPO / "README.md"
    assert long_lines("x" * 121 + "\n" + "x" * 120) == [1]
    assert missing_paths("`packenv/nowhere.py`, `packenv/api.py`") == ["packenv/nowhere.py"]
    assert broken_links("[a](docs/none.md) [b](#none) [c](docs/cell.md#branches)", page) == [
        "docs/none.md",
        "#none",
    ]
    assert missing_modules("`python -m packenv.none` `python -m benchmarks.ik`") == ["packenv.none"]
    wrong = ["packenv.Nothing", "packenv.types.Pose.none", "packenv.none.Pose"]
    assert missing_names("".join(f"`{name}`" for name in [*wrong, "packenv.types.Pose.apply"])) == sorted(
        wrong
    )
    assert missing_names("from packenv.nowhere import Pose\n") == ["packenv.nowhere.Pose"]
    assert NUMBERED.findall("order 3 fails, order index 3 too, ten orders") == ["order 3"]
    assert list(commands("```sh\nrobotpack pack a \\\n  --out b  # c\n```\n")) == [
        ["pack", "a", "--out", "b"]
    ]
    assert sum(len(list(commands(page.read_text()))) for page in DOCUMENTS) > 5


def test_the_citation_has_the_version_of_the_package() -> None:
    stated = [
        re.search(pattern, (REPO / name).read_text(), re.MULTILINE)
        for name, pattern in (("CITATION.cff", r"^version: (.+)$"), ("pyproject.toml", r'^version = "(.+)"$'))
    ]
    assert len({found[1] for found in stated if found}) == 1
    assert None not in stated
