"""Which placements stay where they are let go, and what the stability rules say of them.

``python -m benchmarks.stability_drops --catalogue DIR --orders 14``.

Random orders, largest bounding box first, each item asked at several legal places: the one that HM puts first,
the lowest one, and random ones, so that many hang between others or lean on them. Each is released in PyBullet
(μ = 0.7) exactly in its place on the free pile, all parts convex as planning knows them. It *stays* if it
comes to rest there by the rule of ``--stability physics`` (8 mm sideways, 8 mm down, 12°, nothing else moved by 4
mm). The first place of an item that stays is where the pile grows. JSON keys:

- ``drops``: how many places were asked; ``stays``: how many of these stay;
- ``rules``: for each rule how many it accepts, and of these the share that stays (``precision``); of what
  stays the share that it accepts (``recall``); the same for items that are no balls (``no_balls``):
  - ``paper``: force balance of the pile;
  - ``settles``: balance, and the item settles on its contacts from no forces (all other rules);
  - ``margin``: that, and the margin rule with all other items held (what ``cautious`` prefers);
- ``sinking``: how many of those accepted go down by more than 8 mm or turn over, by rule;
- ``settle_ms``: median CPU time of the question whether an item settles.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.physics_orders import BOX, GRID
from packenv.experiments.shelf import open_shelf
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import MARGIN
from packenv.planning.constraints import Trial
from packenv.planning.planner import by_box_volume
from packenv.planning.search.candidates import Candidates, grid_search
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_patches import thin, tighten
from packenv.planning.stability.contacts import Body, item_contacts, join, no_contacts
from packenv.planning.stability.settling import settles
from packenv.sim.drop_test import DropRule, DropTest, Lying, Release
from packenv.sim.world import WorldConfig
from packenv.types import Contacts, FloatArray, Pose

CHECKER = StabilityChecker()
RULES = ("paper", "settles", "margin")


@dataclass(frozen=True)
class Drop:
    """One place: what became of it, and what was said of it.

    Attributes:
        reason: why the item did not stay, a word; "" where it did.
        ball: whether it is a ball.
        said: what each rule says, in the sequence of :data:`RULES`.
        settle_ms: CPU time of the question whether it settles.
    """

    reason: str
    ball: bool
    said: tuple[bool, ...]
    settle_ms: float


@dataclass(eq=False)
class Pile:
    """What lies in the container, for planning and for physics."""

    surface: ContainerMap
    bodies: tuple[Body, ...] = ()
    masses: tuple[float, ...] = ()
    coms: tuple[FloatArray, ...] = ()
    contacts: Contacts = field(default_factory=no_contacts)
    lying: tuple[Lying, ...] = ()

    def with_item(self, shelf: ItemShelf, trial: Trial) -> tuple[Pile, Contacts]:
        """The pile with one more item, and the contacts of that item."""
        name = trial.oriented.item
        body = Body(shelf.fields[name], trial.oriented.rotation, trial.position)
        own = thin(item_contacts(body, self.bodies, BOX, index=len(self.bodies) + 1))
        lying = Lying(shelf.physics[name], Pose(trial.oriented.rotation, trial.position))
        grown = Pile(
            self.surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z),
            (*self.bodies, body),
            (*self.masses, shelf.masses[name]),
            (*self.coms, trial.com),
            join([self.contacts, own]),
            (*self.lying, lying),
        )
        return grown, own


def judge(pile: Pile, own: Contacts) -> tuple[tuple[bool, ...], float]:
    """What each rule says of the newest item of a pile, and the CPU-milliseconds of settling."""
    new, masses, coms = len(pile.bodies), np.array(pile.masses), np.array(pile.coms)
    balanced = CHECKER.check(pile.contacts, masses, coms).stable
    start, tight = time.process_time(), tighten(own)
    carried = balanced and settles(CHECKER, tight, coms[-1], new)
    spent = 1e3 * (time.process_time() - start)
    weak, pulls = MARGIN.weakened(CHECKER), MARGIN.pulls()
    alone = weak.balance_alone(tight, masses, coms, pulls)
    margin = (
        carried
        and all(a.status == "stable" for a in alone)
        and settles(CHECKER, tight, coms[-1], new, MARGIN)
    )
    return (balanced, carried, margin), spent


def places(candidates: Candidates, rng: np.random.Generator, random: int) -> Iterator[Trial]:
    """The places at which one item is asked."""
    first = int(np.argmin(HEURISTICS["hm"](candidates, rng)))
    drawn = rng.choice(len(candidates), min(random, len(candidates)), replace=False).tolist()
    for index in dict.fromkeys([first, int(np.argmin(candidates.z)), *drawn]):
        yield candidates.trial(index)


def drop_order(
    order: Sequence[str], shelf: ItemShelf, rng: np.random.Generator, random: int
) -> Iterator[Drop]:
    """All drops of one order."""
    test = DropTest(BOX, WorldConfig())
    pile = Pile(ContainerMap.empty(BOX, GRID.cell_size, ExactPile(shelf.shapes)))
    for name in by_box_volume(order, shelf.prepared):
        candidates = grid_search(pile.surface, shelf.prepared[name].orientations, GRID.step_cells)
        grown = None
        for trial in places(candidates, rng, random) if len(candidates) else ():
            after, own = pile.with_item(shelf, trial)
            item, pose = after.lying[-1].item, after.lying[-1].pose
            reason = test.drop(pile.lying, item, *pose, Release(height=0.0), DropRule()).reason
            said, spent = judge(after, own)
            yield Drop(reason, bool(item.radius), said, spent)
            if not reason and grown is None:
                grown = after
        pile = grown or pile
    test.close()


def shares(drops: Sequence[Drop], rule: int, asked: Callable[[Drop], bool]) -> dict[str, float | int]:
    """How well a rule tells what stays."""
    some = [drop for drop in drops if asked(drop)]
    accepted = [drop for drop in some if drop.said[rule]]
    right = sum(not drop.reason for drop in accepted)
    stays = sum(not drop.reason for drop in some)
    return {
        "accepted": len(accepted),
        "precision": round(right / max(len(accepted), 1), 4),
        "recall": round(right / max(stays, 1), 4),
    }


def main() -> int:
    """Drop, ask and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--orders", type=int, default=14)
    parser.add_argument("--items", type=int, default=8, help="items an order (default: %(default)s)")
    parser.add_argument("--random", type=int, default=4, help="random places an item (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    shelf = open_shelf(arguments.catalogue, "parts", GRID)
    rng = np.random.default_rng(arguments.seed)
    names = fitting(shelf.prepared, BOX, GRID)
    drops: list[Drop] = []
    for order in tqdm(random_orders(names, arguments.items, arguments.orders, arguments.seed)):
        drops += drop_order(order, shelf, rng, arguments.random)
    report = {
        "drops": len(drops),
        "stays": sum(not drop.reason for drop in drops),
        "rules": {
            name: {
                **shares(drops, i, lambda drop: True),
                "no_balls": shares(drops, i, lambda drop: not drop.ball),
            }
            for i, name in enumerate(RULES)
        },
        "sinking": {
            name: sum(drop.said[i] and drop.reason in ("sinks", "turns") for drop in drops)
            for i, name in enumerate(RULES)
        },
        "settle_ms": round(statistics.median(drop.settle_ms for drop in drops if drop.said[0]), 4),
    }
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
