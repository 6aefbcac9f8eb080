"""Own heuristics, constraints, order generators and rewards by name: ``my_module:my_rule``."""

from __future__ import annotations

import hashlib
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from packenv.errors import InputError, closest_match


def is_extension(text: str) -> bool:
    """Whether a word names something of the user's own: ``module:name``."""
    return ":" in text


def load_extension(text: str, what: str) -> Any:
    """Import what ``module:name`` names; modules of the current folder are found, too.

    Importing a module runs its code: call this for names that the user typed, never for one that a file says.

    Args:
        text: ``module:name``; the name may have dots.
        what: what it is for, as the message has it, such as ``--heuristic``.

    Raises:
        InputError: no such module, it cannot be imported, or it has no such name.
    """
    module_name, _, path = text.partition(":")
    words = [*module_name.split("."), *path.split(".")]
    if not all(word.isidentifier() for word in words):
        raise InputError(f"{what} {text!r:.80}: is no name of own code, give it as my_module:my_rule")
    found: Any = _module(module_name, f"{what} {text}")
    for word in path.split("."):
        if not hasattr(found, word):
            public = [name for name in dir(found) if not name.startswith("_")]
            raise InputError(f"{what} {text}: {module_name} has no {word!r}{closest_match(word, public)}")
        found = getattr(found, word)
    return found


def made_extension(text: str, what: str, fits: Callable[[Any], bool], right: str) -> Any:
    """Import what ``module:name`` names; where that is a class or a function, have it make what is wanted.

    Args:
        text: ``module:name`` of an object, or of a class or function without arguments that makes one.
        what: as for :func:`load_extension`.
        fits: whether an object is what is wanted.
        right: what that is, for messages.

    Raises:
        InputError: as :func:`load_extension`, or it cannot be made, or is something else.
    """
    found = load_extension(text, what)
    if not fits(found) and callable(found):
        try:
            found = found()
        except Exception as problem:  # the user's code can raise anything
            detail = f"{type(problem).__name__}: {problem!s:.120}"
            raise InputError(f"{what} {text}: cannot be made without arguments: {detail}") from problem
    if not fits(found):
        raise InputError(f"{what} {text}: is {found!r:.60}, give {right}")
    return found


def code_digest(text: str) -> str:
    """Digest of the file that ``module:name`` is in; empty where there is none.

    Raises:
        InputError: as :func:`load_extension`.
    """
    load_extension(text, "own code")
    file = getattr(sys.modules[text.partition(":")[0]], "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] if file else ""


def extension_name(thing: object) -> str | None:
    """The name by which :func:`load_extension` finds an object again; None where it does not."""
    module, name = getattr(thing, "__module__", None), getattr(thing, "__qualname__", None)
    if module == "__main__":  # another program has another one
        return None
    found: object = sys.modules.get(module) if isinstance(module, str) else None
    if found is None or not isinstance(name, str):
        return None
    for word in name.split("."):
        found = getattr(found, word, None)
    return f"{module}:{name}" if found is thing else None


def _module(name: str, where: str) -> Any:
    here = str(Path.cwd())
    added = here not in sys.path and "" not in sys.path
    if added:
        sys.path.append(here)  # last, so that no file of the folder takes the place of an installed module
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as problem:
        if problem.name is not None and (name == problem.name or name.startswith(f"{problem.name}.")):
            raise InputError(
                f"{where}: there is no module {problem.name!r} in this folder or among the installed ones"
            ) from None
        raise InputError(f"{where}: {name} cannot be imported: {problem}") from problem
    except Exception as problem:
        detail = str(problem).splitlines()[0] if str(problem) else ""
        raise InputError(
            f"{where}: {name} cannot be imported: {type(problem).__name__}: {detail:.120}"
        ) from problem
    finally:
        if added:
            sys.path.remove(here)
