"""What a run of experiments is asked for."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from packenv.config import EngineName
from packenv.errors import check_known
from packenv.planning.options import Constraints
from packenv.types import Container


@dataclass(frozen=True)
class RunSpec:
    """What a run is asked for; with the same one, jobs and their keys are the same.

    Attributes:
        catalogue: ``builtin`` or a folder.
        unit: of its meshes; None: metres.
        orders: how many of each experiment are drawn.
        seed: of the draw of orders.
        items: items of a large order.
        container: of large orders, inner size in m.
        methods: heuristics, by name or as ``module:rule``, and ``gls``; empty: those of each experiment.
        constraints: under which they plan.
        settings: of the planner, see :func:`packenv.experiments.setting.options_of`; empty: likewise.
        gls_plans: rounds of guided local search, the same number on every machine; paper: 5 times 300 s.
        unseen: items that nothing was tuned on: ``second-half``: every second one by name; or a file of names, one a
            line. Orders of these alone are rows of their own. None: no such rows.
        columns: ways to plan and execute, of the experiment on executions; empty: the usual ones.
        engine: of executions.
    """

    catalogue: str = "builtin"
    unit: str | None = None
    orders: int = 20
    seed: int = 0
    items: int = 10
    container: tuple[float, float, float] = (0.32, 0.32, 0.30)
    methods: tuple[str, ...] = ()
    constraints: tuple[Constraints, ...] = ("overlap", "robot")
    settings: tuple[str, ...] = ()
    gls_plans: int = 100
    unseen: str | None = None
    columns: tuple[str, ...] = ()
    engine: EngineName = "auto"

    @property
    def box(self) -> Container:
        """The container of large orders."""
        return Container(*self.container)

    @property
    def as_paper(self) -> bool:
        """Whether large orders are of the paper's size, ten items in its container: only then its figures compare."""
        return (self.items, self.container) == (RunSpec.items, RunSpec.container)

    def to_mapping(self) -> dict[str, Any]:
        """The specification as JSON has it."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}

    @classmethod
    def from_mapping(cls, values: dict[str, Any], where: str) -> RunSpec:
        """Read a specification as JSON has it.

        Args:
            values: by name.
            where: what it is of, for messages.

        Raises:
            InputError: it has a name that is none of these.
        """
        check_known(
            values, [f.name for f in fields(cls)], f"{where}: there is no setting", "the settings are"
        )
        given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
        return cls(**given)
