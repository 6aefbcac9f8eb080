"""Balls and toys. Millimetres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .solids import Parts, box, geodesic, lathe, placed, rounded_box, shell, slab, sweep
from .spec import YCB, Section
from .tools import along_x

TOYS = Section("toy")


def ball(diameter: float) -> Callable[[], Parts]:
    """Recipe of a sphere."""
    return lambda: [geodesic(diameter / 2.0)]


for _name, _diameter, _kg, _source in (
    (
        "tennis_ball",
        67.0,
        0.0577,
        "67 mm and 57.7 g, the middles of the ITF rules of tennis (65.4-68.6 mm, 56.0-59.4 g)",
    ),
    ("golf_ball", 42.7, 0.0459, "42.7 mm, R&A and USGA rules of golf: at least 42.67 mm, at most 45.93 g"),
    (
        "baseball",
        73.8,
        0.145,
        "73.8 mm and 145 g, the middles of Official Baseball Rules 3.01 (9-9.25 in around, 5-5.25 oz)",
    ),
    ("softball", 96.0, 0.191, f"{YCB}: 054 softball, 96 mm, 191 g"),
    ("mini_soccer_ball", 140.0, 0.123, f"{YCB}: 053 mini soccer ball, 140 mm, 123 g"),
):
    TOYS.add(_name, _source, ball(_diameter), kg=_kg)


@TOYS.item(
    "toy_airplane",
    "typical wooden toy airplane, 209 x 218 mm; mass from volume x beech at 720 kg/m3",
    density=720.0,
)
def toy_airplane() -> Parts:
    """Low-winged propeller plane on two wheels."""
    z = 44.0
    fuselage = sweep(
        [(0, 0, z), (14, 0, z), (45, 0, z), (90, 0, z + 1), (140, 0, z + 5), (185, 0, z + 9)],
        [(14, 14), (18, 18), (20, 20), (19, 19), (13, 13), (7, 8)],
        n=44,
        power=2.4,
    )
    cabin = sweep(
        [(52, 0, z + 15), (66, 0, z + 24), (84, 0, z + 24), (104, 0, z + 15)],
        [(9, 6), (12, 8), (12, 8), (8, 5)],
        n=40,
    )
    wing_outline = [(38, 0), (40, 80), (44, 100), (54, 109), (66, 109), (76, 100), (82, 80), (90, 0)]
    wing = slab([*wing_outline, *((x, -y) for x, y in reversed(wing_outline[1:-1]))], 28.0, 35.0, 2.0)
    tail_outline = [(160, 0), (163, 30), (168, 38), (176, 40), (186, 38), (190, 28), (190, 0)]
    tail = slab([*tail_outline, *((x, -y) for x, y in reversed(tail_outline[1:-1]))], z + 7, z + 12, 1.5)
    fin = placed(
        slab([(158, 50), (178, 82), (186, 86), (194, 82), (192, 50)], -2.5, 2.5, 1.2), turn=(("x", 90.0),)
    )
    spinner = along_x([(4.0, -15.0), (8.0, -12.0), (10.5, -6.0), (11.0, 1.0)], 48, (0, 0, z))
    blades = [rounded_box((4.0, 86.0, 12.0), 1.9, (-8.0, 0.0, z))]
    wheels = []
    for y in (-24.0, 24.0):
        wheels += placed(
            lathe(((11.0, 0.0), (14.0, 1.6), (14.0, 7.4), (11.0, 9.0)), 48),
            at=(46, y - 4.5 * 1, 14),
            turn=(("x", -90.0),),
        )
        wheels += sweep([(46, y, 14), (48, y * 0.7, 34)], 3.0, up=(1, 0, 0), n=16)
    axle = placed(lathe(((2.6, -29.0), (2.6, 29.0)), 24), at=(46, 0, 14), turn=(("x", -90.0),))
    skid = sweep([(176, 0, z + 3), (188, 0, z - 6)], 3.0, up=(0, 1, 0), n=16)
    return [*fuselage, *cabin, wing, tail, *fin, *spinner, *blades, *wheels, *axle, *skid]


def toy_brick(columns: int, rows: int) -> Parts:
    """Large toy brick, twice the 8 mm system: pitch 16, height 19.2, hollow from below."""
    wide, deep, high = 16.0 * columns - 0.2, 16.0 * rows - 0.2, 19.2
    wall = 1.9
    top = box((wide, deep, 2.4), 0.3, (0, 0, high - 1.2))
    sides = [box((wide, wall, high), 0.3, (0, s * (deep - wall) / 2, high / 2)) for s in (-1, 1)]
    sides += [box((wall, deep, high), 0.3, (s * (wide - wall) / 2, 0, high / 2)) for s in (-1, 1)]
    stud = lathe(((4.68, 18.0), (4.68, 23.1), (4.5, 23.5), (4.2, 23.6)), 56)
    studs = [
        part
        for i in range(columns)
        for j in range(rows)
        for part in placed(stud, at=(16.0 * (i - (columns - 1) / 2), 16.0 * (j - (rows - 1) / 2), 0))
    ]
    tubes = []
    for i in range(columns - 1):
        pipe = shell([([(6.6, 0.0), (6.6, 18.0)], ((5.1, 0.0), (5.1, 18.0)))], 8, 5)
        tubes += placed(pipe, at=(16.0 * (i - (columns - 2) / 2), 0, 0))
    return [top, *sides, *studs, *tubes]


_BRICK = (
    "typical large toy brick on a 16 mm grid, twice the small system; mass from volume x ABS at 1050 kg/m3"
)


@TOYS.item("toy_brick_2x4", _BRICK, density=1050.0)
def toy_brick_2x4() -> Parts:
    """Brick with eight studs."""
    return toy_brick(4, 2)


@TOYS.item("toy_brick_2x2", _BRICK, density=1050.0)
def toy_brick_2x2() -> Parts:
    """Brick with four studs."""
    return toy_brick(2, 2)


@TOYS.item(
    "toy_car", "typical wooden toy car, 132 x 69 mm; mass from volume x beech at 720 kg/m3", density=720.0
)
def toy_car() -> Parts:
    """Car with a cabin, four wheels and bumpers."""
    chassis = rounded_box((124, 46, 22), 6.0, (0, 0, 24))
    bonnet = sweep(
        [(-58, 0, 30), (-30, 0, 32), (40, 0, 32), (58, 0, 30)],
        [(20, 6), (21.5, 8), (21.5, 8), (20, 6)],
        n=48,
        power=4.0,
    )
    cabin_outline = [(-30, 32), (-14, 62), (-8, 65), (24, 65), (30, 62), (44, 32)]
    cabin = placed(slab(cabin_outline, -20, 20, 4.0), turn=(("x", 90.0),))
    bumpers = [rounded_box((8, 50, 8), 3.0, (x, 0, 20)) for x in (-62, 62)]
    wheels = []
    for x in (-37.0, 37.0):
        for y in (-33.0, 21.0):
            tyre = lathe(((14.0, 0.0), (16.4, 1.0), (17.0, 2.6), (17.0, 9.4), (16.4, 11.0), (14.0, 12.0)), 40)
            wheels += placed(tyre, at=(x, y, 17), turn=(("x", -90.0),))
        wheels += placed(
            lathe(((3.6, -34.4), (4.2, -33.8), (4.2, 33.8), (3.6, 34.4)), 32),
            at=(x, 0, 17),
            turn=(("x", -90.0),),
        )
    return [chassis, *bonnet, *cabin, *bumpers, *wheels]


@TOYS.item(
    "rubber_duck",
    "typical bath duck, 117 x 80 x 92 mm; mass from surface area x 2 mm wall x 1200 kg/m3",
    areal=2.4,
)
def rubber_duck() -> Parts:
    """Bath duck: body, tail, wings, head and beak."""
    body = placed(geodesic(1.0, 10), at=(0, 0, 30), scale=(46, 36, 34))
    flat = body[0]
    body = [flat[flat[:, 2] > 3.0]]
    tail = sweep(
        [(-30, 0, 40), (-42, 0, 50), (-52, 0, 62)], [(20, 12), (14, 7), (5, 2.5)], up=(0, 0, 1), n=32
    )
    head = placed(geodesic(26.5, 8), at=(24, 0, 69))
    beak = sweep(
        [(46, 0, 65), (56, 0, 64), (62, 0, 65)], [(11, 5.5), (11, 3.6), (8, 2.2)], up=(0, 0, 1), n=32
    )
    wings = []
    for side in (-1, 1):
        wing = placed(geodesic(1.0, 5), scale=(26, 8, 15), turn=(("y", 14.0),), at=(-8, side * 32, 36))
        wings += wing
    eyes = [part for side in (-1, 1) for part in placed(geodesic(3.6, 3), at=(43.5, side * 13.0, 77))]
    return [*body, *tail, *head, *beak, *wings, *eyes]


@TOYS.item("puzzle_cube", f"{YCB}: 077 Rubik's cube, 57 x 57 x 57 mm, 94 g", kg=0.094)
def puzzle_cube() -> Parts:
    """Cube of 26 small cubes around a core."""
    core = box((54.0, 54.0, 54.0), 0.5, (0, 0, 0))
    places = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)]
    return [core, *(box((18.6, 18.6, 18.6), 1.0, 19.2 * np.array(place)) for place in places)]
