"""Orders: what each kind promises, that the seed fixes all, and that toys can be packed without a gap."""

from __future__ import annotations

import hashlib
import itertools
import json
import pickle
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from packenv.config import GridConfig
from packenv.env.orders import GeneratedOrder, OrderGenerator, ToyOrders, from_spec
from packenv.env.orders.cuts import CUTS, Piece, Size
from packenv.env.orders.from_names import is_test_item
from packenv.errors import InputError
from packenv.geometry.mass import solid_properties
from packenv.geometry.stable_poses import stable_poses
from packenv.geometry.topology import is_solid
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.options import PlanOptions
from packenv.planning.planner import by_box_volume
from packenv.types import Container, OrderLine, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.shelf_samples import shelf_of

NAMES = tuple(f"item-{k}" for k in range(40))
GRID = GridConfig()
GREEDY = ("hm", "dblf", "mta", "minz", "first-fit")


def run(generator: OrderGenerator, seed: int, count: int = 5) -> list[GeneratedOrder]:
    rng = np.random.default_rng(seed)
    return [generator.generate(rng) for _ in range(count)]


@pytest.fixture
def order_files(tmp_path: Path) -> Path:
    for k in range(3):
        (tmp_path / f"{k}.csv").write_text(f"item,qty\nitem-{k},{k + 1}\n")
    (tmp_path / "notes.txt").write_text("no order")
    return tmp_path


def specs(folder: Path) -> list[dict[str, object]]:
    return [
        {"kind": "random"},
        {"kind": "random", "items": [2, 9], "repeats": False, "split": "train", "test_share": 0.3},
        {"kind": "list", "items": ["item-3", "item-3", "item-1"]},
        {"kind": "file", "path": str(folder)},
        {"kind": "file", "path": str(folder), "shuffle": True},
        {"kind": "toy"},
        {"kind": "toy", "pieces": 6, "cut": "guillotine", "container": [0.2, 0.3, 0.25], "shuffle": True},
    ]


def fingerprint(orders: list[GeneratedOrder]) -> list[object]:
    return [
        (
            order.items,
            {name: item.sha256 for name, item in order.meshes.items()},
            order.container,
            [(p.item, p.position.tolist(), p.rotation.tolist()) for p in order.solution],
        )
        for order in orders
    ]


@pytest.mark.parametrize("which", range(7))
def test_the_seed_fixes_the_orders_and_nothing_else_does(order_files: Path, which: int) -> None:
    spec = specs(order_files)[which]
    assert json.loads(json.dumps(spec)) == spec
    first, second = (from_spec(spec, NAMES) for _ in range(2))
    expected = fingerprint(run(first, 7))
    hidden = repr(np.random.get_state())  # noqa: NPY002
    assert fingerprint(run(second, 7)) == expected
    # A generator that has given orders before gives the same again from a new random generator.
    assert fingerprint(run(first, 7)) == expected
    assert repr(np.random.get_state()) == hidden  # noqa: NPY002


@pytest.mark.parametrize("which", range(7))
def test_a_pickled_generator_goes_on_where_it_was(order_files: Path, which: int) -> None:
    generator, rng = from_spec(specs(order_files)[which], NAMES), np.random.default_rng(3)
    generator.generate(rng)
    copies = pickle.loads(pickle.dumps((generator, rng)))
    follow = [generator.generate(rng) for _ in range(4)]
    assert fingerprint([copies[0].generate(copies[1]) for _ in range(4)]) == fingerprint(follow)


def test_random_orders_keep_to_their_counts_and_reach_all_of_them() -> None:
    orders = run(from_spec({"kind": "random", "items": [2, 5]}, NAMES), 0, 300)
    assert {len(order.items) for order in orders} == {2, 3, 4, 5}
    assert {name for order in orders for name in order.items} == set(NAMES)
    assert any(len(set(order.items)) < len(order.items) for order in orders)


def test_without_repeats_no_item_comes_twice() -> None:
    orders = run(from_spec({"kind": "random", "items": 30, "repeats": False}, NAMES), 0, 20)
    assert all(len(set(order.items)) == 30 for order in orders)
    # All of them, in a drawn sequence.
    whole = run(from_spec({"kind": "random", "items": 40, "repeats": False}, NAMES), 0, 2)
    assert set(whole[0].items) == set(NAMES)
    assert whole[0].items != whole[1].items


def drawn_from(split: str, names: tuple[str, ...], share: float) -> set[str]:
    spec = {"kind": "random", "items": 1, "split": split, "test_share": share}
    return {order.items[0] for order in run(from_spec(spec, names), 0, 600)}


def test_train_and_test_part_the_items() -> None:
    train, test = drawn_from("train", NAMES, 0.3), drawn_from("test", NAMES, 0.3)
    assert not train & test
    assert train | test == set(NAMES)


@given(st.lists(st.text(max_size=20), unique=True), st.text(max_size=20), st.floats(0, 1), st.floats(0, 1))
def test_a_new_item_or_a_larger_share_moves_no_item_back(
    names: list[str], new: str, one: float, other: float
) -> None:
    small, large = sorted((one, other))
    before = {name for name in names if is_test_item(name, small)}
    assert {n for n in [new, *names] if is_test_item(n, small)} - {new} == before - {new}
    assert before <= {name for name in names if is_test_item(name, large)}
    assert not any(is_test_item(name, 0.0) for name in names)
    assert all(is_test_item(name, 1.0) for name in names)


def test_the_split_is_a_published_hash_and_gives_the_share_asked_for() -> None:
    # By hand: the first eight bytes of SHA-256 as a fraction of 2^64.
    fraction = int(hashlib.sha256(b"mug").hexdigest()[:16], 16) / 2**64
    assert not is_test_item("mug", fraction - 1e-9)
    assert is_test_item("mug", fraction + 1e-9)
    share = np.mean([is_test_item(f"thing {k}", 0.2) for k in range(20_000)])
    assert share == pytest.approx(0.2, abs=4 * np.sqrt(0.2 * 0.8 / 20_000))


def test_ranges_of_size_leave_exactly_the_items_within() -> None:
    catalogue = open_catalogue(None)
    volumes = {name: float(np.prod(catalogue.item(name).extents)) for name in catalogue}
    longest = {name: float(max(catalogue.item(name).extents)) for name in catalogue}
    spec = {"kind": "random", "items": 500, "box_volume": [2e-4, 1e-3], "longest_side": [0.05, 0.14]}
    drawn = set(run(from_spec(spec, catalogue), 0, 4)[0].items)
    within = {n for n in catalogue if 2e-4 <= volumes[n] <= 1e-3 and 0.05 <= longest[n] <= 0.14}
    assert drawn == within
    assert 3 < len(within) < len(catalogue) / 2


def test_a_listed_order_comes_as_it_was_given() -> None:
    orders = run(from_spec({"kind": "list", "items": ["item-3", "item-1", "item-3"]}, NAMES), 0)
    assert {order.items for order in orders} == {("item-3", "item-1", "item-3")}


def test_files_take_turns_and_begin_anew_with_a_new_random_generator(order_files: Path) -> None:
    by_turns = [("item-0",), ("item-1",) * 2, ("item-2",) * 3, ("item-0",)]
    for path in (str(order_files), [str(order_files / f"{k}.csv") for k in range(3)]):
        generator = from_spec({"kind": "file", "path": path}, NAMES)
        for seed in (0, 1):
            assert [order.items for order in run(generator, seed, 4)] == by_turns
    shuffled = from_spec({"kind": "file", "path": str(order_files), "shuffle": True}, NAMES)
    assert {order.items for order in run(shuffled, 0, 30)} == set(by_turns)


BAD = [
    ("kind", {}),
    ("kind", {"kind": "rnadom"}),
    ("'itmes'; did you mean 'items'", {"kind": "random", "itmes": 3}),
    ("items is 0", {"kind": "random", "items": 0}),
    ("items is [5, 3]", {"kind": "random", "items": [5, 3]}),
    ("items is True", {"kind": "random", "items": True}),
    ("items is 2.5", {"kind": "random", "items": 2.5}),
    ("items is [1, 2, 3]", {"kind": "random", "items": [1, 2, 3]}),
    ("41 items without repeats", {"kind": "random", "items": 41, "repeats": False}),
    ("repeats is 'no'", {"kind": "random", "repeats": "no"}),
    ("split is 'val'", {"kind": "random", "split": "val"}),
    ("test_share is 2", {"kind": "random", "test_share": 2}),
    ("no items to draw from", {"kind": "random", "split": "test", "test_share": 0}),
    ("catalogue of meshes", {"kind": "random", "box_volume": [0.001, 0.1]}),
    ("longest_side is [2, 1]", {"kind": "random", "longest_side": [2, 1]}),
    ("items is None", {"kind": "list"}),
    ("items is []", {"kind": "list", "items": []}),
    ("did you mean 'item-1'", {"kind": "list", "items": ["item_1"]}),
    ("path is None", {"kind": "file"}),
    ("path is 3", {"kind": "file", "path": 3}),
    ("nowhere.csv", {"kind": "file", "path": "nowhere.csv"}),
    ("holds no order file", {"kind": "file", "path": "EMPTY"}),
    ("pieces is 13", {"kind": "toy", "pieces": 13}),
    ("cut is 'saw'", {"kind": "toy", "cut": "saw"}),
    ("container is [0.3, 0.3]", {"kind": "toy", "container": [0.3, 0.3]}),
    ("container is [0.3, 0.3, nan]", {"kind": "toy", "container": [0.3, 0.3, float("nan")]}),
    ("outside|between 0.01 and 2", {"kind": "toy", "container": [3, 3, 3]}),
    ("height is 0.305", {"kind": "toy", "container": [0.3, 0.3, 0.305]}),
    ("cannot be cut into 9 pieces", {"kind": "toy", "container": [0.06, 0.06, 0.06], "pieces": 9}),
    ("cannot be cut", {"kind": "toy", "cut": "guillotine", "shortest": 0.2}),
]


@pytest.mark.parametrize(("told", "spec"), BAD, ids=lambda value: str(value)[:40])
def test_a_wrong_spec_is_told_in_one_line(told: str, spec: dict[str, object], tmp_path: Path) -> None:
    given = {key: str(tmp_path) if value == "EMPTY" else value for key, value in spec.items()}
    with pytest.raises(InputError) as caught:
        from_spec(given, NAMES)
    message = str(caught.value)
    assert any(part in message for part in told.split("|")), message
    assert "\n" not in message


def boxes() -> st.SearchStrategy[Size]:
    side = st.integers(6, 40)
    return st.tuples(side, side, side)


@given(
    st.sampled_from(sorted(CUTS)), boxes(), st.integers(1, 10), st.integers(1, 4), st.integers(0, 2**32 - 1)
)
def test_pieces_fill_the_box_and_each_can_be_lowered_onto_those_before(
    cut: str, box: Size, count: int, shortest: int, seed: int
) -> None:
    pieces = CUTS[cut](box, count, shortest, np.random.default_rng(seed))
    if pieces is None:
        return
    assert len(pieces) == count
    assert min(min(piece.size) for piece in pieces) >= min(shortest, *box)
    filled = np.zeros(box, dtype=int)
    for piece in pieces:
        cells = tuple(slice(c, c + s) for c, s in zip(piece.corner, piece.size, strict=True))
        assert not filled[cells[0], cells[1], piece.corner[2] :].any()
        assert filled[cells[0], cells[1], : piece.corner[2]].all()
        filled[cells] += 1
    assert (filled == 1).all()


@given(boxes(), st.integers(2, 8), st.integers(0, 2**32 - 1))
def test_slices_come_by_falling_volume(box: Size, count: int, seed: int) -> None:
    pieces = CUTS["slices"](box, count, 1, np.random.default_rng(seed)) or ()
    volumes = [piece.volume for piece in pieces]
    assert all(a > b for a, b in itertools.pairwise(volumes))
    assert Piece((0, 0, 0), box).volume == sum(volumes) or not volumes


def shelf(order: GeneratedOrder) -> ItemShelf:
    return shelf_of(order.meshes, GRID)


TOYS = [ToyOrders((4, 8)), ToyOrders((8, 8), cut="guillotine"), ToyOrders((2, 12), step=0.002, shuffle=True)]


@pytest.mark.parametrize("generator", TOYS, ids=["slices", "guillotine", "shuffled"])
def test_the_solution_of_a_toy_passes_the_exact_audit_and_fills_the_container(generator: ToyOrders) -> None:
    for order in run(generator, 5, 12):
        assert order.container == generator.container
        lines = tuple(OrderLine(name, n) for name, n in Counter(order.items).items())
        report = audit_plan(Plan(order.container, order.solution, (), order=lines), order.meshes)
        assert report.ok, report
        volume = sum(order.meshes[name].volume for name in order.items)
        assert 0.9999 < volume / order.container.volume <= 1.0
        if not generator.shuffle:
            assert order.items == tuple(placement.item for placement in order.solution)


def test_the_pieces_of_a_toy_are_exact_boxes_at_a_stable_pose() -> None:
    for order in run(ToyOrders((8, 8)), 1, 1):
        for placement in order.solution:
            item = order.meshes[placement.item]
            assert is_solid(item.faces) == (True, False)
            properties = solid_properties(item.vertices, item.faces)
            assert properties.volume == pytest.approx(np.prod(item.extents), rel=1e-12)
            assert item.com == pytest.approx(item.extents / 2)
            placed = item.vertices @ placement.rotation.T + placement.position
            assert placed.min(axis=0) == pytest.approx(placement.corner, abs=1e-15)
            assert np.ptp(placed, axis=0) == pytest.approx(placement.extents, abs=1e-15)
            assert np.linalg.det(placement.rotation) == pytest.approx(1.0)
            pose = stable_poses(item)[placement.pose_index]
            assert 2 * pose.com_height == pytest.approx(placement.extents[2])


SLICES = [
    # Coarse steps make few different pieces, which are prepared once.
    ToyOrders((3, 6), container=Container(0.2, 0.2, 0.16), step=0.02),
    pytest.param(ToyOrders((8, 12)), marks=pytest.mark.slow),
]


@pytest.mark.parametrize("generator", SLICES, ids=["coarse", "fine"])
def test_the_planner_packs_every_slice_by_every_greedy_heuristic(generator: ToyOrders) -> None:
    for seed in range(50):
        order = generator.generate(np.random.default_rng(seed))
        prepared = shelf(order)
        sequence = by_box_volume(order.items, prepared.prepared)
        # Volumes fall strictly, so the sequence by volume is that of the solution.
        assert tuple(sequence) == order.items
        for heuristic in GREEDY:
            options = PlanOptions(heuristic, constraints="overlap", restarts=0, grid=GRID)
            planner = assemble(options, prepared, order.container)
            packing = planner.pack(sequence, prepared.prepared, order.container)
            assert packing.complete, (seed, heuristic, packing.leftovers)
            assert packing.utilization > 0.9999


def test_guillotine_cuts_are_a_harder_level() -> None:
    solved = 0
    coarse = ToyOrders((8, 8), Container(0.2, 0.2, 0.16), "guillotine", step=0.02)
    for order in run(coarse, 0, 10):
        prepared = shelf(order)
        planner = assemble(
            PlanOptions("hm", constraints="overlap", restarts=0, grid=GRID), prepared, order.container
        )
        sequence = by_box_volume(order.items, prepared.prepared)
        solved += planner.pack(sequence, prepared.prepared, order.container).complete
    assert solved < 10
