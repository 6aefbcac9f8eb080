"""The sequence: every piece ends packed or left over, once, whatever is deferred."""

from __future__ import annotations

import random

import pytest

from packenv.planning.sequence import PackingSequence, pieces_of


def names(sequence: PackingSequence) -> list[str]:
    return [piece.item for piece in sequence.left_over]


def current(sequence: PackingSequence) -> str | None:
    return None if sequence.current is None else sequence.current.item


def test_pieces_of_a_name_are_numbered() -> None:
    assert [(p.item, p.instance) for p in pieces_of("aba")] == [("a", 1), ("b", 1), ("a", 2)]


def test_deferred_pieces_come_back_in_the_sequence_of_their_deferring() -> None:
    sequence = PackingSequence(pieces_of("abcd"))
    sequence.defer()
    sequence.placed()
    sequence.defer()
    sequence.placed()
    assert (current(sequence), sequence.stage) == ("a", 1)
    sequence.defer()
    assert (current(sequence), sequence.stage, sequence.group) == ("a", 2, 1)
    sequence.give_up()
    assert (current(sequence), sequence.stage) == ("c", 1)
    sequence.placed()
    assert (current(sequence), sequence.stage, sequence.waiting) == (None, 0, 0)
    assert names(sequence) == ["a"]


def test_without_fallback_a_deferred_piece_is_left_over() -> None:
    sequence = PackingSequence(pieces_of("ab"), fallback=False)
    sequence.defer()
    assert (names(sequence), current(sequence)) == (["a"], "b")


def test_offline_everything_is_seen_online_only_the_buffer() -> None:
    offline, online = PackingSequence(pieces_of("abcd")), PackingSequence(pieces_of("abcd"), buffer=2)
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
    sequence = PackingSequence(pieces_of("abc"), buffer=1)
    sequence.defer()
    sequence.placed()
    sequence.defer()
    assert (names(sequence), current(sequence)) == (["a", "c"], None)


def test_a_buffer_leaves_its_first_over_when_all_were_deferred_on_the_same_pile() -> None:
    sequence = PackingSequence(pieces_of("abcd"), buffer=2)
    sequence.defer()
    sequence.defer()
    assert (names(sequence), [p.item for p in sequence.seen]) == (["a"], ["b", "c"])
    sequence.placed()  # b: the pile is another now
    sequence.defer()
    assert names(sequence) == ["a"]
    sequence.defer()
    assert names(sequence) == ["a", "c"]


@pytest.mark.parametrize("buffer", [None, 1, 2, 5])
@pytest.mark.parametrize("fallback", [True, False])
def test_every_piece_ends_once_and_in_time(buffer: int | None, fallback: bool) -> None:
    draw = random.Random(4)
    for _ in range(200):
        pieces = pieces_of(draw.choices("abc", k=draw.randint(1, 7)))
        sequence = PackingSequence(pieces, buffer=buffer, fallback=fallback)
        packed = []
        for _ in range(500):
            piece = sequence.current
            if piece is None:
                break
            assert sequence.waiting + len(packed) + len(sequence.left_over) == len(pieces)
            assert sequence.seen[0] == piece
            deed = draw.choice(["place", "defer", "defer"])
            if deed == "place":
                packed.append(piece)
                sequence.placed()
            elif sequence.group == 3:
                sequence.give_up()
            else:
                sequence.defer()
        assert sequence.current is None
        assert sorted(map(repr, [*packed, *sequence.left_over])) == sorted(map(repr, pieces))


def test_what_is_abandoned_is_left_over() -> None:
    sequence = PackingSequence(pieces_of("abc"))
    sequence.defer()
    sequence.abandon()
    assert (names(sequence), sequence.current, sequence.waiting) == (["b", "c", "a"], None, 0)
