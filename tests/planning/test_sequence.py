"""Turns: every piece ends packed or left over, once, whatever is deferred."""

from __future__ import annotations

import random

import pytest

from packenv.planning.sequence import Turns, pieces_of


def names(turns: Turns) -> list[str]:
    return [piece.item for piece in turns.left_over]


def current(turns: Turns) -> str | None:
    return None if turns.current is None else turns.current.item


def test_pieces_of_a_name_are_numbered() -> None:
    assert [(p.item, p.instance) for p in pieces_of("aba")] == [("a", 1), ("b", 1), ("a", 2)]


def test_deferred_pieces_come_back_in_the_sequence_of_their_deferring() -> None:
    turns = Turns(pieces_of("abcd"))
    turns.defer()
    turns.placed()
    turns.defer()
    turns.placed()
    assert (current(turns), turns.stage) == ("a", 1)
    turns.defer()
    assert (current(turns), turns.stage, turns.group) == ("a", 2, 1)
    turns.give_up()
    assert (current(turns), turns.stage) == ("c", 1)
    turns.placed()
    assert (current(turns), turns.stage, turns.waiting) == (None, 0, 0)
    assert names(turns) == ["a"]


def test_without_fallback_a_deferred_piece_is_left_over() -> None:
    turns = Turns(pieces_of("ab"), fallback=False)
    turns.defer()
    assert (names(turns), current(turns)) == (["a"], "b")


def test_offline_everything_is_seen_online_only_the_buffer() -> None:
    offline, online = Turns(pieces_of("abcd")), Turns(pieces_of("abcd"), buffer=2)
    assert [p.item for p in offline.seen] == list("abcd")
    offline.defer()
    assert [p.item for p in offline.seen] == list("bcda")
    assert offline.was_deferred(offline.seen[-1])
    assert [p.item for p in online.seen] == list("ab")
    online.defer()
    assert [p.item for p in online.seen] == list("ba")
    assert online.stage == 0
    online.placed()
    assert [p.item for p in online.seen] == list("ac")
    assert online.stage == 1


def test_a_buffer_of_one_leaves_over_what_is_deferred() -> None:
    turns = Turns(pieces_of("abc"), buffer=1)
    turns.defer()
    turns.placed()
    turns.defer()
    assert (names(turns), current(turns)) == (["a", "c"], None)


def test_a_buffer_leaves_its_first_over_when_all_were_deferred_on_the_same_pile() -> None:
    turns = Turns(pieces_of("abcd"), buffer=2)
    turns.defer()
    turns.defer()
    assert (names(turns), [p.item for p in turns.seen]) == (["a"], ["b", "c"])
    turns.placed()  # b: the pile is another now
    turns.defer()
    assert names(turns) == ["a"]
    turns.defer()
    assert names(turns) == ["a", "c"]


@pytest.mark.parametrize("buffer", [None, 1, 2, 5])
@pytest.mark.parametrize("fallback", [True, False])
def test_every_piece_ends_once_and_in_time(buffer: int | None, fallback: bool) -> None:
    draw = random.Random(4)
    for _ in range(200):
        pieces = pieces_of(draw.choices("abc", k=draw.randint(1, 7)))
        turns = Turns(pieces, buffer=buffer, fallback=fallback)
        packed = []
        for _ in range(500):
            piece = turns.current
            if piece is None:
                break
            assert turns.waiting + len(packed) + len(turns.left_over) == len(pieces)
            assert turns.seen[0] == piece
            deed = draw.choice(["place", "defer", "defer"])
            if deed == "place":
                packed.append(piece)
                turns.placed()
            elif turns.group == 3:
                turns.give_up()
            else:
                turns.defer()
        assert turns.current is None
        assert sorted(map(repr, [*packed, *turns.left_over])) == sorted(map(repr, pieces))


def test_what_is_abandoned_is_left_over() -> None:
    turns = Turns(pieces_of("abc"))
    turns.defer()
    turns.abandon()
    assert (names(turns), turns.current, turns.waiting) == (["b", "c", "a"], None, 0)
