"""What may not be done with an item: the limits that its owner sets (docs/limits.md).

They come with a catalogue's table or with an order, and every plan keeps them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from packenv.errors import InputError, is_number

UPRIGHT_TILT = 5.0
"""How far an upright item may lean where nobody says otherwise, degrees: a scan's stand is off by one or two."""

AXES = ("x", "-x", "y", "-y", "z", "-z")
"""Axes of a mesh file by name."""


@dataclass(frozen=True)
class ItemLimits:
    """What may not be done with an item; without arguments there is no limit.

    Attributes:
        upright: axis of the mesh that must point up, one of :data:`AXES`; True is ``z``, None is any way round.
        max_tilt_deg: how far that axis, ``z`` where none is named, may lean, degrees; :data:`UPRIGHT_TILT` where
            None.
        max_load_kg: what may rest on it, kg; None is any load.
        fragile: nothing may rest on it.
        no_stack: likewise; the word on the box.
        keep_apart: a group of items that goes into no box with another group; None goes with any.
    """

    upright: str | bool | None = None
    max_tilt_deg: float | None = None
    max_load_kg: float | None = None
    fragile: bool = False
    no_stack: bool = False
    keep_apart: str | None = None

    def __post_init__(self) -> None:
        """Check.

        Raises:
            InputError: a limit is none.
        """
        if isinstance(self.upright, bool):
            object.__setattr__(self, "upright", "z" if self.upright else None)
        if self.upright is not None and self.upright not in tuple(AXES):  # JSON may give a list
            raise InputError(f"upright is {self.upright!r:.60}, give yes, no, or the axis: {', '.join(AXES)}")
        tilt = self.max_tilt_deg
        if tilt is not None and not (is_number(tilt) and 0.0 < tilt <= 180.0):
            raise InputError(f"max_tilt_deg is {tilt!r:.60}, give degrees above 0, up to 180")
        if tilt is not None and self.upright is None:
            object.__setattr__(self, "upright", "z")
        most = self.max_load_kg
        if most is not None and not (is_number(most) and 0.0 <= most < math.inf):
            raise InputError(f"max_load_kg is {most!r:.60}, give kilograms of 0 or more")
        for name in ("fragile", "no_stack"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} is {getattr(self, name)!r:.60}, give yes or no")
        group = self.keep_apart
        if group is not None and not (isinstance(group, str) and group.strip() and group.isprintable()):
            raise InputError(f"keep_apart is {group!r:.60}, give the name of a group")

    @property
    def bears(self) -> float:
        """What may rest on the item, kg; infinite where there is no limit."""
        if self.fragile or self.no_stack:
            return 0.0
        return math.inf if self.max_load_kg is None else self.max_load_kg

    @property
    def words(self) -> tuple[str, ...]:
        """The limits for people, a phrase each."""
        found = []
        if self.upright is not None:
            found.append("this side up" if self.upright == "z" else f"{self.upright} side up")
            if self.max_tilt_deg is not None:
                found[-1] += f" (to {self.max_tilt_deg:g}°)"
        found += [word for word, said in (("fragile", self.fragile), ("do not stack", self.no_stack)) if said]
        if self.bears and self.max_load_kg is not None:
            found.append(f"bears {self.max_load_kg:g} kg")
        if self.keep_apart is not None:
            found.append(f"apart: {self.keep_apart}")
        return tuple(found)

    @property
    def tilt_deg(self) -> float:
        """How far the axis that must point up may lean, degrees; 180 where none must."""
        if self.upright is None:
            return 180.0
        return UPRIGHT_TILT if self.max_tilt_deg is None else self.max_tilt_deg

    @property
    def stance(self) -> tuple[str, float] | None:
        """What must be up, and how far it may lean, degrees; None where nothing must."""
        return None if self.upright is None else (str(self.upright), self.tilt_deg)

    def lean_deg(self, up: NDArray[np.float64]) -> float:
        """How far the axis that must point up leans, degrees; 0 where none must.

        Args:
            up: (3,) unit, what points up, in the mesh frame: the last row of an orientation's rotation.
        """
        if self.upright is None:
            return 0.0
        name = str(self.upright)
        along = "xyz".index(name[-1])
        rise = -float(up[along]) if name.startswith("-") else float(up[along])
        return math.degrees(math.atan2(math.hypot(up[along - 1], up[along - 2]), rise))

    def allows(self, up: NDArray[np.float64]) -> bool:
        """Whether the item may stand with this (3,) direction of its mesh up, to a thousandth of a degree."""
        return self.lean_deg(up) <= self.tilt_deg + 1e-3

    def joined(self, other: ItemLimits) -> ItemLimits:
        """These limits and further ones: the stricter of each; what must be up, and the group, as the others say."""
        loads = [most for most in (self.max_load_kg, other.max_load_kg) if most is not None]
        tilts = [limits.tilt_deg for limits in (self, other) if limits.upright is not None]
        tilt = min(tilts, default=UPRIGHT_TILT)
        return replace(
            self,
            upright=other.upright or self.upright,
            max_tilt_deg=None if tilt == UPRIGHT_TILT else tilt,
            max_load_kg=min(loads, default=None),
            fragile=self.fragile or other.fragile,
            no_stack=self.no_stack or other.no_stack,
            keep_apart=other.keep_apart or self.keep_apart,
        )

    def to_mapping(self) -> dict[str, object]:
        """Those that are set, JSON-able."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}

    @classmethod
    def from_mapping(cls, given: object) -> ItemLimits:
        """Limits of a JSON value.

        Raises:
            InputError: it is no mapping, or names or holds what is no limit.
        """
        names = [f.name for f in fields(cls)]
        if not isinstance(given, Mapping):
            raise InputError(f"limits are {given!r:.60}, give a mapping of {', '.join(names)}")
        for name in given:
            if name not in names:
                raise InputError(f"limits have no {name!r:.60}, they are {', '.join(names)}")
        return cls(**given)


NO_LIMITS = ItemLimits()
"""No limit."""
