"""A length holds floor(L / l) pieces, layers fill a height, and boxes a container: whatever the numbers are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np
import pytest

from benchmarks.known_fits import KINDS, Instance
from packenv.config import CLEARANCE, GridConfig
from packenv.planning.assembly import assemble
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.types import Container, Item, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.shapes import box
from tests.shelf_samples import shelf_of

OPTIONS = PlanOptions(constraints="overlap")
TENTH = 1e-4
"""A tenth of a millimetre, m."""


def packings(
    items: Mapping[str, Item],
    asked: Sequence[tuple[Container, Sequence[str]]],
    options: PlanOptions = OPTIONS,
) -> Iterator[Packing]:
    """Each order in its container, the items prepared once."""
    shelf = shelf_of(items, options.grid)
    for container, order in asked:
        with assemble(options, shelf, container) as planner:
            yield planner.pack(order, shelf.prepared, container)


def sound(packing: Packing, items: Mapping[str, Item]) -> bool:
    """The audit of the exact meshes finds nothing."""
    return audit_plan(Plan(packing.container, packing.placements, packing.leftovers), items).ok


def wrong_rows(axis: int, pieces: int, lengths: int, seed: int) -> tuple[int, list[str]]:
    """How many pairs of l and L were asked along an axis, and those with another answer than floor(L / l)."""
    rng = np.random.default_rng([seed, axis])
    asked, wrong = 0, []
    for _ in range(pieces):
        size = rng.integers((100, 110, 110), (500, 400, 400))
        brick = box(*(np.insert(size[1:], axis, size[0]) * TENTH), "brick")
        containers, answers = [], []
        for length in rng.integers(size[0], 8 * size[0], lengths):
            length = int(rng.choice([length, length // size[0] * size[0]]))  # half of them whole multiples
            containers.append(Container(*map(float, np.insert(size[1:], axis, length) * TENTH)))
            answers.append(length // int(size[0]))
        # One piece too many costs restarts, so it is asked for every fifth time.
        counts = [n + (k % 5 == 0) for k, n in enumerate(answers)]
        orders = [(c, ["brick"] * n) for c, n in zip(containers, counts, strict=True)]
        for k, packing in enumerate(packings({"brick": brick}, orders)):
            asked += 1
            placed = len(packing.placements)
            if placed != answers[k] or (k % 5 == 0 and not sound(packing, {"brick": brick})):
                wrong.append(f"{placed} of {answers[k]}: {size * TENTH} in {containers[k].label}")
    return asked, wrong


@pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
def test_a_row_holds_as_many_pieces_as_its_length_divided_by_theirs(axis: int) -> None:
    """In a container as wide and as high as one piece, to a tenth of a millimetre."""
    asked, wrong = wrong_rows(axis, 20, 20, seed=1)
    assert not wrong, f"{len(wrong)} of {asked} wrong: {wrong[:5]}"


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
def test_so_do_thousands_of_rows(axis: int) -> None:
    asked, wrong = wrong_rows(axis, 100, 20, seed=2)
    assert not wrong, f"{len(wrong)} of {asked} wrong: {wrong[:5]}"


@pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
@pytest.mark.parametrize("count", [1, 3, 10])
@pytest.mark.parametrize("over", [-0.9, 0.01, 0.9])
def test_a_length_short_by_less_than_what_counts_as_touching_still_does(
    axis: int, count: int, over: float
) -> None:
    """The pieces are each a share of the clearance longer than their part of the container."""
    size, room = np.array([0.0307, 0.0411, 0.0253]), np.array([0.0307, 0.0411, 0.0253])
    room[axis] *= count
    size[axis] += over * CLEARANCE / count
    brick = box(*size, "brick")
    (packing,) = packings({"brick": brick}, [(Container(*room), ["brick"] * count)])
    assert len(packing.placements) == count
    assert sound(packing, {"brick": brick})


def known(kind: str, count: int, seed: int) -> list[Instance]:
    return list(islice(KINDS[kind](np.random.default_rng(seed)), count))


def answers(instances: Sequence[Instance], options: PlanOptions = OPTIONS) -> Iterator[tuple[Instance, int]]:
    """How many items each holds, after the audit."""
    for instance in instances:
        (packing,) = packings(instance.items, [(instance.container, instance.order)], options)
        assert sound(packing, instance.items), instance.label
        yield instance, len(packing.placements)


@pytest.mark.parametrize("kind", ["rows", "cubes", "nested", "angles"])
def test_known_answers_are_found(kind: str) -> None:
    """Some of each kind of the benchmark, to the item."""
    found = list(answers(known(kind, 12, seed=5)))
    wrong = [f"{placed} of {i.fits}: {i.label}" for i, placed in found if placed != i.fits]
    assert not wrong, "\n".join(wrong)


def test_a_filled_container_holds_within_one_item_of_the_best_packing() -> None:
    """Filled until three items in a row find no place."""
    found = list(answers(known("filled", 8, seed=6)))
    wrong = [f"{placed} of {i.fits}: {i.label}" for i, placed in found if abs(placed - i.fits) > 1]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("step", [0.002, 0.005, 0.02])
def test_the_count_does_not_depend_on_the_grid(step: float) -> None:
    """A grid finds more or less good places, never fewer pieces in a row."""
    options = PlanOptions(constraints="overlap", grid=GridConfig(cell_size=0.001, grid_step=step))
    brick = {"brick": box(0.0473, 0.0331, 0.0217, "brick")}
    (packing,) = packings(brick, [(Container(6 * 0.0473, 0.0331, 2 * 0.0217), ["brick"] * 13)], options)
    assert len(packing.placements) == 12
    assert sound(packing, brick)
