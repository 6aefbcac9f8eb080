"""When to begin nothing more."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """A time after which no further attempt is begun.

    Attributes:
        end: s, as the clock tells it.
        clock: tells seconds.
    """

    end: float = math.inf
    clock: Callable[[], float] = time.monotonic

    @property
    def passed(self) -> bool:
        """Whether it is over."""
        return self.end < math.inf and self.clock() > self.end


NEVER = Deadline()
"""No end."""
