"""Configuration records. Every field has the paper's value as its default unless it says otherwise."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Final, Literal, TypeAlias

from packenv.errors import InputError

HEIGHT_QUANTUM = 2.0**-20
"""Heights in heightmaps are multiples of this many metres (0.95 µm), rounded outward.

Such numbers up to 16 m are exact in float32, and so are their differences and maxima; their sums are
exact in float64. The fast search therefore equals the reference bit for bit, whatever the order of
summation.
"""


@dataclass(frozen=True)
class GridConfig:
    """The discretization of the search (paper Sec. IV-B and V).

    Attributes:
        cell_size: side of a heightmap cell, m.
        grid_step: distance between tried translations in x and y, m; a whole number of cells.
        n_poses: planar-stable poses tried, by falling quasi-static probability.
        n_yaws: yaws tried for each pose, evenly over [0, π).
    """

    cell_size: float = 0.002
    grid_step: float = 0.01
    n_poses: int = 4
    n_yaws: int = 4

    def __post_init__(self) -> None:
        """Check that the grid can be built.

        Raises:
            InputError: a value is not positive, or ``grid_step`` is not a whole number of cells.
        """
        if not 2e-4 <= self.cell_size <= 0.05:
            raise InputError(f"cell_size is {self.cell_size:g} m, give a value between 0.0002 and 0.05")
        ratio = self.grid_step / self.cell_size
        if not (
            self.grid_step > 0 and ratio < 1e4 and abs(ratio - round(ratio)) < 1e-6 and round(ratio) >= 1
        ):
            raise InputError(
                f"grid_step is {self.grid_step:g} m, give a multiple of cell_size ({self.cell_size:g} m): "
                "only then are placements collision-free by construction"
            )
        if self.n_poses < 1 or self.n_yaws < 1:
            raise InputError(f"n_poses is {self.n_poses} and n_yaws {self.n_yaws}, both must be at least 1")

    @property
    def step_cells(self) -> int:
        """Cells between two tried translations."""
        return round(self.grid_step / self.cell_size)


MaskLevel: TypeAlias = Literal["legal", "stable", "robot"]
"""What the action mask asks of a candidate: each level asks more than the one before."""


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
        contacts: ``surface`` or ``paper``, as for :class:`packenv.planning.assembly.PlannerChoice`.
        grasp: ``seal``, ``flat`` or ``paper``, likewise.
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
    contacts: Literal["surface", "paper"] = "surface"
    grasp: Literal["seal", "flat", "paper"] = "seal"
    max_checked: int = 100
    sequence: Literal["volume", "given"] = "volume"
    arrivals: Literal["offline", "online"] = "offline"
    buffer: int = 1
    fallback: bool = True
    on_infeasible: Literal["skip", "terminate"] = "skip"
    max_invalid: int = 20
    physics: bool = False

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            InputError: a value is of the wrong type or out of range.
        """
        for name, (least, most) in _COUNTS.items():
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
                raise InputError(f"{name} is {value!r:.60}, give a whole number from {least} to {most}")
        for name, words in _WORDS.items():
            value = getattr(self, name)
            if value not in words:
                known = ", ".join(repr(word) for word in words)
                raise InputError(f"{name} is {value!r:.60}, give one of {known}")
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
            numbers = _checked_keys(GridConfig, grid, "grid")
            for name, value in numbers.items():
                whole = name in ("n_poses", "n_yaws")
                kinds = (int,) if whole else (int, float)
                if not isinstance(value, kinds) or isinstance(value, bool):
                    raise InputError(f"grid.{name} is {value!r:.60}, give a {'whole ' * whole}number")
            values["grid"] = GridConfig(**numbers)  # type: ignore[arg-type]
        if "containers" in values:
            values["containers"] = _sizes(values["containers"])
        return cls(**values)  # type: ignore[arg-type]

    def to_mapping(self) -> dict[str, Any]:
        """The settings as JSON has them: :meth:`from_mapping` makes an equal configuration of it."""
        return {**asdict(self), "containers": [list(size) for size in self.containers]}


_COUNTS: Final = {
    "candidates": (1, 4096),
    "map_step": (1, 100),
    "max_items": (1, 1024),
    "max_checked": (1, 100_000),
    "buffer": (1, 1024),
    "max_invalid": (1, 1_000_000),
}
_WORDS: Final[dict[str, tuple[str | None, ...]]] = {
    "mask": ("legal", "stable", "robot"),
    "stability": ("paper", "margin"),
    "contacts": ("surface", "paper"),
    "grasp": ("seal", "flat", "paper"),
    "sequence": ("volume", "given"),
    "arrivals": ("offline", "online"),
    "on_infeasible": ("skip", "terminate"),
    "unit": (None, "m", "cm", "mm", "in"),
}


def _checked_keys(kind: type[Any], settings: Mapping[str, object], where: str) -> Mapping[str, object]:
    """The settings, every key of which is a field of ``kind``."""
    known = [f.name for f in fields(kind)]
    for key in settings:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else f"; it has {', '.join(known)}"
            raise InputError(f"{where} has no key {str(key)!r:.60}{hint}")
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
