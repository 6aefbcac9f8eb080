"""Frozen records that the whole package shares.

Units are SI throughout: metres, kilograms, radians. The container frame has its origin at the inner
floor corner, z up. A *mesh frame* is the frame of the item's mesh file, scaled to metres.
Arrays in these records are read-only by convention: whoever wants to change one copies it.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from packenv.errors import ContainerError, OrderError, PlanError, is_number
from packenv.limits import NO_LIMITS, ItemLimits

if TYPE_CHECKING:
    import trimesh

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


class Pose(NamedTuple):
    """Where a mesh frame is: p_container = rotation @ p_mesh + position.

    Attributes:
        rotation: (3, 3) proper rotation.
        position: (3,) m.
    """

    rotation: FloatArray
    position: FloatArray

    def moved(self, offset: FloatArray) -> Pose:
        """The same rotation, moved by ``offset`` (3,), m."""
        return Pose(self.rotation, self.position + offset)

    def apply(self, points: FloatArray) -> FloatArray:
        """(n, 3) mesh-frame points in the container frame, m."""
        placed: FloatArray = points @ self.rotation.T + self.position
        return placed

    def invert(self, points: FloatArray) -> FloatArray:
        """(n, 3) container-frame points in the mesh frame, m."""
        local: FloatArray = (points - self.position) @ self.rotation
        return local

    @property
    def matrix(self) -> FloatArray:
        """(4, 4) homogeneous transform."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position
        return matrix


def normal_name(name: str) -> str:
    """A name as it is compared: in Unicode's normal form C, because file systems and editors mix C and D."""
    return unicodedata.normalize("NFC", name)


@dataclass(frozen=True)
class Container:
    """The box that is packed.

    Attributes:
        length: inner size along x, m.
        width: inner size along y, m.
        height: inner size along z, m.
        name: box id from ``boxes.csv``, or None for a size that the user typed.
        max_kg: what may be in it together, kg; None has no limit.
    """

    length: float
    width: float
    height: float
    name: str | None = None
    max_kg: float | None = None

    def __post_init__(self) -> None:
        """Refuse sizes that are not finite, not positive, or outside 1 cm to 2 m, and limits that are no mass.

        Raises:
            ContainerError: a size is outside the range, or the limit is not positive.
        """
        most = self.max_kg
        if most is not None and not (is_number(most) and 0.0 < most < np.inf):
            raise ContainerError(f"container: max_kg is {most!r:.60}, give kilograms above 0")
        for axis, value in zip(("length", "width", "height"), self.size, strict=True):
            if not is_number(value):
                raise ContainerError(f"container: {axis} is {value!r:.60}, give metres between 0.01 and 2")
            if not 0.01 <= value <= 2.0:
                raise ContainerError(
                    f"container {self.label}: {axis} is {value:g}, "
                    "give metres between 0.01 and 2, as in 0.32x0.32x0.30"
                )

    @property
    def size(self) -> tuple[float, float, float]:
        """Inner (length, width, height), m."""
        return (self.length, self.width, self.height)

    @property
    def volume(self) -> float:
        """Inner volume, m³."""
        return self.length * self.width * self.height

    @property
    def label(self) -> str:
        """The box id where there is one, else the size as the user would type it."""
        return self.name or self._size_label

    @property
    def full_label(self) -> str:
        """The size with its unit, behind the box id where there is one."""
        return f"{self._size_label} m" if self.name is None else f"{self.name} ({self._size_label} m)"

    @property
    def _size_label(self) -> str:
        return "x".join(f"{s:g}" for s in self.size)


@dataclass(frozen=True, eq=False)
class Item:
    """A thing to pack: a closed surface with mass.

    Attributes:
        name: name in the catalogue.
        vertices: (n, 3) float64, mesh frame, m.
        faces: (m, 3) int64, counter-clockwise seen from outside.
        volume: enclosed volume, m³.
        mass: kg.
        mass_estimated: True where no mass was given and the documented rule supplied it.
        com: (3,) centre of mass, mesh frame, m: what the user says, else that of uniform density.
        inertia: (3, 3) about the centre of mass of uniform density, mesh axes, kg m².
        sha256: hex digest of the mesh *as used* (vertices and faces after unit and repair).
        file: the mesh file's name inside its catalogue folder.
        repairs: what was repaired on loading, one phrase each; empty for a sound file.
        notes: what a user should know but need not mend ("2 disjoint bodies: taken as one rigid item").
        limits: what may not be done with it.
        friction: coefficient of its surface; None takes that of the options.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    volume: float
    mass: float
    mass_estimated: bool
    com: FloatArray
    inertia: FloatArray
    sha256: str
    file: str
    repairs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    limits: ItemLimits = NO_LIMITS
    friction: float | None = None

    @property
    def extents(self) -> FloatArray:
        """(3,) size of the axis-aligned bounding box in the mesh frame, m."""
        extents: FloatArray = np.ptp(self.vertices, axis=0)
        return extents

    @classmethod
    def from_trimesh(
        cls,
        mesh: trimesh.Trimesh,
        name: str,
        *,
        unit: str | None = None,
        mass: float | None = None,
        limits: ItemLimits = NO_LIMITS,
        com: Sequence[float] | None = None,
        friction: float | None = None,
    ) -> Item:
        """An item of a mesh in memory, checked and mended as a mesh file is.

        Args:
            mesh: a ``trimesh.Trimesh``, or anything else with ``vertices`` (n, 3) and ``faces`` (m, 3) and
                perhaps ``units``.
            name: name of the item.
            unit: unit of the numbers: ``m``, ``cm``, ``mm`` or ``in``; None takes what the mesh states, else
                metres.
            mass: kg; None estimates it from the volume and the hull's.
            limits: what may not be done with it.
            com: (3,) centre of mass, mesh frame, m; None is that of uniform density.
            friction: coefficient of its surface; None takes that of the options.

        Raises:
            InputError: the unit, the mesh or another value cannot be used: one line that names the item.
        """
        from packenv.geometry.meshes import item_of

        return item_of(mesh, name, unit=unit, mass=mass, limits=limits, com=com, friction=friction)

    def to_trimesh(self) -> trimesh.Trimesh:
        """The item's surface as a ``trimesh.Trimesh`` of its own, in metres, with its name and density."""
        import trimesh

        mesh = trimesh.Trimesh(self.vertices.copy(), self.faces.copy(), process=False)
        mesh.units, mesh.density = "m", self.mass / self.volume
        mesh.metadata["name"] = self.name
        return mesh


@dataclass(frozen=True, eq=False)
class StablePose:
    """A planar-stable resting orientation (Goldberg et al. 1999), yaw left free.

    Attributes:
        rotation: (3, 3) mesh frame to resting frame; the support plane is horizontal.
        probability: quasi-static probability of the whole group of near-equal poses, 0 to 1.
        com_height: height of the centre of mass above the support plane, m.
        members: number of hull facets that were grouped into this pose.
    """

    rotation: FloatArray
    probability: float
    com_height: float
    members: int = 1


@dataclass(frozen=True, eq=False)
class OrientedItem:
    """An item at one orientation with its conservative heightmaps.

    The *oriented frame* is the mesh frame rotated by ``rotation`` and shifted so that the smallest
    x, y and z of the item are 0. Cell (i, j) is the square [i, i+1] × [j, j+1] in units of the cell size, less
    ``phase``.

    Attributes:
        item: name of the item.
        pose_index: index into the item's stable poses.
        yaw: rotation about z after the stable pose, rad.
        rotation: (3, 3) mesh frame to container axes.
        offset: (3,) p_oriented = rotation @ p_mesh + offset, m.
        extents: (3,) size of the axis-aligned bounding box, m.
        com: (3,) centre of mass in the oriented frame, m.
        top: (w, h) float32, largest z of the item over each whole cell, m; 0 outside the footprint.
        bottom: (w, h) float32, smallest z over each whole cell, m; +inf outside the footprint.
        cell_size: m.
        phase: (2,) how far behind the edge of its first cell the item begins, less than a cell, m.
        whole: the same with the item at the edge of its first cell; None where it is.
    """

    item: str
    pose_index: int
    yaw: float
    rotation: FloatArray
    offset: FloatArray
    extents: FloatArray
    com: FloatArray
    top: Float32Array
    bottom: Float32Array
    cell_size: float
    phase: tuple[float, float] = (0.0, 0.0)
    whole: OrientedItem | None = None

    @property
    def footprint(self) -> BoolArray:
        """(w, h) bool, every cell that the item touches."""
        inside: BoolArray = np.isfinite(self.bottom)
        return inside

    @property
    def height(self) -> float:
        """Largest value of the top heightmap, m (rounded up to the height quantum)."""
        return float(self.top.max())


@dataclass(frozen=True, eq=False)
class RobotPath:
    """How the robot brings an item to its place: straight down, held by the vacuum cup (paper Alg. 1).

    Attributes:
        grasp: (3,) centre of the cup's lip when the item lies in its place, container frame, m.
        grasp_kind: ``centre`` of the top surface, another ``flat`` spot, or ``rough``.
        grasps_tried: how many grasps were looked at.
        cup_heights: (m,) height of the lip at each waypoint, from the top down, m: the last but one is the
            release, the last the placement.
        joints: (m, 6) joint angles at each waypoint, rad.
    """

    grasp: FloatArray
    grasp_kind: str
    grasps_tried: int
    cup_heights: FloatArray
    joints: FloatArray


@dataclass(frozen=True, eq=False)
class Placement:
    """An accepted pose of one item of the order.

    Attributes:
        item: name of the item.
        instance: 1 for the first item of this name in the order, 2 for the second, and so on.
        rotation: (3, 3) mesh frame to container frame.
        position: (3,) p_container = rotation @ p_mesh + position, m.
        corner: (3,) smallest x, y, z of the placed item in the container frame, m.
        extents: (3,) size of its bounding box, m.
        pose_index: index of the stable pose.
        yaw: rad.
        score: the heuristic's score, lower is better.
        candidates: number of legal candidates that were compared.
        route: ``first-pass`` or, from the fallback, ``later`` or ``5d`` (Alg. 4); ``layout`` where a layout had it.
        checked: candidates that were put to the constraints, this one included.
        rejections: how many of them were rejected, by reason.
        details: figures of the constraints, JSON-able, by name of the constraint.
        path: the robot's; None where no robot was asked for.
    """

    item: str
    instance: int
    rotation: FloatArray
    position: FloatArray
    corner: FloatArray
    extents: FloatArray
    pose_index: int
    yaw: float
    score: float
    candidates: int
    route: str = "first-pass"
    checked: int = 0
    rejections: dict[str, int] = field(default_factory=dict)
    details: dict[str, object] = field(default_factory=dict)
    path: RobotPath | None = None

    @property
    def pose(self) -> Pose:
        """Of the mesh frame in the container frame."""
        return Pose(self.rotation, self.position)


@dataclass(frozen=True, eq=False)
class Frame:
    """A moment, for animations.

    Attributes:
        time: s.
        joints: (6,) of the robot, rad; None where there is none.
        poses: of the mesh frame of every item that is there, in packing sequence, m.
    """

    time: float
    joints: FloatArray | None
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class Leftover:
    """An item of the order that is not in the plan.

    Attributes:
        item: name of the item.
        instance: as in :class:`Placement`.
        reason: a word for programs: ``larger-than-container``, ``no-fitting-orientation``, ``unreachable-container``,
            ``no-legal-candidate``, ``no-graspable-spot``, ``too-heavy``, ``box-overweight``,
            ``kept-apart``, ``no-usable-orientation``, ``given-up`` (another item of the order found no place) or,
            where legal candidates were rejected, ``no-packable-candidate``.
        detail: one sentence for people.
        rejections: how many candidates were rejected, by reason.
    """

    item: str
    instance: int
    reason: str
    detail: str
    rejections: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class OrderLine:
    """One line of an order: ``qty`` pieces of the item ``item``.

    Attributes:
        item: name of the item.
        qty: pieces.
        limits: of the item in this order, beside those of the catalogue.
    """

    item: str
    qty: int
    limits: ItemLimits = NO_LIMITS

    def __post_init__(self) -> None:
        """Write the name as catalogues do.

        Raises:
            OrderError: it is no text.
        """
        if not isinstance(self.item, str):
            raise OrderError(f"the order has {self.item!r:.60}, give an item's name")
        object.__setattr__(self, "item", normal_name(self.item))


@dataclass(frozen=True)
class Order:
    """A list of items, in the user's sequence.

    Attributes:
        lines: item names and quantities.
        source: the file that it came from, for messages; None for an order made in code.
    """

    lines: tuple[OrderLine, ...]
    source: Path | None = None

    def __post_init__(self) -> None:
        """Check.

        Raises:
            OrderError: the lines are not lines.
        """
        for line in self.lines:
            if not isinstance(line, OrderLine):
                raise OrderError(f"the order has {line!r:.60} as a line, give Order.of('mug', 'bowl')")

    @classmethod
    def of(cls, *names: str, limits: Mapping[str, ItemLimits] | None = None) -> Order:
        """An order made in code: ``Order.of("mug", "bowl", limits={"mug": ItemLimits(fragile=True)})``.

        Args:
            names: item names in sequence, a name as often as there are pieces of it.
            limits: of items by name, beside those of the catalogue.

        Raises:
            OrderError: no name, or a name that is no text, or limits of what is not ordered.
        """
        known = {} if limits is None else limits
        for name in names:
            if not isinstance(name, str) or not name:
                raise OrderError(f"the order has {name!r:.60}, give item names: Order.of('mug', 'bowl')")
        if not names:
            raise OrderError("the order is empty, give at least one item: Order.of('mug', 'bowl')")
        for name in known:
            if name not in names:
                raise OrderError(f"limits of {name!r:.60}, which the order does not ask for")
        lines = ((name, len(list(pieces))) for name, pieces in groupby(names))
        return cls(tuple(OrderLine(name, qty, known.get(name, NO_LIMITS)) for name, qty in lines))

    @property
    def names(self) -> tuple[str, ...]:
        """Every piece's item name, quantities written out, in the user's sequence."""
        return tuple(line.item for line in self.lines for _ in range(line.qty))

    @property
    def limits(self) -> dict[str, ItemLimits]:
        """Limits by item name that the order sets beside those of the catalogue: see :func:`limits_in`."""
        return limits_in(self.lines)


def limits_in(lines: Iterable[OrderLine]) -> dict[str, ItemLimits]:
    """Limits by item name that lines of an order set: those of all lines of an item hold for all its pieces."""
    found: dict[str, ItemLimits] = {}
    for line in lines:
        if line.limits != NO_LIMITS:
            found[line.item] = found.get(line.item, NO_LIMITS).joined(line.limits)
    return found


@dataclass(frozen=True)
class MeshRecord:
    """What a plan keeps of an item, so that whoever reads it can tell whether the mesh is the same.

    Attributes:
        file: the mesh file's name inside the catalogue folder.
        sha256: as in :class:`Item`.
        volume: m³.
        mass: kg.
        mass_estimated: as in :class:`Item`.
        limits: what may not be done with the item.
        envelope_sha256: of the item's envelope, the surface that was planned with; None where that is the mesh.
        friction: as in :class:`Item`.
    """

    file: str
    sha256: str
    volume: float
    mass: float
    mass_estimated: bool
    limits: ItemLimits = NO_LIMITS
    envelope_sha256: str | None = None
    friction: float | None = None


@dataclass(frozen=True, eq=False)
class Plan:
    """Sequence, placements, and what was left over and why.

    Attributes:
        container: the box.
        placements: in packing sequence.
        leftovers: what did not fit.
        settings: the configuration that produced the plan, JSON-able.
        metrics: figures of the finished plan, JSON-able.
        catalogue: folder of the catalogue, or ``builtin``.
        unit: the unit that the user gave for the catalogue's meshes, or None.
        order: the order's lines.
        meshes: the mesh of every item of the order, by item name.
        made_by: ``planner``; ``agent``, an episode of the environment; the rule of ``auto`` whose plan it is; the
            method whose layout it is; ``search`` where items have heuristics of their own; or after a rehearsal
            how the plan was made that it chose (docs/plan-format.md).
        items: the items themselves, by name, where they were at hand when the plan was made or read; they are
            in no file.
        source: the file that it came from, for messages; None for a plan that was just made.
        lying: how many of the first placements lay in the container already, at these poses.
        made_with: the options themselves, where the plan was made in this process; they are in no file.
        density: that the user gave for items without a mass, kg/m³, or None.
        order_source: the file of the order that was planned, which no output replaces; it is in no file.
    """

    container: Container
    placements: tuple[Placement, ...]
    leftovers: tuple[Leftover, ...]
    settings: dict[str, object] = field(default_factory=dict)
    metrics: dict[str, float] = field(default_factory=dict)
    catalogue: str = "builtin"
    unit: str | None = None
    order: tuple[OrderLine, ...] = ()
    meshes: dict[str, MeshRecord] = field(default_factory=dict)
    made_by: str = "planner"
    items: Mapping[str, Item] = field(default_factory=dict, repr=False)
    source: Path | None = None
    lying: int = 0
    made_with: object = field(default=None, repr=False)
    density: float | None = None
    order_source: Path | None = None

    def __repr__(self) -> str:
        """A line for people."""
        counts = f"{len(self.placements)} placed, {len(self.leftovers)} left over"
        return f"<Plan: {counts}, {self.container.label}>"

    @property
    def label(self) -> str:
        """What messages call it."""
        return "the plan" if self.source is None else str(self.source)

    def to_scene(
        self, poses: Sequence[Pose] | None = None, items: Mapping[str, Item] | None = None
    ) -> trimesh.Scene:
        """The packed items as a trimesh scene in the container frame: z up, m; a node for each placement.

        Nodes and geometries have the items' names; ``scene.metadata`` holds the container's size.

        Args:
            poses: where the items are, in packing sequence; the planned poses where None.
            items: their meshes by name; those at hand where None.

        Raises:
            PlanError: the meshes of its items are not at hand: read the plan by ``packenv.load_plan``.
        """
        import trimesh

        scene = trimesh.Scene(metadata={"container": list(self.container.size), "units": "m"})
        if not self.placements:
            raise PlanError(f"{self.label}: places no item, so there is no scene of it")
        known = self.items if items is None else items
        places = [p.pose for p in self.placements] if poses is None else poses
        for placement, pose in zip(self.placements, places, strict=False):
            if placement.item not in known:
                raise PlanError(
                    f"the mesh of {placement.item} is not at hand, read the plan by packenv.load_plan(path)"
                )
            item = known[placement.item]
            node = placement.item if placement.instance == 1 else f"{placement.item}-{placement.instance}"
            if placement.item in scene.geometry:
                scene.graph.update(  # type: ignore[no-untyped-call]
                    node, matrix=pose.matrix, geometry=placement.item
                )
                continue
            scene.add_geometry(item.to_trimesh(), node, placement.item, transform=pose.matrix)
        return scene

    @property
    def complete(self) -> bool:
        """True where every item of the order is placed."""
        return not self.leftovers


@dataclass(frozen=True, eq=False)
class Contacts:
    """Point contacts of a pile (paper Sec. III-A).

    Bodies are numbered: 0 is the container (walls and floor), 1 to n the items in packing sequence.

    Attributes:
        points: (k, 3) container frame, m.
        normals: (k, 3) unit, pointing *into* the body ``second``: the force on it is along the normal.
        first: (k,) int64 body that pushes; the opposite force acts on it.
        second: (k,) int64 body that is pushed; never 0.
        gaps: (k,) distance between the two surfaces at the contact, m; negative where they are in each other.
        mu: (k,) coefficient of friction where surfaces have their own; None: the same at all, as whoever asks
            says. NaN: likewise, for one contact.
    """

    points: FloatArray
    normals: FloatArray
    first: IntArray
    second: IntArray
    gaps: FloatArray
    mu: FloatArray | None = None

    def __len__(self) -> int:
        """Number of contacts."""
        return len(self.points)

    def take(self, which: BoolArray | IntArray) -> Contacts:
        """Some of the contacts: (k,) bool, or indices."""
        return Contacts(
            self.points[which],
            self.normals[which],
            self.first[which],
            self.second[which],
            self.gaps[which],
            None if self.mu is None else self.mu[which],
        )
