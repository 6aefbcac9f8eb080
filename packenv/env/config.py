"""The configuration of the environment ``RobotPack-v0``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, get_args

from packenv.config import UNIT_NAMES, EngineName, GridConfig
from packenv.errors import InputError, check_known
from packenv.planning.options import (
    AUTO,
    SINGLE_RULES,
    ContactRule,
    Geometry,
    GraspRule,
    HeightRule,
    PlanOptions,
    Rule,
    Sequencing,
    constraint_label,
    heuristic_label,
)

if TYPE_CHECKING:
    from packenv.planning.constraints import Constraint
    from packenv.planning.search.heuristics import Heuristic
    from packenv.robot.cell import CellSetup

MaskLevel: TypeAlias = Literal["legal", "stable", "robot"]
"""What the action mask asks of a candidate: each level asks more than the one before."""

_CONSTRAINTS: Final = {"legal": "overlap", "stable": "stability", "robot": "robot"}
_RULES: Final = {
    "mask": Rule("what a valid candidate is", get_args(MaskLevel)),
    "stability": Rule("what the pile must stand", ("paper", "margin")),
    "arrivals": Rule("whether the whole order is known", ("offline", "online")),
    "on_infeasible": Rule("what happens when an item is left over", ("skip", "terminate")),
    "unit": Rule("of the meshes", UNIT_NAMES, optional=True),
    "candidates": Rule("rows of candidates", whole=True, least=1, most=4096),
    "map_step": Rule("cells along a pixel", whole=True, least=1, most=100),
    "max_items": Rule("rows of items", whole=True, least=1, most=1024),
    "buffer": Rule("items seen online", whole=True, least=1, most=1024),
    "max_invalid": Rule("invalid actions on end", whole=True, least=1, most=1_000_000),
}
_PLANNING: Final = (
    "stability",
    "contacts",
    "heights",
    "grasp",
    "max_checked",
    "sequence",
    "own_constraints",
    "cell",
    "engine",
    "grid",
)
"""Fields that are options of planning."""


@dataclass(frozen=True)
class PackConfig:
    """The settings of the environment ``RobotPack-v0``; :meth:`from_mapping` reads them from JSON.

    Attributes:
        catalogue: ``builtin``, or a folder of items as on the command line.
        unit: unit of the catalogue's meshes where its table names none: ``m``, ``cm``, ``mm`` or ``in``.
        containers: inner (length, width, height), m; one is drawn an episode unless the order brings its own.
        grid: the discretization.
        candidates: K: rows of candidates in the observation.
        map_step: heightmap cells along one side of an observed pixel.
        max_items: rows of items in the observation.
        mask: what a valid candidate is: ``legal``: free of overlap and inside; ``stable``: also the whole
            pile stands with it; ``robot``: also the robot can bring it there.
        stability: ``paper``: equilibrium; ``margin``: also with less friction under tilted gravity.
        contacts: ``surface`` or ``paper``, as in :class:`packenv.planning.options.PlanOptions`.
        heights: ``map``: items come down as far as the heightmaps say; ``mesh``: until the surfaces touch, some
            milliseconds a candidate. With physics ``map``.
        grasp: ``seal``, ``flat`` or ``paper``, likewise.
        heuristics: own ones, each a function or ``module:name``: their scores and ranks are the last columns of
            the candidates, and the best valid candidate of each is among them.
        own_constraints: further ones that a valid candidate must pass, each an object or ``module:name``.
        cell: the robot cell: a cell file, a robot file or name, or what such a file holds (docs/cell.md); None is
            the TX90 with the container in front of it.
        max_checked: how far each heuristic's ranks are walked down to its first valid candidate (the paper's
            N).
        sequence: ``volume``: the largest bounding box first (the paper); ``given``: as the order has it.
        arrivals: ``offline``: the whole order is known; ``online``: items come in the order's own sequence,
            and only ``buffer`` of them are seen.
        buffer: items that are seen at once, online.
        fallback: deferred items of an offline order come back (paper Alg. 4).
        on_infeasible: what happens when an item is left over: ``skip``: the next one comes; ``terminate``:
            the episode ends.
        max_invalid: invalid actions on end after which an episode is truncated.
        physics: place every item in physics, and go on with the poses that are measured there.
        engine: of physics: ``bullet``, ``mujoco``, or ``auto``: PyBullet where it is installed, else MuJoCo.
    """

    catalogue: str = "builtin"
    unit: str | None = None
    containers: tuple[tuple[float, float, float], ...] = ((0.32, 0.32, 0.30),)
    grid: GridConfig = field(default_factory=GridConfig)
    candidates: int = 32
    map_step: int = 5
    max_items: int = 32
    mask: MaskLevel = "robot"
    stability: Literal["paper", "margin"] = "paper"
    contacts: ContactRule = "surface"
    heights: HeightRule = "map"
    grasp: GraspRule = "seal"
    heuristics: tuple[str | Heuristic, ...] = ()
    own_constraints: tuple[str | Constraint, ...] = ()
    cell: CellSetup | None = None
    max_checked: int = 100
    sequence: Sequencing = "volume"
    arrivals: Literal["offline", "online"] = "offline"
    buffer: int = 1
    fallback: bool = True
    on_infeasible: Literal["skip", "terminate"] = "skip"
    max_invalid: int = 20
    physics: bool = False
    engine: EngineName = "auto"

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            InputError: a value is of the wrong type or out of range.
        """
        for name, rule in _RULES.items():
            rule.check(name, getattr(self, name))
        for name in ("fallback", "physics"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} is {getattr(self, name)!r:.60}, give true or false")
        if not isinstance(self.catalogue, str) or not self.catalogue:
            raise InputError(f"catalogue is {self.catalogue!r:.60}, give a folder or 'builtin'")
        if not isinstance(self.grid, GridConfig):
            raise InputError(f"grid is {self.grid!r:.60}, give a GridConfig")
        if not self.containers:
            raise InputError("containers is empty, give at least one (length, width, height) in m")
        for size in self.containers:
            if not all(0.01 <= s <= 2.0 for s in size):
                raise InputError(f"containers: {size!r:.80} is out of range, give metres between 0.01 and 2")
        for heuristic in self.heuristics:
            PlanOptions(heuristic=heuristic)
            if heuristic == AUTO:
                raise InputError(
                    f"heuristics has {AUTO!r}, which is several rules, give {', '.join(SINGLE_RULES)} or "
                    "my_module:my_rule"
                )
        object.__setattr__(self, "cell", self.plan_options().cell)

    def plan_options(self) -> PlanOptions:
        """The options with which a planner would ask the same: no restarts, and places of the grid alone.

        Raises:
            InputError: a value is wrong.
        """
        values: dict[str, Any] = {name: getattr(self, name) for name in _PLANNING}
        shape: Geometry = "parts" if self.physics else "mesh"
        return PlanOptions(
            heuristic="hm",
            constraints=_CONSTRAINTS[self.mask],  # type: ignore[arg-type]
            restarts=0,
            places="grid",
            geometry=shape,
            **values,
        )

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object]) -> PackConfig:
        """Read settings as JSON has them; what is left out keeps its default.

        Raises:
            InputError: a key is unknown, or a value is of the wrong type or out of range.
        """
        values = dict(_checked_keys(cls, settings, "the environment's configuration"))
        if "grid" in values and not isinstance(values["grid"], GridConfig):
            grid = values["grid"]
            if not isinstance(grid, Mapping):
                raise InputError(f"grid is {grid!r:.60}, give a mapping such as {{'cell_size': 0.002}}")
            values["grid"] = PlanOptions.from_mapping(_checked_keys(GridConfig, grid, "grid"), "grid").grid
        if "containers" in values:
            values["containers"] = _sizes(values["containers"])
        for name in ("heuristics", "own_constraints"):
            given = values.get(name, ())
            if not isinstance(given, Sequence) or isinstance(given, str):
                raise InputError(f"{name} is {given!r:.60}, give a list such as ['my_module:my_rule']")
            values[name] = tuple(given)
        return cls(**values)  # type: ignore[arg-type]

    def to_mapping(self) -> dict[str, Any]:
        """The settings as JSON has them: :meth:`from_mapping` makes an equal configuration of it."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        values["grid"] = {f.name: getattr(self.grid, f.name) for f in fields(GridConfig)}
        values["containers"] = [list(size) for size in self.containers]
        values["heuristics"] = [heuristic_label(given) for given in self.heuristics]
        values["own_constraints"] = [constraint_label(given) for given in self.own_constraints]
        values["cell"] = None if self.cell is None else self.cell.to_mapping()
        return values


def _checked_keys(kind: type[Any], settings: Mapping[str, object], where: str) -> Mapping[str, object]:
    """The settings, every key of which is a field of ``kind``."""
    check_known(settings, [f.name for f in fields(kind)], f"{where} has no key", "it has")
    return settings


def _sizes(value: object) -> tuple[tuple[float, float, float], ...]:
    """Sizes of containers, of sequences of three numbers each."""
    example = "[[0.32, 0.32, 0.3]]"
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError(f"containers is {value!r:.60}, give a list of sizes such as {example}")
    sizes = []
    for size in value:
        numbers = tuple(size) if isinstance(size, Sequence) and not isinstance(size, str) else ()
        if len(numbers) != 3 or not all(isinstance(n, (int, float)) for n in numbers):
            raise InputError(f"containers has {size!r:.60}, give three numbers each, as in {example}")
        sizes.append((float(numbers[0]), float(numbers[1]), float(numbers[2])))
    return tuple(sizes)
