"""The specification names every column, info key, setting and reward term that there is."""

from __future__ import annotations

from dataclasses import fields

import pytest

from packenv.env.config import PackConfig
from packenv.env.observation import FEATURES, ITEM_FEATURES, STATE_FEATURES
from packenv.env.pack_env import PackEnv
from packenv.env.reward import Outcome
from tests.conftest import REPO
from tests.env_samples import make_env

PAGE = (REPO / "docs" / "environment.md").read_text(encoding="utf-8")
DOCSTRING = PackEnv.__doc__ or ""


def _named(name: str, text: str) -> bool:
    stem, _, rest = name.partition("_")
    if stem in ("score", "rank", "reward") and rest:
        return f"`{stem}_" in text
    return f"`{name}`" in text


@pytest.mark.parametrize("text", [PAGE, DOCSTRING], ids=["page", "docstring"])
def test_every_column_is_named(text: str) -> None:
    missing = [name for name in (*FEATURES, *ITEM_FEATURES, *STATE_FEATURES) if not _named(name, text)]
    assert missing == []


@pytest.mark.parametrize("text", [PAGE, DOCSTRING], ids=["page", "docstring"])
def test_every_key_of_info_and_observation_is_named(text: str) -> None:
    env = make_env()
    obs, info = env.reset(seed=0)
    assert [name for name in (*obs, *info) if not _named(name, text)] == []
    terms = [name.removeprefix("reward_") for name in info if name.startswith("reward_")]
    assert [term for term in terms if f"`{term}`" not in text] == []
    env.close()


def test_every_setting_is_named() -> None:
    assert [f.name for f in fields(PackConfig) if f"`{f.name}`" not in PAGE] == []


@pytest.mark.parametrize(("key", "column"), [("candidates", FEATURES), ("remaining", ITEM_FEATURES)])
def test_stated_widths_are_those_of_the_space(key: str, column: tuple[str, ...]) -> None:
    env = make_env()
    assert env.observation_space[key].shape[-1] == len(column)
    for text in (PAGE, DOCSTRING):
        assert f", {len(column)})" in text
    env.close()


def test_every_field_of_an_outcome_is_named() -> None:
    assert [f.name for f in fields(Outcome) if f"`{f.name}`" not in PAGE] == []
