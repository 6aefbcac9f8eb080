"""The generator of orders that a user's choice names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from packenv.env.orders.records import GeneratedOrder, OrderGenerator
from packenv.env.orders.spec import DEFAULT_SPEC, Names, from_spec
from packenv.errors import InputError
from packenv.extensions import made_extension


def make_generator(
    choice: OrderGenerator | Mapping[str, Any] | str | None, catalogue: Names
) -> OrderGenerator:
    """The generator of a choice.

    Args:
        choice: a spec, see :func:`from_spec`; or an object with ``generate(rng)``; or ``my_module:name`` of
            such an object, or of a class or function without arguments that makes one; or None: 10 random
            items.
        catalogue: the catalogue, or its names where no size is asked for.

    Raises:
        InputError: as of :func:`from_spec`; or the name is unknown, or names no generator; one line.
    """
    if choice is None or isinstance(choice, Mapping):
        return from_spec(choice or DEFAULT_SPEC, catalogue)
    if isinstance(choice, str):
        what = "an object with generate(rng), or a class or function without arguments that makes one"
        made: OrderGenerator = made_extension(choice, "order_generator", _generates, what)
        return made
    if not _generates(choice):
        raise InputError(
            f"order_generator is {choice!r:.60}, give a specification, an object with generate(rng), or its "
            "name as my_module:MyGenerator"
        )
    return choice


def next_order(generator: OrderGenerator, rng: np.random.Generator) -> GeneratedOrder:
    """The next order of a generator, which may be the user's own.

    Args:
        generator: of the orders.
        rng: where all random numbers come from.

    Raises:
        InputError: it returned something else than an order.
    """
    order: Any = generator.generate(rng)
    if not isinstance(order, GeneratedOrder):
        raise InputError(
            f"order_generator: generate returned {order!r:.60}, give a "
            "packenv.env.orders.GeneratedOrder(items=...)"
        )
    return order


def _generates(thing: object) -> bool:
    """Whether it is a generator; the class of one is none."""
    return not isinstance(thing, type) and callable(getattr(thing, "generate", None))
