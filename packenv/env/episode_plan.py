"""An episode as a plan that can be written, viewed, verified and executed."""

from __future__ import annotations

from collections import Counter

from packenv.env.episode import Episode
from packenv.items.plan_maker import make_plan
from packenv.limits import NO_LIMITS
from packenv.planning.packing import Packing
from packenv.types import OrderLine, Plan


def episode_plan(episode: Episode) -> Plan:
    """The placements of an episode so far, as planned; pieces that are still to come are in no list of it.

    Scores are those of the first heuristic column, numbers of candidates and rejections what the environment
    asked, whatever the agent looked at. Its settings are those of a planner that asks the same of placements.
    """
    shelf, limits = episode.shelf, episode.rules.limits
    counts = Counter(episode.names).items()
    lines = tuple(OrderLine(name, qty, limits.get(name, NO_LIMITS)) for name, qty in counts)
    volume = sum(shelf.items[p.item].volume for p in episode.placements)
    share = volume / episode.container.volume
    packing = Packing(
        episode.container, tuple(episode.placements), episode.leftovers(), (), share, made_by="agent"
    )
    options, unit = episode.rules.options, episode.config.unit
    return make_plan(packing, lines, shelf, options, unit=unit)
