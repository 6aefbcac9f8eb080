"""Random packings whose right answer is known in closed form, each kind a stream of instances.

The answers are of three sorts. What fits is shown by an arrangement that a person sees: a row, layers, a stack. That
no more fits is shown by volume, by a stack's pitch in a container too narrow for two, or by a closed form for one
item: a rectangle p × q goes into P × Q (p > P, q <= Q) at some angle where
((P + Q) / (p + q))² + ((P - Q) / (p - q))² >= 2 (Carver 1957). Instances without such a proof are drawn again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.shells import Shell, block, bowl, cup, plate, polygon, prism, rectangle, sleeve
from packenv.types import Container, Item

MM = 1e-3


@dataclass(frozen=True, eq=False)
class Instance:
    """An order, a container, and how many items fit.

    Attributes:
        kind: what is known of it, a word.
        container: the box.
        items: by name.
        order: names, at least one more than fit where more of them would not fit.
        fits: how many of the order fit at most.
    """

    kind: str
    container: Container
    items: Mapping[str, Item]
    order: tuple[str, ...]
    fits: int

    @property
    def label(self) -> str:
        """One line for people: items with their sizes in mm, and the container."""
        shapes = ", ".join(
            f"{self.order.count(name)} {name} " + " x ".join(f"{1e3 * s:.5g}" for s in item.extents)
            for name, item in self.items.items()
        )
        return f"{self.kind}: {shapes} in " + " x ".join(f"{1e3 * s:.6g}" for s in self.container.size)


def rows(rng: np.random.Generator) -> Iterator[Instance]:
    """Boxes of length l in a row along x, along y, or on one another, to 0.1 mm: floor(L / l) fit.

    A third of the containers is a whole number of lengths long, a third one that falls short of that by 0.1 mm.
    """
    while True:
        axis = int(rng.integers(3))
        size = rng.integers((150, 200, 200), (1200, 1000, 1000)) * 0.1 * MM
        whole = int(rng.integers(1, 11))
        tenths = round(size[0] * 1e4)
        extra = (0, -1, int(rng.integers(tenths)))[int(rng.integers(3))]
        room = (whole * tenths + extra) // tenths
        length = (whole * tenths + extra) * 0.1 * MM
        across = [s + float(rng.choice([0.0, rng.uniform(0.0, 0.1) * s])) for s in size[1:]]
        inner = np.insert(across, axis, length)
        instance = _boxes("xyz"[axis], np.insert(size[1:], axis, size[0]), inner, room)
        if instance is not None and room > 0:
            yield instance


def cubes(rng: np.random.Generator) -> Iterator[Instance]:
    """Cubes, and other boxes, that fill a container in all three axes, to the last bit or with room: all fit."""
    while True:
        cube = bool(rng.integers(2))
        counts = np.full(3, rng.integers(2, 4)) if cube else rng.integers(1, 5, 3)
        size = np.full(3, rng.integers(400, 1500)) if cube else rng.integers(250, 1500, 3)
        exact = size * (0.1 * MM) * counts
        inner = exact if rng.integers(2) else exact + rng.uniform(0.0, 0.3, 3) * size * (0.1 * MM)
        fits = int(np.prod(counts))
        instance = _boxes("cube" if cube else "box", size * (0.1 * MM), inner, fits)
        if instance is not None and 2 <= fits <= 36:
            yield instance


def _boxes(kind: str, size: np.ndarray, inner: Sequence[float], fits: int) -> Instance | None:
    """Equal boxes, of which more than fit are ordered; None where volume does not tell that no more fit."""
    most = int(np.prod(inner) / np.prod(size) * (1.0 + 1e-9))
    if most > fits or max(inner) > 2.0:
        return None
    order = ("box",) * (fits + 1)
    return Instance(kind, Container(*map(float, inner)), {"box": block(*size, "box")}, order, fits)


def nested(rng: np.random.Generator) -> Iterator[Instance]:
    """Stacks of cups, bowls, trays and plates; cups in cups; a core in a sleeve."""
    kinds: list[Callable[[np.random.Generator], Instance]] = [
        *(lambda rng, kind=kind: _stack(kind, rng) for kind in SHELLS),
        _cups_in_cups,
        _core_in_sleeve,
    ]
    while True:
        for k in rng.permutation(len(kinds)):
            yield kinds[k](rng)


def _cup(rng: np.random.Generator) -> Shell:
    return cup(
        foot=rng.uniform(18, 35) * MM,
        height=rng.uniform(60, 120) * MM,
        half_angle=math.radians(rng.uniform(4, 14)),
        wall=rng.uniform(0.6, 2.0) * MM,
        floor=rng.uniform(0.8, 4.0) * MM,
    )


def _bowl(rng: np.random.Generator) -> Shell:
    return bowl(rng.uniform(50, 100) * MM, rng.uniform(1.5, 4.0) * MM, math.radians(rng.uniform(55, 80)))


def _tray(rng: np.random.Generator) -> Shell:
    ring = rectangle(rng.uniform(80, 180) * MM, rng.uniform(80, 180) * MM)
    height, angle = rng.uniform(20, 50) * MM, math.radians(rng.uniform(6, 20))
    return cup(0.02, height, angle, rng.uniform(1.0, 2.5) * MM, rng.uniform(1.0, 3.0) * MM, ring)


def _plate(rng: np.random.Generator) -> Shell:
    foot, height = rng.uniform(40, 70) * MM, rng.uniform(12, 25) * MM
    return plate(foot, foot + rng.uniform(25, 50) * MM, height, rng.uniform(2.0, 5.0) * MM)


SHELLS: Mapping[str, Callable[[np.random.Generator], Shell]] = {
    "cup": _cup,
    "bowl": _bowl,
    "tray": _tray,
    "plate": _plate,
}
"""What nests, drawn at random."""


def _stack(kind: str, rng: np.random.Generator, across: tuple[int, int] = (1, 1)) -> Instance:
    """Nested vessels in a container with room for so many stacks side by side, and the height of so many items.

    The height is that of a whole stack to the last bit, or up to nine tenths of the pitch more.
    """
    shell = SHELLS[kind](rng)
    item = shell.item(kind)
    most = max(1, min(7, int((1.4 * min(item.extents[:2]) - shell.height) / shell.pitch)))
    tall = int(rng.integers(min(2, most), most + 1))
    height = shell.height + (tall - 1 + float(rng.choice([0.0, rng.uniform(0.0, 0.9)]))) * shell.pitch
    slack = float(rng.choice([0.0, rng.uniform(0.0, 4.0)])) * MM
    floor = item.extents[:2] * across + slack
    fits = tall * across[0] * across[1]
    order = (kind,) * (fits + (1 if across == (1, 1) else 3))
    return Instance(kind, Container(*map(float, floor), height), {kind: item}, order, fits)


def _cups_in_cups(rng: np.random.Generator) -> Instance:
    """Cups of falling sizes, each inside the one before with as little as 0.3 mm between their walls."""
    angle, wall, base = math.radians(rng.uniform(3, 8)), rng.uniform(0.8, 1.5) * MM, rng.uniform(1, 2) * MM
    foot, height = rng.uniform(40, 55) * MM, rng.uniform(80, 110) * MM
    shells = []
    for _ in range(int(rng.integers(2, 6))):
        shells.append(cup(foot, height, angle, wall, base))
        foot -= wall / math.cos(angle) + rng.uniform(0.3, 3.0) * MM
        height -= base + rng.uniform(0.0, 5.0) * MM
    items = {f"cup_{k}": shell.item(f"cup_{k}") for k, shell in enumerate(shells, 1)}
    order = tuple(str(name) for name in rng.permutation(list(items)))
    return Instance("cups in cups", Container(*items["cup_1"].extents), items, order, len(items))


def _core_in_sleeve(rng: np.random.Generator) -> Instance:
    """A core in the bore of a sleeve that fills the container's floor, with 0.3 mm of play or more."""
    size, bore = rng.uniform(50, 120) * MM, rng.uniform(0.5, 0.9)
    bore, height, is_round = bore * size, rng.uniform(30, 90) * MM, bool(rng.integers(2))
    width = bore - rng.uniform(0.3, 5.0) * MM
    cross = polygon(0.5 * width) if is_round else rectangle(width, width)(0.0)
    tall = height * rng.uniform(0.4, 1.1)
    items = {
        "sleeve": sleeve(size, bore, height, "sleeve", round_bore=is_round),
        "core": prism(cross, tall, "core"),
    }
    container = Container(size, size, max(height, tall))
    return Instance(f"core in a {'round' if is_round else 'square'} bore", container, items, tuple(items), 2)


def angles(rng: np.random.Generator) -> Iterator[Instance]:
    """Bars that go in at an angle alone: lying across, leaning in a narrow container, or from corner to corner.

    A few do not go in at all.
    """
    while True:
        for kind in rng.permutation(["across", "leaning", "corner to corner"]):
            yield _corners(rng) if kind == "corner to corner" else _tilted(str(kind), rng)


def _tilted(kind: str, rng: np.random.Generator) -> Instance:
    """A rectangle in a rectangle, the third side of both the same."""
    while True:
        small, large = np.sort(rng.uniform(0.08, 0.4, 2))
        long_, thin = large * rng.uniform(1.001, 1.25), rng.uniform(0.011, 0.6 * small)
        room = ((large + small) / (long_ + thin)) ** 2 + ((large - small) / (long_ - thin)) ** 2 - 2.0
        # a thousandth: some 0.05 mm, more than what counts as touching
        if abs(room) > 1e-3 and (room > 0.0 or rng.uniform() < 0.3):
            break
    sides = [large, small] if rng.integers(2) else [small, large]
    if kind == "across":
        # no thicker than it is wide, else it could lie on its side
        third = float(rng.uniform(0.01, thin))
        size, inner = (long_, thin, third), (*sides, third)
    else:
        size, inner = (long_, thin, thin), (sides[0], thin, sides[1])
        inner = inner if rng.integers(2) else (inner[1], inner[0], inner[2])
    return _single(kind, size, inner, fits=int(room > 0.0))


def _corners(rng: np.random.Generator) -> Instance:
    """A bar in the box about it at some yaw and lean, or one longer than the diagonal of its container."""
    while True:
        size = np.array([rng.uniform(0.2, 0.5), *[rng.uniform(0.008, 0.03)] * 2])
        yaw, lean = math.radians(rng.uniform(20, 70)), math.radians(rng.uniform(15, 60))
        turned = np.array(
            [
                [math.cos(yaw) * math.cos(lean), -math.sin(yaw), math.cos(yaw) * math.sin(lean)],
                [math.sin(yaw) * math.cos(lean), math.cos(yaw), math.sin(yaw) * math.sin(lean)],
                [-math.sin(lean), 0.0, math.cos(lean)],
            ]
        )
        inner = np.abs(turned) @ size + rng.uniform(0.0, 5.0) * MM
        if rng.uniform() < 0.2:
            size[0] = 1.002 * float(np.linalg.norm(inner))
            return _single("corner to corner", size, inner, fits=0)
        if size[0] > max(inner):
            return _single("corner to corner", size, inner, fits=1)


def _single(kind: str, size: Sequence[float], inner: Sequence[float], *, fits: int) -> Instance:
    return Instance(kind, Container(*map(float, inner)), {"bar": block(*size, "bar")}, ("bar",), fits)


def filled(rng: np.random.Generator) -> Iterator[Instance]:
    """Containers to be filled until three items in a row find no place: boxes, and stacks of vessels side by side."""
    boxes = cubes(rng)
    while True:
        found = next(boxes)
        yield Instance(found.kind, found.container, found.items, (*found.order, *found.order[:2]), found.fits)
        across = (int(rng.integers(1, 4)), int(rng.integers(1, 3)))
        yield _stack(str(rng.choice(list(SHELLS))), rng, across)


KINDS: dict[str, Callable[[np.random.Generator], Iterator[Instance]]] = {
    "rows": rows,
    "cubes": cubes,
    "nested": nested,
    "angles": angles,
    "filled": filled,
}
"""Every kind of instance."""
