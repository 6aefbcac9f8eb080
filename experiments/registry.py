"""The experiments by name."""

from __future__ import annotations

from packenv.cli.bench import EXPERIMENTS, FURTHER
from packenv.errors import InputError, closest_match

from .experiment import Experiment


def experiment(name: str) -> Experiment:
    """The experiment of a name; physics is loaded only with those that need it.

    Raises:
        InputError: there is none.
    """
    from .planning import FALLBACK, HEURISTICS, SEARCH5D, SMALL_ORDERS

    found = {e.name: e for e in (SMALL_ORDERS, HEURISTICS, FALLBACK, SEARCH5D)}
    if name not in found:
        from .execution import EXECUTION, EXECUTION_SMALL
        from .robustness import ROBUSTNESS
        from .second_opinions import EARLY_REST, TWO_ENGINES

        found |= {e.name: e for e in (EXECUTION_SMALL, EXECUTION, TWO_ENGINES, EARLY_REST, ROBUSTNESS)}
    if name not in found:
        known = (*EXPERIMENTS, *FURTHER)
        hint = closest_match(name, known, f"; choose from {', '.join(known)}")
        raise InputError(f"bench: there is no experiment {name!r:.40}{hint}")
    return found[name]
