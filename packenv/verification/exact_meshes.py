"""The independent audit of a plan: ``robotpack verify``.

Every figure is recomputed from the items' exact meshes and the poses in the plan, with python-fcl. The
audit knows nothing of the planner's heightmaps, and nothing that the plan says about itself (corner,
extents, metrics) is believed.

Three questions are asked: does an item overlap another one, does one protrude from the container, and can
each be lowered straight down from above past the items placed before it?
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from packenv.config import CLEARANCE
from packenv.errors import InputError, PlanError
from packenv.geometry.collision import DEFAULT_CLEARANCE, Posed, overlap_depth, solid_of
from packenv.geometry.sweep import Insertion, Obstacle
from packenv.types import Container, Item, Placement, Plan, Pose

PROTRUSION_TOLERANCE = CLEARANCE
"""How far a vertex may be outside the container before it counts, m."""

_MISSTATED = 1e-6
"""How far a stated box may be off, m."""

_ROTATION_TOLERANCE = 1e-9
_SIDES = (("x", "low"), ("y", "low"), ("z", "low"), ("x", "high"), ("y", "high"), ("z", "high"))


@dataclass(frozen=True)
class Overlap:
    """Two placed items that are in each other.

    Attributes:
        step_a: the earlier placement's number in the packing sequence, 1 for the first as in plan files.
        step_b: the later one's.
        item_a: name of the earlier item.
        item_b: name of the later one.
        depth: length of the shortest tried translation that separates them, m: an upper bound of the
            penetration depth, always above the clearance.
    """

    step_a: int
    step_b: int
    item_a: str
    item_b: str
    depth: float


@dataclass(frozen=True)
class Protrusion:
    """An item that is partly outside the container.

    Attributes:
        step: the placement's number in the packing sequence, 1 for the first.
        item: its name.
        axis: ``x``, ``y`` or ``z`` of the container frame.
        side: ``low`` (beyond 0) or ``high`` (beyond the container's size).
        depth: how far beyond, m.
    """

    step: int
    item: str
    axis: str
    side: str
    depth: float


@dataclass(frozen=True)
class Blocked:
    """An item whose straight way down meets an item placed before it.

    Attributes:
        step: the placement's number in the packing sequence, 1 for the first.
        item: its name.
        by_step: number of the earlier placement that is in the way.
        by_item: its name.
    """

    step: int
    item: str
    by_step: int
    by_item: str


@dataclass(frozen=True)
class Miscount:
    """An item of the order of which the plan holds too few or too many pieces, leftovers included.

    Attributes:
        item: its name.
        ordered: pieces in the order.
        in_plan: pieces placed or left over.
    """

    item: str
    ordered: int
    in_plan: int


@dataclass(frozen=True)
class AuditReport:
    """What the audit found.

    An item that overlaps an earlier one is also blocked by it: the end of its way down is inside it.

    Attributes:
        overlaps: pairs of items that overlap, by step.
        protrusions: sides on which an item leaves the container, by step.
        blocked: pairs of an item and an earlier one that is in its way, by step.
        miscounted: items of which the plan does not hold as many pieces as its order.
        pairs_checked: number of pairs of placements that were compared.
        clearance: depth up to which contact is touching, m.
    """

    overlaps: tuple[Overlap, ...]
    protrusions: tuple[Protrusion, ...]
    blocked: tuple[Blocked, ...]
    miscounted: tuple[Miscount, ...]
    pairs_checked: int
    clearance: float

    @property
    def ok(self) -> bool:
        """True where nothing was found."""
        return not (self.overlaps or self.protrusions or self.blocked or self.miscounted)

    def to_json(self) -> dict[str, object]:
        """The report as JSON-able lists and numbers; lengths in m, steps from 1."""
        return {
            "ok": self.ok,
            "overlaps": [dict(vars(found)) for found in self.overlaps],
            "protrusions": [dict(vars(found)) for found in self.protrusions],
            "blocked": [dict(vars(found)) for found in self.blocked],
            "miscounted": [dict(vars(found)) for found in self.miscounted],
            "pairs_checked": self.pairs_checked,
            "clearance": self.clearance,
            "protrusion_tolerance": PROTRUSION_TOLERANCE,
        }


def audit_plan(plan: Plan, items: Mapping[str, Item], *, clearance: float = DEFAULT_CLEARANCE) -> AuditReport:
    """Check a plan against the exact meshes of its items.

    Args:
        plan: container and placements, in packing sequence.
        items: the items by name, with the meshes that the plan was made for.
        clearance: depth up to which contact is touching, m, 1e-7 to 1e-3; see
            :mod:`packenv.geometry.collision`.

    Returns:
        Overlaps, protrusions beyond 1 µm, and items that an earlier one blocks from above.

    Raises:
        PlanError: a placement names an unknown item, or its pose is not a finite rigid one.
        InputError: the clearance is outside its range.
    """
    if not 1e-7 <= clearance <= 1e-3:
        raise InputError(f"clearance is {clearance:g}, give metres between 1e-7 and 1e-3")
    placed = [_posed(step, p, items, clearance) for step, p in enumerate(plan.placements, 1)]
    obstacles = [Obstacle(posed) for posed in placed]
    names = [placement.item for placement in plan.placements]
    protrusions: list[Protrusion] = []
    overlaps: list[Overlap] = []
    blocked: list[Blocked] = []
    for later, posed in enumerate(placed):
        protrusions += _protrusions(later + 1, names[later], posed, plan.container)
        insertion = Insertion(posed)
        for earlier in range(later):
            # The item is part of its own sweep: a free way down is proof that the pair does not overlap.
            if not insertion.meets(obstacles[earlier]):
                continue
            blocked.append(Blocked(later + 1, names[later], earlier + 1, names[earlier]))
            depth = overlap_depth(placed[earlier], posed)
            if depth > 0.0:
                overlaps.append(Overlap(earlier + 1, later + 1, names[earlier], names[later], depth))
    return AuditReport(
        overlaps=tuple(overlaps),
        protrusions=tuple(protrusions),
        blocked=tuple(blocked),
        miscounted=_miscounted(plan),
        pairs_checked=len(placed) * (len(placed) - 1) // 2,
        clearance=clearance,
    )


def _posed(step: int, placement: Placement, items: Mapping[str, Item], clearance: float) -> Posed:
    """The placement's exact solid at its pose, once the pose is known to be a rigid one."""
    where = f"plan: step {step} ({placement.item})"
    item = items.get(placement.item)
    if item is None:
        raise PlanError(f"{where}: no such item; give the catalogue that the plan was made with")
    rotation = np.asarray(placement.rotation, dtype=float)
    position = np.asarray(placement.position, dtype=float)
    if rotation.shape != (3, 3) or position.shape != (3,):
        raise PlanError(
            f"{where}: pose of shape {rotation.shape} and {position.shape}, give a 3 x 3 rotation and x, y, z"
        )
    if not (np.isfinite(rotation).all() and np.isfinite(position).all()):
        raise PlanError(f"{where}: the pose has numbers that are not finite, give metres and a rotation")
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > _ROTATION_TOLERANCE:
        raise PlanError(f"{where}: the rotation is off by {error:.1e}, its rows must be orthonormal to 1e-9")
    if np.linalg.det(rotation) < 0.0:
        raise PlanError(f"{where}: the rotation mirrors the item (determinant -1), give one with +1")
    return Posed(solid_of(item, clearance), Pose(rotation, position))


def _miscounted(plan: Plan) -> tuple[Miscount, ...]:
    """Compare the order with what is placed or left over; a plan without an order claims nothing."""
    if not plan.order:
        return ()
    ordered: Counter[str] = Counter()
    for line in plan.order:
        ordered[line.item] += line.qty
    held = Counter([p.item for p in plan.placements] + [left.item for left in plan.leftovers])
    names = dict.fromkeys([*ordered, *held])
    return tuple(Miscount(n, ordered[n], held[n]) for n in names if ordered[n] != held[n])


def _protrusions(step: int, name: str, posed: Posed, container: Container) -> list[Protrusion]:
    """The sides on which an item leaves the container by more than the tolerance."""
    beyond = np.concatenate([-posed.bounds[0], posed.bounds[1] - np.asarray(container.size)])
    return [
        Protrusion(step, name, axis, side, float(depth))
        for (axis, side), depth in zip(_SIDES, beyond, strict=True)
        if depth > PROTRUSION_TOLERANCE
    ]


def misstated_boxes(plan: Plan, items: Mapping[str, Item]) -> tuple[int, ...]:
    """Steps (from 1) whose stated bounding box is not that of the mesh at the stated pose, to 1 µm.

    :func:`audit_plan` does not read the stated boxes; whoever reads a plan without its meshes does.
    """
    wrong = []
    for step, placement in enumerate(plan.placements, start=1):
        placed = items[placement.item].vertices @ placement.rotation.T + placement.position
        low, high = placed.min(axis=0), placed.max(axis=0)
        error = np.abs(np.concatenate([placement.corner - low, placement.extents - (high - low)]))
        if error.max() > _MISSTATED:
            wrong.append(step)
    return tuple(wrong)
