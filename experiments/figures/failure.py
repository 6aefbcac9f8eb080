"""An execution that fails, moment by moment: an item leaves its place, and a later one meets it (paper Sec. V-C)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.execution.execute import ExecutedPlan, execute
from packenv.items.plan_items import cell_of
from packenv.planning.options import PlanOptions
from packenv.sim.camera import Recorder
from packenv.sim.verdicts import DISPLACED
from packenv.types import FloatArray, Frame, Item, Plan, Pose
from packenv.view.animation import draw_frame
from packenv.view.painter import Image
from packenv.view.stage import Stage
from packenv.view.surfaces import box_corners
from packenv.view.words import piece_names

from ..orders import random_orders
from .figure import Figure, Source
from .sheet import Panel, save, sheet

NAME = "failure"
ITEMS = 10
"""Items of an order."""
ORDERS = 12
"""Orders that are planned and carried out at most, in each way."""
RATE = 30.0
"""Recorded moments a second."""
_MOST = 4000
_SIZE = (480, 480)
_BOX_SHARE = 0.94
"""Share of a picture's sides that the box takes at most."""
_COLUMNS = 3
_PARTWAY = (0.3, 0.7)
"""Moments at which an item has gone so much of its way out of its place."""


@dataclass(frozen=True, eq=False)
class Moment:
    """A moment of a failing execution.

    Attributes:
        frame: where all is.
        outlined: the item whose place in the plan is shown.
        words: what happens.
    """

    frame: Frame
    outlined: int
    words: str


@dataclass(frozen=True, eq=False)
class Failing:
    """An execution in which an item that had left its place was in the way of a later one.

    Attributes:
        executed: the execution.
        frames: its moments.
        gone: index of the item that left its place.
        away: how far it was from that in the end, m.
        items: meshes by name.
    """

    executed: ExecutedPlan
    frames: tuple[Frame, ...]
    gone: int
    away: float
    items: dict[str, Item]

    @property
    def plan(self) -> Plan:
        """What was carried out."""
        return self.executed.plan


def failure(source: Source) -> Figure | None:
    """The figure; None where no execution fails in that way."""
    ways = (
        ("the paper's preset, all robot-packable constraints", PlanOptions.paper(geometry="parts")),
        ("the paper's preset, non-overlap alone", PlanOptions.paper(geometry="parts", constraints="overlap")),
    )
    for words, options in ways:
        names = source.names(options, source.box)
        orders = random_orders(names, ITEMS, ORDERS, source.seed)
        executions: dict[int, Failing | ExecutedPlan] = {}
        for index, order in enumerate(orders):
            plan = source.plan(order, options)
            if plan.complete:
                executions[index] = carry_out(source, plan)
        found = {k: run for k, run in executions.items() if isinstance(run, Failing)}
        if found:
            index = max(found, key=lambda k: found[k].away)
            failed = sum(
                not (run.executed if isinstance(run, Failing) else run).success for run in executions.values()
            )
            counts = f"{len(executions)} executions of random orders, {failed} failed, {len(found)}"
            return _figure(source, found[index], words, index, counts)
    source.watcher.remark(
        f"figure {NAME}: is left out, for in no execution of {ORDERS} orders an item that had left its place was met"
    )
    return None


def carry_out(source: Source, plan: Plan) -> Failing | ExecutedPlan:
    """Carry a plan out; a failing one where an item that had left its place stops a later one."""
    options = plan.made_with
    assert isinstance(options, PlanOptions)
    shelf = source.shelf(options)
    recorder = Recorder(RATE, _MOST)
    executed = execute(plan, shelf, engine=source.engine, watch=recorder)
    execution = executed.execution
    if execution.cause != "item-displaced" or not execution.items[-1].collided:
        return executed
    items = {p.item: shelf.items[p.item] for p in plan.placements}
    met = execution.items[-1].met
    away = [
        float(np.linalg.norm(_middle(items[p.item], now) - _middle(items[p.item], p.pose)))
        for p, now in zip(plan.placements, execution.final[:-1], strict=False)
    ]
    gone = [k for k, far in enumerate(away) if far > DISPLACED and plan.placements[k].item == met]
    if not gone:
        return executed
    most = max(gone, key=lambda k: away[k])
    return Failing(executed, recorder.frames(), most, away[most], items)


def moments(failing: Failing) -> tuple[Moment, ...]:
    """What to show: the item's way out of its place, then the collision.

    Args:
        failing: the execution.

    Returns:
        Moments by rising time.
    """
    plan, frames, gone = failing.plan, failing.frames, failing.gone
    names, last = piece_names(plan.placements), len(failing.executed.execution.items) - 1
    steps = {k: _released(frames, plan, k) for k in range(gone, last)}
    step = max(steps, key=lambda k: _way(failing, steps[k]).max())
    after = steps[step]
    way = _way(failing, after)
    chosen = [Moment(after[0], gone, f"Step {step + 1}: {names[step]} just before its release")]
    verb = "has moved" if step == gone else "has been moved"
    for share in _PARTWAY:
        k = int(np.argmax(way >= share * way.max()))
        chosen.append(
            Moment(after[k], gone, f"{_since(after, k)}: {names[gone]} {verb} by {100 * way[k]:.1f} cm")
        )
    far = 100 * float(_off(failing, after[-1]))
    chosen.append(Moment(after[-1], gone, f"{_since(after, -1)}: it lies {far:.1f} cm from its place"))
    end = _of_step(frames, last)
    coming = end[int(0.6 * (len(end) - 1))]
    chosen.append(Moment(coming, last, f"Step {last + 1}: {names[last]} on its way to its place"))
    chosen.append(Moment(end[-1], last, f"Step {last + 1}: {failing.executed.execution.detail}"))
    return tuple(_rising(chosen))


def _rising(chosen: Sequence[Moment]) -> Iterator[Moment]:
    """Without moments that are no later than one before them."""
    time = -1.0
    for moment in chosen:
        if moment.frame.time > time:
            yield moment
            time = moment.frame.time


def _of_step(frames: Sequence[Frame], step: int) -> list[Frame]:
    """The moments from when an item, by index, comes in until the next one does."""
    return [frame for frame in frames if len(frame.poses) == step + 1]


def _released(frames: Sequence[Frame], plan: Plan, step: int) -> list[Frame]:
    """The moments of a step from the last on in which the robot holds the item."""
    during = _of_step(frames, step)
    held = [k for k, frame in enumerate(during) if _held(frame, plan, step)]
    return during[held[-1] if held else 0 :]


def _held(frame: Frame, plan: Plan, step: int) -> bool:
    """Whether the robot still holds the latest item: it is upright over its place."""
    pose, place = frame.poses[step], plan.placements[step].pose
    turned = float(np.abs(pose.rotation - place.rotation).max())
    aside = float(np.abs((pose.position - place.position)[:2]).max())
    return turned < 1e-6 and aside < 1e-6


def _way(failing: Failing, frames: Sequence[Frame]) -> FloatArray:
    """(n,) how far the item that leaves its place has gone since the first of some moments, m."""
    item = failing.items[failing.plan.placements[failing.gone].item]
    at = np.array([_middle(item, frame.poses[failing.gone]) for frame in frames]).reshape(-1, 3)
    far: FloatArray = np.linalg.norm(at - at[:1], axis=1)
    return far


def _off(failing: Failing, frame: Frame) -> float:
    """How far that item is from its place in the plan, m."""
    placement = failing.plan.placements[failing.gone]
    item = failing.items[placement.item]
    return float(np.linalg.norm(_middle(item, frame.poses[failing.gone]) - _middle(item, placement.pose)))


def _middle(item: Item, pose: Pose) -> FloatArray:
    middle: FloatArray = pose.apply(item.com[None])[0]
    return middle


def _since(frames: Sequence[Frame], k: int) -> str:
    return f"{frames[k].time - frames[0].time:.2f} s later"


def _pictures(found: Failing, shown: Sequence[Moment]) -> Iterator[Image]:
    """The moments as pictures, the box large in the middle."""
    cell, corners = cell_of(found.plan), box_corners(found.plan.container)
    seen = Stage(cell, _SIZE).camera.project(corners)[:, :2]
    scale = float((_BOX_SHARE * np.array(_SIZE) / np.ptp(seen, axis=0)).min())
    stage = Stage(cell, (round(scale * _SIZE[0]), round(scale * _SIZE[1])))
    seen = stage.camera.project(corners)[:, :2]
    middle = (seen.min(axis=0) + seen.max(axis=0) - _SIZE) / 2
    left, top = np.clip(middle, 0, np.subtract(stage.camera.size, _SIZE)).astype(int)
    for moment in shown:
        picture = draw_frame(stage, found.plan, found.items, moment.frame, moment.outlined)
        yield picture[top : top + _SIZE[1], left : left + _SIZE[0]]


def _figure(source: Source, found: Failing, words: str, index: int, counts: str) -> Figure:
    shown = moments(found)
    panels = [
        Panel(picture, f"{number}. at {moment.frame.time:.1f} s", (), (moment.words,))
        for number, (moment, picture) in enumerate(zip(shown, _pictures(found, shown), strict=True), start=1)
    ]
    executed = found.executed
    names = piece_names(found.plan.placements)
    step = len(executed.execution.items)
    caption = (
        f"An execution in physics ({executed.config.world.engine.name}) that fails in step {step} of "
        f"{len(found.plan.placements)}: {executed.execution.detail}. {names[found.gone]} had been placed in step "
        f"{found.gone + 1}. Outlined: its place in the plan, in the last pictures that of {names[step - 1]}. Planned "
        f"with {words}. Of {counts} in this way; here the item moved farthest (order index {index} "
        f"of seed {source.seed})."
    )
    made_of = {
        "seed": source.seed,
        "index": index,
        "orders": [[p.item for p in found.plan.placements]],
        "options": executed.plan.settings,
        "engine": executed.config.world.engine.name,
        "cause": executed.execution.cause,
        "detail": executed.execution.detail,
        "failed_step": step,
        "displaced_step": found.gone + 1,
        "times_s": [moment.frame.time for moment in shown],
    }
    return Figure(
        NAME,
        "An execution that fails, moment by moment",
        caption,
        save(sheet(panels, _COLUMNS), source.out, NAME),
        "Fig. 7, a typical execution failure",
        made_of,
    )
