"""Own code by name."""

from __future__ import annotations

import collections
import sys
from pathlib import Path

import pytest

from packenv.errors import InputError
from packenv.extensions import extension_name, is_extension, load_extension


def test_a_name_and_its_object_belong_together() -> None:
    found = load_extension("collections:Counter", "--heuristic")
    assert found is collections.Counter
    assert extension_name(found) == "collections:Counter"
    assert load_extension("collections:Counter.update", "--heuristic") == collections.Counter.update
    assert extension_name(lambda: 0) is None
    assert is_extension("a:b")
    assert not is_extension("hm")


def test_modules_of_the_current_folder_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_rules_of_mine.py").write_text(
        "def flattest(candidates, rng):\n    return candidates.z\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p])
    before = list(sys.path)
    assert load_extension("own_rules_of_mine:flattest", "--heuristic").__name__ == "flattest"
    assert sys.path == before


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("no_such_module_here:x", "no_such_module_here"),
        ("collections:Countre", "did you mean 'Counter'"),
        ("collections:", "my_module:my_rule"),
        ("../evil:x", "my_module:my_rule"),
        (":x", "my_module:my_rule"),
    ],
)
def test_mistakes_are_one_line(name: str, word: str) -> None:
    with pytest.raises(InputError, match=r"--heuristic") as caught:
        load_extension(name, "--heuristic")
    assert word in str(caught.value)


def test_a_module_that_does_not_import_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_broken_rules.py").write_text("1 / 0\n")
    (tmp_path / "own_needy_rules.py").write_text("import no_such_module_at_all\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="ZeroDivisionError"):
        load_extension("own_broken_rules:x", "--constraint")
    with pytest.raises(InputError, match="no_such_module_at_all"):
        load_extension("own_needy_rules:x", "--constraint")
