"""The one error tree of RobotPack.

Every mistake of the user's ends in an :class:`InputError` whose message is one line that names the
file or value, what is wrong with it and what would be right. The command line prints that line and
exits with code 2. "It cannot be packed" is not an error: it is an answer, and a plan holds it.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable, Sequence
from numbers import Integral, Real
from typing import TypeGuard


class RobotPackError(Exception):
    """Root of all errors that RobotPack raises on purpose."""


class InputError(RobotPackError):
    """The user's input is wrong. The message is one line: where, what, and what would be right."""

    def __init__(self, message: str) -> None:
        """Store the message with every run of white space, line breaks included, as one space."""
        super().__init__(" ".join(str(message).split()))


def check_known(names: Iterable[object], known: Sequence[str], complaint: str, listing: str) -> None:
    """Refuse names that there are not.

    Args:
        names: what was given.
        known: what there is.
        complaint: the message before the wrong name.
        listing: the message before all known ones, where none is near.

    Raises:
        InputError: a name is unknown.
    """
    for name in names:
        if name not in known:
            hint = closest_match(name, known, f"; {listing} {', '.join(known)}")
            raise InputError(f"{complaint} {str(name)!r:.60}{hint}")


def is_number(value: object, *, whole: bool = False) -> TypeGuard[float]:
    """Whether a value is a finite number, NumPy's included, and a whole one where that is asked; a bool is none.

    A whole number beyond the largest float is none either: it cannot be converted.
    """
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def closest_match(name: object, known: Iterable[str], otherwise: str = "") -> str:
    """The end of a message about an unknown name: the closest one that there is.

    Args:
        name: what was given.
        known: what there is.
        otherwise: the end of the message where none is near.
    """
    names = {other.lower(): other for other in known}
    word = str(name).lower()
    # A short name is often meant as part of a long one ("mug" for "025_mug").
    near = sorted((other for other in names if word in other), key=len) if len(word) >= 3 else []
    near = near or difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f"; did you mean {names[near[0]]!r}?" if near else otherwise


def closest_item(name: object, items: Collection[str]) -> str:
    """The end of a message about an unknown item: the closest one, or how many there are."""
    such = f"; it has {len(items)} items, such as {next(iter(items))!r}" if items else ""
    return closest_match(name, items, such)


class MeshError(InputError):
    """A mesh file that cannot be used as the surface of a solid item."""


class UnitError(MeshError):
    """A mesh whose size says that its numbers are not metres."""

    def __init__(self, message: str, longest: float | None = None) -> None:
        """Store the message, and the longest side that is refused, m."""
        super().__init__(message)
        self.longest = longest


class CatalogueError(InputError):
    """A catalogue folder or its ``objects.csv`` is wrong."""


class OrderError(InputError):
    """An order file is wrong, or asks for an item that the catalogue does not hold."""


class ContainerError(InputError):
    """A container size or box id is wrong."""


class PhysicsError(InputError):
    """Physics is asked for where its engine, PyBullet, is not installed."""


class PlanError(InputError):
    """A plan file is wrong, or does not match the catalogue that it is read with."""
