"""Every option of planning, once: flags, plan files, the environment and the documentation read them here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from packenv.config import EngineName, GridConfig
from packenv.errors import InputError, check_known, closest_match, is_number
from packenv.extensions import extension_name, is_extension

if TYPE_CHECKING:  # what these import takes longer than the command line's help may
    from packenv.planning.constraints import Constraint
    from packenv.planning.search.heuristics import Heuristic
    from packenv.robot.cell import CellSetup

HeuristicName: TypeAlias = Literal["auto", "hm", "dblf", "mta", "minz", "first-fit", "random"]
Constraints: TypeAlias = Literal["overlap", "stability", "robot"]
StabilityRule: TypeAlias = Literal["paper", "cautious", "margin", "physics"]
ContactRule: TypeAlias = Literal["surface", "paper"]
HeightRule: TypeAlias = Literal["map", "mesh"]
Places: TypeAlias = Literal["grid", "exact"]
GraspRule: TypeAlias = Literal["seal", "flat", "paper"]
Search: TypeAlias = Literal["3d", "5d"]
Sequencing: TypeAlias = Literal["volume", "given"]
Method: TypeAlias = Literal["auto", "search", "separate", "gls"]
Goal: TypeAlias = Literal["items", "height", "box", "robust"]
"""What a search is after, most items always before all else: see :attr:`PlanOptions.goal`."""
Geometry: TypeAlias = Literal["mesh", "parts"]
"""What is planned with: an item's mesh, or its envelope: mesh and convex parts together."""

_OPTIONS_ARE = "the options are"
AUTO = "auto"
"""The heuristic that is several rules (:mod:`packenv.planning.portfolio`)."""
STANDS_FOR_AUTO = "hm"
"""The rule in place of it where one rule has to do: it is the paper's."""
SINGLE_RULES = tuple(name for name in get_args(HeuristicName) if name != AUTO)
"""The built-in heuristics that are one rule."""
OWN = "<own>"
"""Stands in a file for an own heuristic or constraint that no module's name leads to, such as a lambda."""


@dataclass(frozen=True)
class Rule:
    """What an option may be.

    Attributes:
        meaning: one sentence for people.
        words: the values, where it is one of some words; a heuristic may be ``module:name`` as well.
        whole: a whole number, else any; None where it is no number.
        least: smallest value.
        most: largest value.
        optional: None is a value, too.
    """

    meaning: str
    words: tuple[str, ...] = ()
    whole: bool | None = None
    least: float = 0
    most: float = math.inf
    optional: bool = False

    @property
    def right(self) -> str:
        """What would be right, for messages and tables."""
        if self.words:
            return f"one of {', '.join(self.words)}"
        kind = "a whole number" if self.whole else "a number"
        most = f"{int(self.most)}" if self.whole and self.most < math.inf else f"{self.most:g}"
        top = f" to {most}" if self.most < math.inf else " up"
        return f"{kind} from {self.least:g}{top}" + (", or none" if self.optional else "")

    def check(self, name: str, value: object) -> None:
        """Refuse a wrong value.

        Raises:
            InputError: it is wrong.
        """
        if value is None and self.optional:
            return
        if self.words:
            ok = isinstance(value, str) and value in self.words
        else:
            ok = is_number(value, whole=bool(self.whole)) and self.least <= value <= self.most
        if not ok:
            hint = closest_match(value, self.words) if isinstance(value, str) else ""
            raise InputError(f"{name} is {value!r:.60}, give {self.right}{hint}")


def _words(kind: Any, default: str | None, meaning: str, *, optional: bool = False) -> Any:
    return field(default=default, metadata={"rule": Rule(meaning, get_args(kind), optional=optional)})


def _number(default: float | None, meaning: str, *, whole: bool = False, **limits: Any) -> Any:
    return field(default=default, metadata={"rule": Rule(meaning, whole=whole, **limits)})


_GRID = {
    "cell_size": Rule("side of a heightmap cell, m", whole=False, least=2e-4, most=0.05),
    "grid_step": Rule("distance between tried translations, m; a multiple of cell_size", whole=False),
    "n_poses": Rule("stable poses tried, the most probable first", whole=True, least=1),
    "n_yaws": Rule("yaws tried for each pose, evenly over half a turn", whole=True, least=1),
}


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Attributes:
        heuristic: how candidates are ranked: a name, an own one as ``module:name``, or a function
            (:mod:`packenv.planning.search.heuristics`); ``auto``: by several rules, the best plan is kept
            (:mod:`packenv.planning.portfolio`), and by ``hm`` where physics is asked.
        tie_break: c of ``hm`` and ``dblf``, in ``auto`` too: weight of X + Y; None takes what measured best, the
            paper: 1.
        constraints: ``overlap``; ``stability``: also force balance; ``robot``: also manipulation.
        own_constraints: further ones, each an object or ``module:name``.
        cell: robot, container's place and friction, as :func:`packenv.load_cell` gives or takes them; None is the
            TX90 with the container in front of it, as any that is equal to that becomes.
        stability: ``paper``: equilibrium; all others also ask that each item settles where it is let go
            (:mod:`packenv.planning.stability.settling`). ``cautious``: of that rather what also survives the margin
            rule while all others are held, and what has no such place goes last; ``margin``: the whole pile also
            survives it; ``physics``: and a drop in physics (:mod:`packenv.execution.physics_planner`).
        contacts: ``surface``: what is at most 1.5 mm apart; ``paper``: what overlaps when scaled by 1.03.
        heights: how low an item comes: ``map``: as the conservative heightmaps say (the paper); ``mesh``: until the
            surfaces touch, so nesting items nest; not with clearance.
        places: where an item is tried: ``grid``: at the translations of the grid (the paper); ``exact``: also flush
            with walls and sides of placed items, and at every cell around the best; not with clearance.
        grasp: ``seal``: where the cup lies on the surface, rough spots where there is no flat one; ``flat``:
            flat spots alone; ``paper``: the centre of the top surface, whatever is there.
        search: ``3d`` with the fallback, or ``5d`` at once.
        method: ``search``: one item after another (the paper). By layouts of all items at once that become plans
            (:mod:`packenv.planning.layouts`): ``separate``: overlaps are moved out; ``gls``: guided local search.
            For these ``budget`` and ``plans`` say how long to go on, 20 seconds where neither is given; a round of
            moves of all pieces counts as a plan. ``auto``: ``search`` and ``separate`` by turns, each for a part of a
            budget, until all items are placed. Smaller boxes of several are tried by ``search``.
        sequence: ``volume``: the largest bounding box first (the paper); ``given``: as the order has it.
        restarts: how often an incomplete order is planned again with its leftovers first; the paper: 0.
        budget: seconds in which better plans are searched for (:mod:`packenv.planning.anytime`); None makes the
            first plan alone.
        plans: the same, as a number of plans: the same number gives the same plan.
        goal: what is better once no more items can be placed: ``items``: nothing, the search ends; ``height``: the
            lowest pile; ``robust``: the largest margin of the item that has least; ``box``: the smallest of several
            boxes, in a single one as ``items``.
        max_checked: the paper's N.
        clearance: how far an item may be off sideways at the release and still meet nothing, m, rounded up to
            whole cells; less, and none in the end, where it leaves an item without a place. The paper: 0.
        rehearse: in how many worlds the plan is carried out before it is given out
            (:mod:`packenv.execution.rehearsal`).
        engine: of drops and rehearsals: PyBullet, MuJoCo, or ``auto``: PyBullet where it is installed, else MuJoCo.
        geometry: ``mesh``, or ``parts``: meshes together with the convex parts that stand for them in physics;
            None takes ``parts`` where physics is asked, else ``mesh``; either is None where it is that, too,
            see :attr:`shape`.
        seed: for heuristics that draw.
        grid: the discretization.
    """

    heuristic: str | Heuristic = field(
        default=AUTO,
        metadata={
            "rule": Rule(
                "how candidates are ranked; auto: by several rules, the best plan is kept",
                get_args(HeuristicName),
            )
        },
    )
    tie_break: float | None = _number(
        None,
        "c of hm and dblf: weight of X + Y; none: what measured best, the paper: 1",
        most=1e6,
        optional=True,
    )
    constraints: Constraints = _words(
        Constraints,
        "robot",
        "what a placement must meet: no overlap; also force balance of the pile; also a way for the robot to "
        "bring it there",
    )
    own_constraints: Sequence[str | Constraint] = ()
    cell: CellSetup | None = None
    stability: StabilityRule = _words(
        StabilityRule,
        "cautious",
        "equilibrium; all others: and each item settles where it is let go; cautious: rather where it also "
        "stands under gravity tilted by 8 degrees with a friction of 0.25; margin: only where it does; physics: "
        "and after a drop in physics the item lies where it was planned",
    )
    contacts: ContactRule = _words(
        ContactRule,
        "surface",
        "contacts are where surfaces are at most 1.5 mm apart, or, as in the paper, where items scaled by 1.03 "
        "overlap",
    )
    heights: HeightRule = _words(
        HeightRule,
        "mesh",
        "an item comes down as far as the conservative heightmaps say, or until the surfaces touch, so that nesting "
        "items nest",
    )
    places: Places = _words(
        Places,
        "exact",
        "an item is tried at the translations of the grid alone, or also flush with walls and with the sides of "
        "placed items, and at every cell around the best",
    )
    grasp: GraspRule = _words(
        GraspRule,
        "seal",
        "where the vacuum cup may take an item: where it seals (a rough spot where there is no flat one), flat "
        "spots alone, or the centre of the top surface whatever is there",
    )
    search: Search = _words(
        Search, "3d", "stable poses first and perturbed ones as the fallback, or all at once"
    )
    method: Method = _words(
        Method,
        "auto",
        "search: items are placed one after another; separate and gls: all are in the box from the start and "
        "overlaps are moved out, by separation or by guided local search, before a sequence is looked for in which "
        "they can be lowered, for 20 seconds, or as budget and plans say; auto: search and separate by turns, each for "
        "a part of a budget, until all items are placed",
    )
    sequence: Sequencing = _words(
        Sequencing, "volume", "by non-increasing bounding-box volume, or as the order gives it"
    )
    restarts: int = _number(
        3,
        "plan an incomplete order up to N times again with its leftovers first; none with several boxes",
        whole=True,
    )
    budget: float | None = _number(
        None,
        "search for better plans for so many seconds; Ctrl-C gives the best so far",
        most=1e6,
        optional=True,
    )
    plans: int | None = _number(
        None,
        "search for better plans, so many of them; the same number gives the same plan",
        whole=True,
        most=10**9,
        optional=True,
    )
    goal: Goal = _words(
        Goal,
        "items",
        "what the search is after besides most items: nothing, and it ends when all are packed; the lowest pile; the "
        "smallest of several boxes; or the largest margin against tilting of the item that has least",
    )
    max_checked: int = _number(
        100, "candidates of one item that are put to the constraints", whole=True, least=1, most=100_000
    )
    clearance: float = _number(
        0.0,
        "how far an item may be off sideways at the release and still meet nothing, m; less where it would "
        "leave an item without a place",
        most=0.05,
    )
    rehearse: int = _number(
        0,
        "carry the plan out in N simulated worlds, the nominal one and N - 1 disturbed ones in which the robot "
        "feels contacts, and plan otherwise where it fails",
        whole=True,
        most=100,
    )
    engine: EngineName = _words(
        EngineName,
        "auto",
        "the physics engine of drops and rehearsals: PyBullet, MuJoCo, or PyBullet where it is installed, else MuJoCo",
    )
    geometry: Geometry | None = _words(
        Geometry,
        None,
        "plan on the meshes, or on meshes together with the convex parts that stand for them in physics; by "
        "itself mesh, and parts with stability physics or rehearsals",
        optional=True,
    )
    seed: int = _number(0, "for heuristics that draw", whole=True, most=2**64 - 1)
    grid: GridConfig = field(default_factory=GridConfig)

    def __post_init__(self) -> None:
        """Check every value, and that they go together.

        Raises:
            InputError: one is wrong, or two contradict each other.
        """
        for name, rule in rules().items():
            value = getattr(self, name)
            if name == "heuristic" and (not isinstance(value, str) or is_extension(value) or value == OWN):
                if not isinstance(value, str) and not callable(value):
                    raise InputError(
                        f"heuristic is {value!r:.60}, give {rule.right}, my_module:my_rule or a function"
                    )
                continue
            rule.check(name, value)
            if value is not None and not rule.words:  # NumPy's numbers become Python's, which JSON knows
                object.__setattr__(self, name, int(value) if rule.whole else float(value))
        if not isinstance(self.grid, GridConfig):
            raise InputError(f"grid is {self.grid!r:.60}, give a GridConfig")
        if not isinstance(self.own_constraints, Sequence) or isinstance(self.own_constraints, str):
            raise InputError(
                f"own_constraints is {self.own_constraints!r:.60}, give a list such as ['my_module:MyRule']"
            )
        object.__setattr__(self, "own_constraints", tuple(self.own_constraints))
        for given in self.own_constraints:
            if not _is_constraint(given):
                raise InputError(
                    f"own_constraints has {given!r:.60}, give my_module:MyRule or an object of a class that is "
                    "derived from packenv.Constraint"
                )
        if self.cell is not None:
            object.__setattr__(self, "cell", _cell(self.cell))
        if self.stability == "physics" and self.constraints == "overlap":
            raise InputError(
                "stability physics: needs force balance, which constraints overlap leaves out; "
                "give constraints stability or robot"
            )
        if self.stability == "physics" and self.plans is not None:
            raise InputError("plans: stability physics makes one plan; give budget, or leave it out")
        if self.goal == "robust" and self.constraints == "overlap":
            raise InputError(
                "goal robust: a margin is one of force balance, which constraints overlap leaves out; "
                "give constraints stability or robot"
            )
        if self.asks_physics and self.geometry == "mesh":
            asks = "stability physics" if self.stability == "physics" else f"rehearse {self.rehearse}"
            raise InputError(f"{asks}: knows convex parts alone; leave geometry mesh out")
        if self.geometry == ("parts" if self.asks_physics else "mesh"):
            object.__setattr__(self, "geometry", None)

    @property
    def asks_physics(self) -> bool:
        """Whether planning needs the physics engine."""
        return self.stability == "physics" or self.rehearse > 0

    @property
    def setup(self) -> CellSetup:
        """The robot cell."""
        from packenv.robot.files import default_cell

        return self.cell or default_cell()

    @property
    def shape(self) -> Geometry:
        """What is planned with."""
        return self.geometry or ("parts" if self.asks_physics else "mesh")

    @classmethod
    def paper(cls, **others: Any) -> PlanOptions:
        """Every parameter as the paper has it (Sec. V), but for those that are given."""
        return cls(**{**PAPER, **others})

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object], where: str = "the options") -> PlanOptions:
        """Read options as JSON has them; what is left out keeps its default.

        Args:
            settings: by name, the grid's four numbers among them.
            where: what they are of, for messages.

        Raises:
            InputError: a name is unknown, or a value is wrong.
        """
        check_known(settings, option_names(), f"{where}: there is no option", _OPTIONS_ARE)
        try:
            return cls().changed(settings)
        except InputError as problem:
            raise InputError(f"{where}: {problem}") from None

    def changed(self, words: Mapping[str, Any]) -> PlanOptions:
        """The same options but for those that are given by name; the grid's four numbers are names, too.

        Raises:
            InputError: a name is unknown, or a value is wrong.
        """
        known = (*option_names(), "grid")
        check_known(words, known, "the options: there is no option", _OPTIONS_ARE)
        for name, rule in _GRID.items():
            if name in words:
                rule.check(name, words[name])
        cells: dict[str, Any] = {name: words[name] for name in _GRID if name in words}
        values: dict[str, Any] = {name: value for name, value in words.items() if name not in _GRID}
        if cells:
            values["grid"] = replace(values.get("grid", self.grid), **cells)
        return replace(self, **values)

    def to_mapping(self) -> dict[str, object]:
        """The options as JSON has them: :meth:`from_mapping` makes equal ones of it.

        An own heuristic or constraint is its ``module:name``; ``<own>`` where no such name leads to it.
        """
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "grid"}
        values["heuristic"] = heuristic_label(self.heuristic)
        if not isinstance(self.heuristic, str) and values["heuristic"] in get_args(HeuristicName):
            values["tie_break"] = getattr(self.heuristic, "c", None)
        values["own_constraints"] = [constraint_label(given) for given in self.own_constraints]
        values["cell"] = None if self.cell is None else self.cell.to_mapping()
        values["geometry"] = self.shape
        return {**values, **{name: getattr(self.grid, name) for name in _GRID}}


PAPER: Mapping[str, Any] = {
    "heuristic": "hm",
    "tie_break": 1.0,
    "constraints": "robot",
    "stability": "paper",
    "contacts": "paper",
    "heights": "map",
    "places": "grid",
    "grasp": "paper",
    "search": "3d",
    "method": "search",
    "sequence": "volume",
    "restarts": 0,
    "budget": None,
    "plans": None,
    "goal": "items",
    "max_checked": 100,
    "clearance": 0.0,
    "rehearse": 0,
    "grid": GridConfig(cell_size=0.002, grid_step=0.01, n_poses=4, n_yaws=4),
}
"""The paper's choices, where it made one."""

PRESETS: Mapping[str, Callable[..., PlanOptions]] = {"default": PlanOptions, "paper": PlanOptions.paper}
"""Options by one word."""


def rules() -> dict[str, Rule]:
    """What each option of :class:`PlanOptions` may be, the grid and own constraints left out."""
    return {f.name: f.metadata["rule"] for f in fields(PlanOptions) if "rule" in f.metadata}


def grid_rules() -> dict[str, Rule]:
    """What each setting of the grid may be."""
    return dict(_GRID)


def option_names() -> tuple[str, ...]:
    """Names of all options as a plan file has them."""
    return (*(f.name for f in fields(PlanOptions) if f.name != "grid"), *_GRID)


def heuristic_label(heuristic: str | Heuristic) -> str:
    """The name of a heuristic in files and messages."""
    if isinstance(heuristic, str):
        return heuristic
    from packenv.planning.search.heuristics import name_of

    name = name_of(heuristic)
    return (extension_name(heuristic) or OWN) if name == "own" else name


def constraint_label(constraint: str | Constraint) -> str:
    """The name of an own constraint in files and messages: the one that it was given by, if any."""
    return constraint if isinstance(constraint, str) else OWN


def _cell(given: object) -> CellSetup | None:
    """A cell in any of the ways in which it may be given; None for the usual one.

    Raises:
        InputError: it is none.
    """
    from packenv.robot.cell import CellSetup
    from packenv.robot.files import default_cell, load_cell

    if not isinstance(given, (str, Path, Mapping, CellSetup)):
        raise InputError(f"cell is {given!r:.60}, give a cell file, a robot's name or packenv.load_cell(...)")
    found = load_cell(given)
    return None if found == default_cell() else found


def _is_constraint(given: object) -> bool:
    if isinstance(given, str):
        return is_extension(given) or given == OWN
    from packenv.planning.constraints import Constraint

    return isinstance(given, Constraint)
