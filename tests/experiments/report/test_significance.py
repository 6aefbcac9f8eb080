"""Holm's adjustment, against R's p.adjust and its laws."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, strategies as st

from packenv.experiments.report.significance import holm

CHANCES = st.lists(st.floats(0.0, 1.0), max_size=12)


def test_as_r_has_it() -> None:
    # p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm") in R 4.3
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(CHANCES)
def test_never_below_and_in_the_same_order(chances: list[float]) -> None:
    adjusted = holm(chances)
    assert all(p <= q <= 1.0 for p, q in zip(chances, adjusted, strict=True))
    pairs = sorted(zip(chances, adjusted, strict=True))
    assert [q for _, q in pairs] == sorted(adjusted)


@given(CHANCES)
def test_what_was_not_tested_does_not_count(chances: list[float]) -> None:
    *adjusted, last = holm([*chances, math.nan])
    assert adjusted == holm(chances)
    assert math.isnan(last)
