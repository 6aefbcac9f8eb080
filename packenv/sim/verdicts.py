"""Why an execution is no success (paper Sec. V-C), in a word and a phrase; the same for every engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

from packenv.sim.physics_items import PhysicsItem
from packenv.types import Container, Pose

Cause: TypeAlias = Literal["collision", "item-displaced", "item-out"]

OUT = 0.002
"""An item whose hull is farther outside the container than this is out, m: a cell of the heightmaps."""
DISPLACED = 0.01
"""An item whose centre of mass is farther than this from where it was planned is displaced, m."""


def collision(mover: str, met: str, depth: float, *, displaced: bool) -> tuple[Cause, str]:
    """What a contact beyond the tolerance is called.

    Args:
        mover: what was moved.
        met: an item's name or ``container``.
        depth: m.
        displaced: whether that item had left its planned place.
    """
    deep = f"{depth * 1e3:.1f} mm deep"
    if displaced:
        return "item-displaced", f"{mover} met {met}, which had left its place, {deep}"
    return "collision", f"{mover} met {met} {deep}"


def sticking_out(
    items: Sequence[PhysicsItem],
    poses: Sequence[Pose],
    container: Container,
    displaced: Callable[[int], bool],
) -> tuple[Cause, str] | None:
    """The first item that ends outside the container; None where all are inside.

    Args:
        items: in packing sequence.
        poses: of their mesh frames, at the end.
        container: the box.
        displaced: whether an item, by index, had left its planned place.
    """
    for k, (item, pose) in enumerate(zip(items, poses, strict=True)):
        over = item.beyond(container, *pose)
        if over > OUT:
            cause: Cause = "item-displaced" if displaced(k) else "item-out"
            return cause, f"{item.name} sticks {over * 1e3:.1f} mm out of the container"
    return None
