"""The compiled least squares against SciPy's, on random and on degenerate matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from packenv.planning.stability.equilibrium_kernels import least_squares


@pytest.mark.parametrize("rows", [6, 12, 18])
@pytest.mark.parametrize("decimals", [None, 1, 0])
def test_least_squares_is_as_good_as_scipys(rows: int, decimals: int | None) -> None:
    rng = np.random.default_rng(rows)
    for _ in range(150):
        columns = rng.normal(size=(int(rng.integers(1, 200)), rows))
        columns[:, 0] += rng.choice([0.0, 1.5])
        if decimals is not None:  # equal, opposite and empty columns
            columns = np.round(columns, decimals)
        rhs = rng.normal(size=rows)
        x, left = np.empty(len(columns)), np.empty(rows)
        assert least_squares(columns, rhs, 3 * len(columns), x, left)
        _, best = nnls(columns.T, rhs)
        assert (x >= 0.0).all()
        np.testing.assert_allclose(left, rhs - columns.T @ x, atol=1e-9)
        assert np.linalg.norm(left) == pytest.approx(best, abs=1e-9)


def test_what_is_left_opposes_no_column() -> None:
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(40, 6))
    columns[:, 2] = np.abs(columns[:, 2])
    x, left = np.empty(40), np.empty(6)
    assert least_squares(columns, np.array([0.3, 0.0, -1.0, 0.0, 0.0, 0.0]), 200, x, left)
    assert np.linalg.norm(left) > 0.1
    assert (columns @ left).max() < 1e-12
