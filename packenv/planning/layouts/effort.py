"""How long a search may go on: so many moves, which makes it repeatable, or so many seconds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(eq=False)
class Effort:
    """Counts moves and seconds.

    Attributes:
        seconds: how many there are.
        moves: how many there are.
        clock: tells seconds.
        spent: moves that were made.
    """

    seconds: float = math.inf
    moves: float = math.inf
    clock: Callable[[], float] = time.perf_counter
    spent: int = 0
    _start: float = field(init=False)

    def __post_init__(self) -> None:
        self._start = self.clock()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return self.clock() - self._start

    def left(self) -> bool:
        """Whether there is any left."""
        return self.spent < self.moves and self.elapsed < self.seconds

    def share(self, parts: int) -> Effort:
        """One of equal parts of what is left, which begins now and counts here, too."""
        return Effort(
            (self.seconds - self.elapsed) / parts,
            math.ceil((self.moves - self.spent) / parts) if self.moves < math.inf else math.inf,
            self.clock,
        )
