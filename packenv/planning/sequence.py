"""Which piece comes next: the sequence of an episode, and what becomes of deferred items (paper Alg. 4)."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Piece:
    """One piece of an order.

    Attributes:
        item: name of the item.
        instance: 1 for the first piece of this name, 2 for the second, and so on.
    """

    item: str
    instance: int


def pieces_of(names: Iterable[str]) -> tuple[Piece, ...]:
    """Every name as a piece, numbered in the sequence in which they come."""
    seen: Counter[str] = Counter()
    pieces = []
    for name in names:
        seen[name] += 1
        pieces.append(Piece(name, seen[name]))
    return tuple(pieces)


class PackingSequence:
    """Hands out the pieces one after another.

    *Offline* all pieces are there from the start. In the first pass (stage 0) a deferred piece goes to the
    end of the line. The second time (stage 1) it stays: each *defer* goes on to its next group of
    orientations (stage 2), and when the groups are used up it is left over. Without fallback a deferred
    piece is left over at once.

    *Online* only the first ``buffer`` pieces are there. A deferred piece goes to the end of these; once all
    of them were deferred without a placement in between, the first is left over and the next one comes.
    """

    def __init__(self, pieces: Iterable[Piece], *, buffer: int | None = None, fallback: bool = True) -> None:
        """Begin with the first piece.

        Args:
            pieces: in their sequence.
            buffer: how many are there at once, online; None has all of them, offline.
            fallback: whether deferred pieces come back, offline.
        """
        self._line = deque(pieces)
        self._again: deque[Piece] = deque()
        self._buffer = buffer
        self._fallback = fallback
        self._deferred: set[Piece] = set()
        self._marked: set[Piece] = set()
        self.left_over: list[Piece] = []
        self.group = 0

    @property
    def current(self) -> Piece | None:
        """The piece to be placed now; None at the end."""
        line = self._line or self._again
        return line[0] if line else None

    @property
    def stage(self) -> int:
        """0 for a piece that comes for the first time, 1 for one that is back, 2 for its further groups."""
        if self._buffer is not None:
            return int(self.current in self._deferred)
        return 0 if self._line or not self._again else min(1 + self.group, 2)

    @property
    def waiting(self) -> int:
        """Pieces still to come, the current one included."""
        return len(self._line) + len(self._again)

    @property
    def seen(self) -> tuple[Piece, ...]:
        """The pieces that are there, in sequence, the current one first."""
        if self._buffer is not None:
            return tuple(self._line)[: self._buffer]
        return (*self._line, *self._again)

    def was_deferred(self, piece: Piece) -> bool:
        """Whether a piece was deferred before."""
        return piece in self._deferred

    def placed(self) -> None:
        """The current piece is packed."""
        (self._line or self._again).popleft()
        self._marked.clear()
        self.group = 0

    def defer(self) -> None:
        """The current piece shall wait, or try its next group."""
        piece = self.current
        if piece is None:
            return
        if self._buffer is not None:
            self._defer_online(piece, self._buffer)
        elif not self._line:
            self.group += 1
        else:
            self._line.popleft()
            if self._fallback:
                self._deferred.add(piece)
                self._again.append(piece)
            else:
                self.left_over.append(piece)

    def give_up(self) -> None:
        """The current piece is left over: it has no further group."""
        self.left_over.append((self._line or self._again).popleft())
        self.group = 0

    def abandon(self) -> None:
        """All that has not been placed is left over."""
        self.left_over += [*self._line, *self._again]
        self._line.clear()
        self._again.clear()

    def _defer_online(self, piece: Piece, buffer: int) -> None:
        self._deferred.add(piece)
        self._marked.add(piece)
        self._line.popleft()
        self._line.insert(min(buffer - 1, len(self._line)), piece)
        if self._marked.issuperset(self.seen):
            self.left_over.append(self._line.popleft())
