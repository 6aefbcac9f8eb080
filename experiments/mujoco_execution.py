"""A plan carried out in MuJoCo by an ideal hand, judged as :mod:`packenv.sim.session` judges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from experiments.mujoco_pile import Meeting, MujocoConfig, MujocoPile
from packenv.geometry.transforms import angle_between
from packenv.robot.cell import RELEASE_HEIGHT
from packenv.sim.descent import PlacementTask
from packenv.sim.placing import MotionConfig
from packenv.sim.rest import settle
from packenv.sim.session import Execution, ItemOutcome
from packenv.sim.verdicts import DISPLACED, Cause, collision, sticking_out
from packenv.sim.world import World
from packenv.types import Container, Pose


def execute_in_mujoco(
    tasks: Sequence[PlacementTask],
    container: Container,
    config: MujocoConfig | None = None,
    motion: MotionConfig | None = None,
) -> Execution:
    """Release one item after the other 1 cm above its planned place, at rest, and let it settle.

    The way down is not simulated: where items are released is all that the two engines share of it. An item
    that is deeper than ``motion.tolerance`` in another one or in the container when it is released has
    collided, and the execution ends.

    Args:
        tasks: in packing sequence; paths and slips are not read.
        container: the box.
        config: settings of the engine.
        motion: tolerance, longest time for settling, and when the world counts as at rest.
    """
    run = _Run(tasks, container, config, motion or MotionConfig())
    for task in tasks:
        if not run.place(task):
            break
    return run.result()


class _Run:
    def __init__(
        self,
        tasks: Sequence[PlacementTask],
        container: Container,
        config: MujocoConfig | None,
        motion: MotionConfig,
    ) -> None:
        self._tasks, self._container, self._motion = tasks, container, motion
        self._pile = MujocoPile(container, [task.item for task in tasks], config)
        self._outcomes: list[ItemOutcome] = []
        self._collision: tuple[Cause, str] | None = None

    def place(self, task: PlacementTask) -> bool:
        """Place the next item; False where it collided."""
        pile, motion = self._pile, self._motion
        before = [pile.pose(j) for j in pile.items]
        k = len(before)
        released = task.position + np.array([0.0, 0.0, RELEASE_HEIGHT])
        met = max(pile.release(task.rotation, released), key=lambda m: m.depth, default=None)
        collided = met is not None and met.depth > motion.tolerance
        start = pile.time
        at_rest = False
        if collided:
            assert met is not None
            self._collision = self._blame(task, met)
        else:
            # The watch for rest asks of a world only what a pile has as well.
            at_rest = settle(cast(World, pile), motion.settle, motion.rest).at_rest
        now = pile.pose(k)
        away = task.item.com_at(now) - task.item.com_at(Pose(task.rotation, task.position))
        moved = (
            j for j, pose in enumerate(before) if _travel(self._tasks[j], pose, pile.pose(j)) > DISPLACED
        )
        self._outcomes.append(
            ItemOutcome(
                item=task.item.name,
                planned=Pose(task.rotation, task.position),
                measured=now,
                drop_m=RELEASE_HEIGHT - float(away[2]),
                shift_m=float(np.hypot(away[0], away[1])),
                turned_rad=angle_between(now[0], task.rotation),
                settle_s=pile.time - start,
                at_rest=at_rest,
                deepest_m=None if met is None else met.depth,
                met="" if met is None else self._name(met.other),
                collided=collided,
                moved=tuple(moved),
            )
        )
        return not collided

    def result(self) -> Execution:
        """Judge by the paper's two criteria."""
        final = tuple(self._pile.pose(k) for k in self._pile.items)
        cause, detail = self._collision or self._out(final) or (None, "")
        return Execution(cause is None, cause, detail, tuple(self._outcomes), final, self._pile.time)

    def _name(self, k: int) -> str:
        return "container" if k < 0 else self._tasks[k].item.name

    def _displaced(self, k: int) -> bool:
        planned = Pose(self._tasks[k].rotation, self._tasks[k].position)
        return _travel(self._tasks[k], planned, self._pile.pose(k)) > DISPLACED

    def _blame(self, task: PlacementTask, met: Meeting) -> tuple[Cause, str]:
        gone = met.other >= 0 and self._displaced(met.other)
        return collision(task.item.name, self._name(met.other), met.depth, displaced=gone)

    def _out(self, final: Sequence[Pose]) -> tuple[Cause, str] | None:
        items = [self._tasks[k].item for k in self._pile.items]
        return sticking_out(items, final, self._container, self._displaced)


def _travel(task: PlacementTask, a: Pose, b: Pose) -> float:
    return float(np.linalg.norm(task.item.com_at(a) - task.item.com_at(b)))
