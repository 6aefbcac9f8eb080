"""Compiling loops, and keeping them on disk for as long as nothing that they froze has changed.

Numba reads a function from disk where the function's own file is the same. It writes constants and called
functions into the machine code, though, whichever file they are in: after an edit of a joint's tolerance or of a
called function the old code would run on. Here the key of each file on disk holds them all.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import types
from numba.core.caching import FunctionCache
from numba.core.compiler import Flags
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

_PLAIN = (bool, int, float, complex, str, tuple, np.ndarray, np.generic)
"""Kinds of globals that numba freezes by value."""


class _FrozenCache(FunctionCache):
    """Numba's cache of one function, whose key also holds the constants and the functions that it froze."""

    def _index_key(self, sig: object, codegen: object) -> tuple[object, ...]:
        """Numba's key, and the digest of what was frozen: asked for at the first call, when all is there."""
        key: tuple[object, ...] = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, frozen(self._py_func))


class _Kernel(CPUDispatcher):
    """Numba's dispatcher, which compiles a function once for all integers and truth values that are passed to it.

    Numba compiles a callee anew for each constant in a call of it: ``f(x, 0)`` and ``f(x, 1)`` are two. LLVM
    puts the constants in where it inlines the callee, so they need no code of their own.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options)
        self._compiler._customize_flags = _Flags  # type: ignore[attr-defined]

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The callee's types in a call from another compiled function."""
        return super().get_call_template(tuple(map(_widened, args)), {k: _widened(v) for k, v in kws.items()})

    def compile(self, sig: Any) -> Any:
        """Compile without collections of garbage, which take a seventh of the time."""
        enabled = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if enabled:
                gc.enable()


class _Flags(Flags):
    """Numba's options of one compilation, whose values are put together once.

    Numba looks up by them whatever a function calls, a thousand times for one function, and asks each time for
    all of their values: half of what it takes to infer types.
    """

    __slots__ = ("_known",)

    def __init__(self, flags: Flags) -> None:
        super().__init__(flags)  # type: ignore[no-untyped-call]
        self._known: tuple[dict[str, Any], dict[str, Any], int] | None = None

    def __hash__(self) -> int:
        return self._all()[2]

    def __eq__(self, other: object) -> bool:
        return self.values() == other.values() if isinstance(other, Flags) else NotImplemented  # type: ignore[no-untyped-call]

    def values(self) -> dict[str, Any]:
        """The value of each option."""
        return self._all()[1]

    def _all(self) -> tuple[dict[str, Any], dict[str, Any], int]:
        known = self._known
        if known is None or known[0] != self._values:
            values = super().values()  # type: ignore[no-untyped-call]
            known = self._known = (dict(self._values), values, hash(tuple(sorted(values))))
        return known


def _widened(kind: Any) -> Any:
    """The type that a scalar argument is compiled for: no constants, and one kind of integer."""
    kind = types.unliteral(kind)  # type: ignore[no-untyped-call]
    return types.int64 if isinstance(kind, types.Integer) else kind


def frozen(function: Callable[..., Any]) -> str:
    """Digest of a function's code, of the constants it names and of the functions it calls, and so on down."""
    digest = hashlib.sha256()
    seen: set[FunctionType] = set()
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if not isinstance(one, FunctionType) or one in seen:
            continue
        seen.add(one)
        for code in _codes(one.__code__):
            digest.update(code.co_code + repr((code.co_names, _values(code), code.co_varnames)).encode())
            for name, value in _named(code, one.__globals__):
                if isinstance(value, Dispatcher):
                    waiting.append(value.py_func)
                elif isinstance(value, _PLAIN):
                    data = value.tobytes() if isinstance(value, (np.ndarray, np.generic)) else b""
                    digest.update(f"{name} {type(value).__name__} {value!r}".encode() + data)
    return digest.hexdigest()


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of the functions inside it, comprehensions among them."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _values(code: CodeType) -> list[object]:
    return [constant for constant in code.co_consts if not isinstance(constant, CodeType)]


def _named(code: CodeType, names: dict[str, Any]) -> Iterator[tuple[str, object]]:
    """What the names in some code stand for: globals, and attributes of the modules among them."""
    for name in code.co_names:
        value = names.get(name)
        if isinstance(value, ModuleType):
            yield from ((other, getattr(value, other, None)) for other in code.co_names)
        else:
            yield name, value


def _kept(options: dict[str, Any]) -> Callable[[Callable[..., Any]], Any]:
    def compile_and_keep(function: Callable[..., Any]) -> Any:
        # No wrapper for callers in C: there are none.
        always = {"nopython": True, "nogil": True, "boundscheck": None, "no_cfunc_wrapper": True}
        dispatcher = _Kernel(function, {**always, **options})
        with contextlib.suppress(RuntimeError):  # no folder can be written: compiled in each process
            # As its enable_caching() does.
            dispatcher._cache = _FrozenCache(function)  # type: ignore[attr-defined,no-untyped-call]
        return dispatcher

    return compile_and_keep


compiled = _kept({})
"""Decorator: compile a function when it is first called. It gives other threads way and raises as Python does."""

compiled_like_numpy = _kept({"error_model": "numpy"})
"""The same, but a division by zero gives infinity or NaN, as with arrays."""

compiled_in_any_sequence = _kept({"fastmath": {"reassoc", "nsz", "nnan"}})
"""The same as ``compiled``, for sums whose sequence does not matter: several terms at once are added."""
