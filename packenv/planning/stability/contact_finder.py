"""How contacts of a new item with a pile are found, as the options name it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from packenv.planning.options import ContactRule
from packenv.planning.stability.contact_patches import thin, tighten
from packenv.planning.stability.contacts import Body, item_contacts, with_friction
from packenv.types import Contacts, Container

ContactFinder: TypeAlias = Callable[[Body, Sequence[Body], Container, int], Contacts]


def contact_finder(rule: ContactRule, mu: float, *, tight: bool) -> ContactFinder:
    """How contacts of a new item with the pile are found.

    Args:
        rule: ``surface``: surfaces at most 1.5 mm apart, thinned by patches; ``paper``: geometry scaled by
            1.03 that overlaps, merged in 1 cm cells.
        mu: coefficient of friction of the container, and of items without their own.
        tight: tighten surface contacts to those that can touch together: a margin on contacts that only the
            threshold bridges would be no margin.
    """

    def find(new: Body, others: Sequence[Body], container: Container, index: int) -> Contacts:
        if rule == "paper":
            from packenv.planning.stability.paper_contacts import paper_contacts  # fcl and scipy

            found = paper_contacts(new, others, container, index=index)
        else:
            found = item_contacts(new, others, container, index=index)
            found = thin(tighten(found) if tight else found)
        return with_friction(found, (*others, new), mu)

    return find


def grounded(contacts: Contacts, ground: int) -> Contacts:
    """Contacts with the first ``ground`` bodies as contacts with the container."""
    if not ground:
        return contacts
    first, second = (np.maximum(b - ground, 0) for b in (contacts.first, contacts.second))
    swap = second == 0
    return replace(
        contacts,
        normals=np.where(swap[:, None], -contacts.normals, contacts.normals),
        first=np.where(swap, second, first),
        second=np.where(swap, first, second),
    )
