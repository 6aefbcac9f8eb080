"""Strict reading of JSON tables: every complaint is one line that names the file, the place and what is right."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

from packenv.errors import InputError, check_known, is_number

_WORD = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HUGE = 1e6
_COUNTS = {2: "two", 3: "three"}


class Table:
    """A JSON object with the keys that it must and may have.

    Attributes:
        where: the file and the place in it, for messages.
    """

    def __init__(self, value: object, where: str, required: str, optional: str = "") -> None:
        """Check the keys.

        Args:
            value: what JSON gave.
            where: the file and the place in it.
            required: names of keys, with spaces between.
            optional: likewise.

        Raises:
            InputError: it is no object, a key is unknown, or one is missing.
        """
        self.where = where
        if not isinstance(value, Mapping):
            raise InputError(f"{where} is {value!r:.60}, give an object with {', '.join(required.split())}")
        check_known(value, [*required.split(), *optional.split()], f"{where} has no key", "it has")
        for key in required.split():
            if key not in value:
                raise InputError(f"{where}: {key} is missing")
        self._values = value

    def __contains__(self, key: str) -> bool:
        """Whether a key is there, and not null."""
        return self._values.get(key) is not None

    def value(self, key: str) -> Any:
        """Whatever stands at a key."""
        return self._values[key]

    def place(self, key: str) -> str:
        """A key and where it stands, for messages."""
        return f"{self.where}: {key}"

    def wrong(self, key: str, right: str) -> InputError:
        """The complaint about a value."""
        return InputError(f"{self.place(key)} is {self._values[key]!r:.60}, give {right}")

    def number(self, key: str, least: float = -_HUGE, most: float = _HUGE, *, above: bool = False) -> float:
        """A number from ``least`` to ``most``, ``least`` itself left out where it must be above.

        Raises:
            InputError: it is none.
        """
        value = self._values[key]
        if not _within(value, least, most, above):
            raise self.wrong(key, f"a number {_range(least, most, above)}")
        return float(value)

    def optional_number(self, key: str, least: float = -_HUGE, most: float = _HUGE) -> float | None:
        """The same, or None where the key is absent or null."""
        return self.number(key, least, most) if key in self else None

    def vector(self, key: str, least: float = -_HUGE, most: float = _HUGE) -> tuple[float, float, float]:
        """Three numbers.

        Raises:
            InputError: they are none.
        """
        x, y, z = self.numbers(key, 3, least, most)
        return x, y, z

    def numbers(
        self, key: str, count: int, least: float = -_HUGE, most: float = _HUGE, *, above: bool = False
    ) -> tuple[float, ...]:
        """So many numbers, each as :meth:`number` has it.

        Raises:
            InputError: they are none.
        """
        value = self._values[key]
        plain = isinstance(value, (list, tuple)) and len(value) == count
        if not plain or not all(_within(v, least, most, above) for v in value):
            raise self.wrong(key, f"{_COUNTS[count]} numbers {_range(least, most, above)}")
        return tuple(map(float, value))

    def rows(self, key: str, count: int | None = None) -> list[Any]:
        """A list, of ``count`` rows where that is given, else of one or more.

        Raises:
            InputError: it is none.
        """
        value = self._values[key]
        if not isinstance(value, (list, tuple)) or not value or (count is not None and len(value) != count):
            raise self.wrong(key, "a list of " + ("one or more" if count is None else str(count)))
        return list(value)

    def text(self, key: str) -> str:
        """Some text.

        Raises:
            InputError: it is none.
        """
        value = self._values[key]
        if not isinstance(value, str) or not value.strip():
            raise self.wrong(key, "some text")
        return value

    def word(self, key: str) -> str:
        """Letters, digits, ``_``, ``-`` and ``.``.

        Raises:
            InputError: it is something else.
        """
        value = self._values[key]
        if not isinstance(value, str) or not _WORD.fullmatch(value):
            raise self.wrong(key, "one word of letters, digits, _, - and .")
        return value

    def choice(self, key: str, words: Sequence[str]) -> str:
        """One of some words.

        Raises:
            InputError: it is something else.
        """
        value = self._values[key]
        if not isinstance(value, str) or value not in words:
            raise self.wrong(key, f"one of {', '.join(words)}")
        return value

    def flag(self, key: str) -> bool:
        """True or false.

        Raises:
            InputError: it is neither.
        """
        value = self._values[key]
        if not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value


def _within(value: object, least: float, most: float, above: bool) -> TypeGuard[float]:
    return is_number(value) and least <= value <= most and not (above and value == least)


def _range(least: float, most: float, above: bool) -> str:
    return f"{'above' if above else 'from'} {least:g} to {most:g}"
