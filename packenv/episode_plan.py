"""An episode as a plan that can be written, viewed, verified and executed."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, replace

from packenv.episode import Episode
from packenv.io.plan_maker import make_plan
from packenv.io.plans import EnvelopeRecord
from packenv.planning.packing import Packing
from packenv.types import OrderLine, Plan

_CONSTRAINTS = {"legal": "overlap", "stable": "stability", "robot": "robot"}


def episode_plan(episode: Episode) -> Plan:
    """The placements of an episode so far, as planned; pieces that are still to come are in no list of it.

    Scores are those of the first heuristic column, numbers of candidates and rejections what the environment
    asked, whatever the agent looked at.
    """
    config, shelf = episode.config, episode.shelf
    lines = tuple(OrderLine(name, qty) for name, qty in Counter(episode.names).items())
    volume = sum(shelf.item(p.item).volume for p in episode.placements)
    packing = Packing(
        episode.container,
        tuple(episode.placements),
        episode.leftovers(),
        (),
        volume / episode.container.volume,
    )
    plan = make_plan(
        packing,
        lines,
        {line.item: shelf.item(line.item) for line in lines},
        config.grid,
        catalogue=shelf.catalogue.label,
        unit=config.unit,
        settings={
            "heuristic": "agent",
            "constraints": _CONSTRAINTS[config.mask],
            "stability": config.stability,
            "contacts": config.contacts,
            "grasp": config.grasp,
            "sequence": config.sequence,
            "geometry": shelf.geometry,
        },
    )
    if shelf.geometry == "mesh":
        return plan
    meshes = {
        name: EnvelopeRecord(**asdict(mesh), envelope_sha256=shelf.shape(name).sha256)
        for name, mesh in plan.meshes.items()
    }
    return replace(plan, meshes={**meshes})
