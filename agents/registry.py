"""Agents by name."""

from __future__ import annotations

import importlib
import inspect
from types import MappingProxyType
from typing import cast

from packenv.errors import InputError, closest_match
from packenv.extensions import is_extension, made_extension

from .protocol import Agent

_CLASSES = MappingProxyType(
    {
        "hm": (".heuristics", "HM"),
        "dblf": (".heuristics", "DBLF"),
        "mta": (".heuristics", "MTA"),
        "minz": (".heuristics", "MinZ"),
        "first-fit": (".heuristics", "FirstFit"),
        "random": (".heuristics", "Random"),
        "planner": (".planner", "PlannerAgent"),
        "gls": (".gls", "GLS"),
        "learned": (".learned", "LearnedAgent"),
    }
)

NAMES = tuple(_CLASSES)
"""Every agent's name on the command line."""


def check_name(name: str) -> None:
    """Refuse an unknown agent.

    Raises:
        InputError: there is no such agent; the message names the closest one.
    """
    if name not in _CLASSES and not is_extension(name):
        raise InputError(f"agent {name!r} is not known{_hint(name)}")


def make(name: str, **options: object) -> Agent:
    """Make an agent; the module of its class, and with it torch, is loaded only now.

    Args:
        name: one of :data:`NAMES`, or ``my_module:MyAgent`` of one of the user's own.
        options: what the agent's class takes: ``heuristic`` and ``max_checked`` of ``planner``, ``config``
            (the environment's) and ``plans`` of ``gls``, ``weights`` (a folder) and ``trust`` of ``learned``.

    Raises:
        InputError: an unknown agent or option, an option that is missing, or one with a wrong value.
    """
    check_name(name)
    if is_extension(name):
        return cast(
            Agent,
            made_extension(
                name, "agent", _acts, "an object with act(obs, info) and reset(seed), or its class"
            ),
        )
    module, class_name = _CLASSES[name]
    found = getattr(importlib.import_module(module, __package__), class_name)
    known = inspect.signature(found).parameters
    for option in options:
        if option not in known:
            has = f"it takes {', '.join(known)}" if known else "it takes none"
            raise InputError(f"agent {name}: option {option!r} is not known, {has}")
    for option, parameter in known.items():
        if parameter.default is parameter.empty and option not in options:
            raise InputError(f"agent {name}: option {option!r} is missing")
    return cast(Agent, found(**options))


def _acts(thing: object) -> bool:
    methods = (getattr(thing, name, None) for name in ("act", "reset"))
    return not isinstance(thing, type) and all(map(callable, methods))


def _hint(name: str) -> str:
    return closest_match(name, NAMES, f", give one of {', '.join(NAMES)}")
