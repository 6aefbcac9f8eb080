"""When a world counts as at rest."""

from __future__ import annotations

from dataclasses import dataclass

from packenv.sim.world import World


@dataclass(frozen=True)
class RestRule:
    """At rest: for ``time`` on end no point of any item is faster than ``speed``.

    Attributes:
        speed: bound on the speed of every point of every item, m/s.
        time: how long, s.
    """

    speed: float = 0.005
    time: float = 0.1


@dataclass(frozen=True)
class Settled:
    """How settling ended.

    Attributes:
        seconds: simulated.
        at_rest: whether the rule was met; False where the time ran out first.
    """

    seconds: float
    at_rest: bool


class RestWatch:
    """Counts how long a world has been at rest; ask it once a step."""

    def __init__(self, world: World, rule: RestRule) -> None:
        """Begin at zero."""
        self._world, self._rule, self._since = world, rule, 0.0

    def calm(self) -> bool:
        """Whether the rule is met as of this step."""
        moving = any(self._world.speed(body) > self._rule.speed for body in self._world.items)
        self._since = 0.0 if moving else self._since + self._world.config.time_step
        return self._since >= self._rule.time


def settle(world: World, longest: float, rule: RestRule | None) -> Settled:
    """Step until the world is at rest, or for ``longest`` seconds; always so long without a rule."""
    start = world.time
    watch = RestWatch(world, rule) if rule is not None else None
    while world.time - start < longest - 0.5 * world.config.time_step:
        world.step()
        if watch is not None and watch.calm():
            return Settled(world.time - start, True)
    return Settled(world.time - start, watch is None)
