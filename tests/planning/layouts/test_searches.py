"""What both searches for layouts promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.geometry.collision import Posed, overlap_depth, solid_of
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.guided_local_search import GuidedLocalSearch
from packenv.planning.layouts.layout import Arrangement, Layout
from packenv.planning.layouts.layout_packer import LayoutSearch
from packenv.planning.layouts.separation import Separation
from packenv.types import Container, Pose
from tests.planning.layouts.arrangements import arrangement_of, drawn

SEARCHES = [Separation(), GuidedLocalSearch()]


def searched(
    search: LayoutSearch, names: list[str], moves: int, seed: int = 0, box: Container | None = None
) -> tuple[Arrangement, Layout, Effort]:
    found = arrangement_of(names) if box is None else arrangement_of(names, box)
    effort = Effort(moves=moves)
    layout = search.run(found, np.random.default_rng(seed), effort)
    return found, layout, effort


@pytest.mark.parametrize("search", SEARCHES, ids=["separate", "gls"])
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_a_layout_without_overlap_passes_the_exact_audit(search: LayoutSearch, seed: int) -> None:
    found, layout, _ = searched(search, drawn(seed), 400, seed)
    assert layout.overlap == found.overlap
    if layout.overlap:
        return
    posed = []
    for piece, (kind, at) in enumerate(zip(layout.kinds, layout.at, strict=True)):
        movable = found.pieces[piece]
        oriented = movable.orientations[kind]
        posed.append(
            Posed(solid_of(movable.item), Pose(oriented.rotation, oriented.offset + at * found.pitch))
        )
        bounds = posed[-1].bounds
        assert (bounds[0] >= -2e-5).all()
        assert (bounds[1] <= np.add(found.size, 2e-5)).all()
    for k, one in enumerate(posed):
        assert all(overlap_depth(one, other) == 0.0 for other in posed[:k])


@pytest.mark.parametrize("search", SEARCHES, ids=["separate", "gls"])
def test_roomy_orders_are_laid_out(search: LayoutSearch) -> None:
    solved = [searched(search, drawn(seed, 6, 6), 400)[1].overlap == 0 for seed in range(10)]
    assert all(solved)


@pytest.mark.parametrize("search", SEARCHES, ids=["separate", "gls"])
def test_a_full_box_of_bricks_is_laid_out(search: LayoutSearch) -> None:
    """Eight bricks of 5 x 4 x 3 cm in 10 x 8 x 6 cm: there is no room to spare but the voxels' rounding."""
    box = Container(0.104, 0.08, 0.064)
    assert searched(search, ["brick"] * 8, 6000, 3, box)[1].overlap == 0


@pytest.mark.parametrize("search", SEARCHES, ids=["separate", "gls"])
def test_same_seed_same_moves_same_layout(search: LayoutSearch) -> None:
    names, box = ["brick"] * 9, Container(0.104, 0.08, 0.064)  # one too many: no run ends early
    (_, one, spent), (_, two, again) = (searched(search, names, 150, 7, box) for _ in range(2))
    assert one.overlap == two.overlap > 0
    assert np.array_equal(one.at, two.at)
    assert np.array_equal(one.kinds, two.kinds)
    assert spent.spent == again.spent
    other = searched(search, names, 150, 8, box)[1]
    assert not np.array_equal(one.at, other.at)


@pytest.mark.parametrize("search", SEARCHES, ids=["separate", "gls"])
def test_the_effort_ends_a_search(search: LayoutSearch) -> None:
    _, layout, effort = searched(search, ["brick"] * 12, 100, box=Container(0.104, 0.08, 0.064))
    assert layout.overlap > 0
    assert effort.spent <= 100 + 12
    clock = iter(range(10_000))
    found = arrangement_of(["brick"] * 12, Container(0.104, 0.08, 0.064))
    timed = Effort(seconds=200, clock=lambda: float(next(clock)))
    assert search.run(found, np.random.default_rng(0), timed).overlap > 0
    assert timed.elapsed < 400
