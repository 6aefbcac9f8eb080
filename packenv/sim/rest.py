"""When a world counts as at rest."""

from __future__ import annotations

from dataclasses import dataclass

from packenv.sim.world import World
from packenv.types import FloatArray

_LOOK = 0.1
"""Share of the rule's time from one look to the next."""


@dataclass(frozen=True)
class RestRule:
    """At rest: for ``time`` on end no point of any item gets farther than ``travel`` from where it was.

    Speeds would not do: Bullet leaves tall items rocking by hundredths of a millimetre, at 6 mm/s for ever.

    Attributes:
        travel: m.
        time: how long, s.
    """

    travel: float = 0.0003
    time: float = 0.15


@dataclass(frozen=True)
class Settled:
    """How settling ended.

    Attributes:
        seconds: simulated.
        at_rest: whether everything was at rest in the end; False where the time ran out first.
    """

    seconds: float
    at_rest: bool


class RestWatch:
    """Tells how long a world has been at rest; ask it once a step."""

    def __init__(self, world: World, rule: RestRule) -> None:
        """Begin now."""
        self._world, self._rule = world, rule
        self._since = self._next = 0.0
        self._from: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._reset()

    def calm(self) -> bool:
        """Whether the rule is met as of this step."""
        if self._world.time < self._next:
            return False
        self._next = self._world.time + _LOOK * self._rule.time
        for body, (at, turn) in self._from.items():
            if self._world.travel(body, at, turn) > self._rule.travel:
                self._reset()
                return False
        return self.rested

    @property
    def rested(self) -> bool:
        """Whether the rule was met at the last look."""
        return self._world.time - self._since >= self._rule.time - 1e-9

    def _reset(self) -> None:
        self._since = self._world.time
        self._next = self._since + _LOOK * self._rule.time
        self._from = {body: self._world.raw_pose(body) for body in self._world.items}


def settle(world: World, longest: float, rule: RestRule | None) -> Settled:
    """Step until the world is at rest, or for ``longest`` seconds; always so long without a rule."""
    start = world.time
    watch = RestWatch(world, rule or RestRule())
    while world.time - start < longest - 0.5 * world.time_step:
        world.step()
        if watch.calm() and rule is not None:
            return Settled(world.time - start, True)
    return Settled(world.time - start, watch.rested)
