"""Seeded damage to files: to their bytes, to the words of a text, to the values of a JSON tree."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Any

from packenv.errors import is_number

WORDS = (
    b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"-1", b"0", b"99999999", b"9" * 400, b"1.5", b"1,5",
    b"x", b"", b'"', b"<", b"&", b"\x00", b"\xc3", b"\n",
)  # fmt: skip
"""What takes the place of a number or is put between bytes."""

VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1.5, 1e308, 99999999, 10**400, float("nan"), "", "x", "1", [], {}, [[]], {"x": 1},
)  # fmt: skip
"""What takes the place of a value of a JSON tree."""

_NUMBER = re.compile(rb"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_WORD = re.compile(rb"[^\s,;<>\"]+")


def any_damage(data: bytes, rng: Random) -> bytes:
    """One to four places of a file with another content: bytes, words or numbers."""
    change = rng.choice((changed_bytes, changed_words, exchanged_numbers))
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = change(data, rng)
    return data


def changed_bytes(data: bytes, rng: Random) -> bytes:
    """A byte flipped, a run of bytes left out, doubled or moved in, the end cut off, or a word put in."""
    at, other, length = rng.randrange(len(data) + 1), rng.randrange(len(data) + 1), rng.randint(1, 60)
    match rng.randrange(6):
        case 0:
            return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
        case 1:
            return data[:at] + data[at + length :]
        case 2:
            return data[:at] + data[other : other + length] + data[at:]
        case 3:
            return data[:at] + data[other : other + length] + data[at + length :]
        case 4:
            return data[:at]
        case _:
            return data[:at] + rng.choice(WORDS) + data[at:]


def changed_words(data: bytes, rng: Random) -> bytes:
    """A number replaced, a word doubled, left out or swapped for another, or a line doubled or left out."""
    kind = rng.randrange(6)
    spans = [found.span() for found in (_NUMBER if kind < 2 else _WORD).finditer(data)]
    if kind > 3 or not spans:
        lines = data.splitlines(keepends=True)
        if not lines:
            return rng.choice(WORDS)
        at = rng.randrange(len(lines))
        lines[at : at + 1] = [lines[at]] * rng.choice((0, 2))
        return b"".join(lines)
    start, end = rng.choice(spans)
    word = data[start:end]
    if kind == 2:
        word = rng.choice((b"", word + b" " + word, word + word))
    elif kind == 3:
        word = data[slice(*rng.choice(spans))]
    else:
        word = rng.choice(WORDS)
    return data[:start] + word + data[end:]


def exchanged_numbers(data: bytes, rng: Random) -> bytes:
    """A number in the place of another: most formats still hold, and the surface runs through itself."""
    spans = [found.span() for found in _NUMBER.finditer(data)]
    if b"\x00" not in data and len(spans) > 1:
        start, end = rng.choice(spans)
        return data[:start] + data[slice(*rng.choice(spans))] + data[end:]
    size = rng.choice((4, 8))
    # A binary file ends in its table of faces or of vertices.
    at, other = (len(data) - size * rng.randint(1, max(len(data) // size, 1)) for _ in range(2))
    at, other = max(at, 0), max(other, 0)
    return data[:at] + data[other : other + size] + data[at + size :]


def changed_tree(tree: Any, rng: Random) -> Any:
    """A copy of a JSON tree with one to three values replaced, scaled, swapped, doubled, renamed or left out."""
    tree = deepcopy(tree)
    for _ in range(rng.randint(1, 3)):
        holder = _holder(tree, rng)
        if not holder:
            return deepcopy(rng.choice(VALUES))
        keys: list[Any] = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        key, other = rng.choice(keys), rng.choice(keys)
        number = is_number(holder[key])
        match rng.randrange(8):
            case 0 | 6 | 7 if number:
                holder[key] = holder[key] * rng.choice((-1, 0, 1e-300, 0.5, 0.99, 1.0001, 2, 1000))
            case 1:
                holder[key], holder[other] = holder[other], holder[key]
            case 2:
                del holder[key]
            case 3 if isinstance(holder, list):
                holder.insert(key, deepcopy(holder[other]))
            case 3:
                holder[rng.choice(("x", "", f"{key} ", key.upper()))] = holder.pop(key)
            case _:
                holder[key] = deepcopy(rng.choice(VALUES))
    return tree


def _holder(tree: Any, rng: Random) -> Any:
    """A list or mapping of a tree: the deeper, the more of them there are."""
    holders, pending = [], [tree]
    while pending:
        here = pending.pop()
        if isinstance(here, (dict, list)):
            holders.append(here)
            pending += here.values() if isinstance(here, dict) else here
    return rng.choice([h for h in holders if h] or [None])


def changed_json(data: bytes, rng: Random) -> bytes:
    """A JSON text, damaged by its bytes, its words or its values."""
    if rng.random() < 0.3:
        return any_damage(data, rng)
    tree = changed = json.loads(data)
    while changed == tree:
        changed = changed_tree(tree, rng)
    return json.dumps(changed).encode()


def changed_zip(data: bytes, rng: Random) -> bytes:
    """An archive, one member of which is damaged, left out, there twice or under another name."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    at = rng.randrange(len(members))
    name, content = members[at]
    others = [[(name, any_damage(content, rng))]] * 5
    members[at : at + 1] = rng.choice([*others, [], [(name, content)] * 2, [(f"{name}x", content)]])
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED))) as archive:
        for number, (name, content) in enumerate(members):
            if name in archive.namelist():
                name = f"{number}{name}"
            archive.writestr(name, content)
    return stream.getvalue()


def changed_glb(data: bytes, rng: Random) -> bytes:
    """A GLB whose description is damaged, its lengths made right again, so that the damage is reached."""
    size = struct.unpack_from("<I", data, 12)[0]
    text = changed_json(data[20 : 20 + size], rng)
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + data[16:20] + text + data[20 + size :]
    return data[:8] + struct.pack("<I", 12 + len(body)) + body


_INSIDE: dict[str, Callable[[bytes, Random], bytes]] = {
    ".3mf": changed_zip,
    ".glb": changed_glb,
    ".json": changed_json,
}
"""What damages the inside of a kind of file, by its suffix; all others are text or plain tables of numbers."""


def damaged(suffix: str, data: bytes, rng: Random) -> bytes:
    """A file of a kind with damage inside it or, one time in five, to its bytes as they are; never the same."""
    changed = data
    while changed == data:
        changed = (any_damage if rng.random() < 0.2 else _INSIDE.get(suffix, any_damage))(data, rng)
    return changed
