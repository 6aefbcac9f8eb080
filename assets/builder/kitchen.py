"""Crockery, cutlery and cookware. Millimetres.

A shell's wall is a ring of wedges: round outside, planar a sector inside.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .solids import (
    Parts,
    Profile,
    arc_path,
    joined,
    lathe,
    mirrored,
    placed,
    rounded_box,
    rounded_rectangle,
    shell,
    slab,
    stroke,
    sweep,
)
from .spec import YCB, Section

KITCHEN = Section("kitchen")
POLYPROPYLENE = "polypropylene at 905 kg/m3"


def tapered_cup(
    top: float,
    height: float,
    bottom: float,
    wall: float,
    floor: float,
    sectors: int = 24,
    per_sector: int = 6,
) -> Parts:
    """A conical cup; ``top`` and ``bottom`` are outer diameters.

    The inner surface is offset by ``wall`` horizontally, measured to the middle of its flat sides,
    where the wall is thickest; so the next smaller cup fits at every yaw.
    """
    slope = (top - bottom) / 2.0 / (height - 1.0)
    to_corner = 1.0 / np.cos(np.pi / sectors)

    def outer(z: float) -> float:
        return bottom / 2.0 + slope * z

    def inner(z: float) -> float:
        return (outer(z) - wall) * to_corner

    n = sectors * per_sector
    base = lathe(
        ((outer(0.0) - 1.0, 0.0), (outer(0.5) - 0.3, 0.4), (outer(1.2), 1.2), (outer(floor), floor)), n
    )
    profile = [(outer(floor), floor), (outer(height - 1.0), height - 1.0)]
    profile += [(top / 2.0 - 0.1, height - 0.4), (top / 2.0 - 0.5, height)]
    wedges = shell([(profile, ((inner(floor), floor), (inner(height), height)))], sectors, per_sector)
    return [base, *wedges]


def nesting_cup(top: float, height: float) -> Callable[[], Parts]:
    """Recipe of one cup of the set."""
    return lambda: tapered_cup(top, height, top - 10.0, wall=2.4, floor=3.0, per_sector=7)


for _number, (_letter, _top, _height, _grams) in enumerate(
    (("a", 55, 60, 13), ("c", 65, 64, 17), ("e", 75, 68, 21), ("g", 85, 72, 28), ("i", 95, 76, 35)), start=1
):
    KITCHEN.add(
        f"nesting_cup_{_number}",
        f"{YCB}: 065-{_letter} cups, {_top} x {_height} mm, {_grams} g; taper and 2.4 mm wall typical",
        nesting_cup(float(_top), float(_height)),
        kg=_grams / 1000.0,
    )


@KITCHEN.item(
    "party_cup",
    f"typical stacking cup, 95 x 120 mm, 2.4 mm wall; mass from volume x {POLYPROPYLENE}",
    density=905.0,
)
def party_cup() -> Parts:
    """Tapered tumbler that stacks in its own kind."""
    return tapered_cup(95.0, 120.0, 62.0, wall=2.4, floor=3.0, per_sector=7)


@KITCHEN.item("bowl", f"{YCB}: 024 bowl, 159 x 53 mm, 147 g; 3 mm wall typical", kg=0.147)
def bowl() -> Parts:
    """Cereal bowl on a foot."""
    # Outer profile: a circle's arc from the foot to the rim; inner: chords 3 mm inside of it.
    low: Profile = [(37.0, 5.0), (44.0, 7.4), (51.0, 11.0), (57.0, 15.2)]
    mid: Profile = [(57.0, 15.2), (62.5, 20.4), (67.0, 26.0), (70.5, 31.6)]
    high: Profile = [(70.5, 31.6), (74.0, 38.4), (76.8, 45.2), (79.5, 52.0), (79.2, 52.7), (78.4, 53.0)]
    foot = lathe(((37.0, 0.0), (38.0, 0.6), (38.0, 5.6)), 120)
    floor = lathe(((37.0, 4.0), (37.0, 5.0), (36.0, 8.2)), 120)
    wedges = shell(
        [
            (low, ((36.0, 8.2), (54.6, 17.2))),
            (mid, ((54.6, 17.2), (67.4, 32.6))),
            (high, ((67.4, 32.6), (76.3, 53.0))),
        ],
        24,
        5,
    )
    return [foot, floor, *wedges]


@KITCHEN.item("mug", f"{YCB}: 025 mug, 80 x 82 mm without the handle, 118 g; 3.5 mm wall typical", kg=0.118)
def mug() -> Parts:
    """Straight mug with a D-shaped handle."""
    base = lathe(((37.0, 0.0), (39.2, 0.8), (40.0, 3.0), (40.0, 5.0)), 144)
    wall: Profile = [(40.0, 5.0), (40.0, 79.6), (39.7, 81.2), (38.9, 81.9), (38.2, 82.0)]
    wedges = shell([(wall, ((36.5, 5.0), (36.5, 82.0)))], 24, 6)
    loop = [
        (38.4, 66.5),
        (45.0, 67.0),
        *arc_path((50.0, 41.0), (24.0, 26.0), 80.0, -80.0, 13),
        (45.0, 15.0),
        (38.4, 15.5),
    ]
    handle = sweep([(x, 0.0, z) for x, z in loop], [(6.0, 3.6)], up=(0.0, 1.0, 0.0), caps=(False, False))
    return [base, *wedges, *handle]


@KITCHEN.item("plate", f"{YCB}: 029 plate, 258 x 24 mm, 279 g; 3 mm wall typical", kg=0.279)
def plate() -> Parts:
    """Dinner plate: a flat well and a rising rim."""
    floor = lathe(((82.0, 0.0), (84.0, 0.6), (85.0, 4.0)), 180)
    low: Profile = [(85.0, 4.0), (84.0, 0.6), (96.0, 7.6), (100.0, 10.2)]
    rim: Profile = [(100.0, 10.2), (127.6, 20.6), (128.8, 21.8), (129.0, 23.0), (128.2, 23.9)]
    wedges = shell([(low, ((84.0, 4.0), (98.6, 13.4))), (rim, ((98.6, 13.4), (127.4, 24.0)))], 36, 5)
    return [floor, *wedges]


@KITCHEN.item(
    "pitcher",
    f"{YCB}: 019 pitcher base, 108 x 235 mm without the handle, 178 g; 2.5 mm wall typical",
    kg=0.178,
)
def pitcher() -> Parts:
    """Tapered jug with a spout and a long handle."""
    base = lathe(((46.5, 0.0), (47.6, 0.6), (48.0, 2.0), (48.08, 4.0)), 144)
    wall: Profile = [(48.08, 4.0), (54.0, 233.6), (53.8, 234.6), (53.0, 235.0)]
    wedges = shell([(wall, ((45.6, 4.0), (51.4, 235.0)))], 24, 6)
    loop = [
        (51.0, 212.0),
        (66.0, 214.0),
        *arc_path((70.0, 192.0), (20.0, 21.0), 80.0, 0.0, 6),
        (88.0, 150.0),
        (81.0, 105.0),
    ]
    loop += [(72.0, 74.0), (61.0, 60.0), (48.8, 57.0)]
    handle = sweep(
        [(x, 0.0, z) for x, z in loop], [(9.0, 5.0)], up=(0, 1, 0), n=32, power=3.0, caps=(False, False)
    )
    rim = [(-48.0, 22.0, 235.0), (-52.2, 12.0, 235.0), (-67.0, 5.0, 235.0), (-68.5, 0.0, 235.0)]
    rim += [(-67.0, 5.0, 231.0), (-68.5, 0.0, 231.0), (-52.5, 0.0, 182.0), (-51.2, 10.0, 190.0)]
    half = np.array(rim)
    spout = joined(half, *mirrored([half], 1))
    return [base, *wedges, *handle, spout]


@KITCHEN.item("wine_glass", f"{YCB}: 023 wine glass, 89 x 137 mm, 133 g; 2 mm wall typical", kg=0.133)
def wine_glass() -> Parts:
    """Stemmed glass with a bulbous bowl."""
    foot = lathe(((34.0, 0.0), (34.5, 0.6), (34.5, 1.6), (10.0, 5.0), (6.0, 7.0)), 96)
    stem = lathe(((7.0, 5.5), (4.6, 14.0), (4.6, 40.0)), 48)
    cone = lathe(((4.6, 38.0), (9.0, 46.0), (16.0, 51.0), (22.0, 54.4), (21.0, 56.6)), 96)
    low: Profile = [(22.0, 54.4), (31.0, 61.0), (38.0, 69.0), (42.0, 77.0)]
    mid: Profile = [(42.0, 77.0), (44.0, 85.0), (44.5, 92.0), (44.0, 100.0)]
    high: Profile = [(44.0, 100.0), (41.5, 118.0), (38.0, 136.4), (37.4, 137.0)]
    seams = ((21.0, 56.6), (39.9, 78.0), (42.0, 100.0), (36.0, 137.0))
    bands = [(low, (seams[0], seams[1])), (mid, (seams[1], seams[2])), (high, (seams[2], seams[3]))]
    return [foot, stem, cone, *shell(bands, 24, 4)]


@KITCHEN.item(
    "teapot",
    "typical 0.75 litre stoneware teapot, 224 x 129 mm; mass from surface area x 4 mm wall x 2300 kg/m3",
    areal=9.2,
)
def teapot() -> Parts:
    """Closed teapot: the inside cannot be reached, so the body is solid."""
    body = lathe(
        [
            (36.0, 0.0),
            (40.0, 1.0),
            (52.0, 12.0),
            (60.0, 25.0),
            (64.0, 40.0),
            (64.6, 50.0),
            (62.0, 64.0),
            (55.0, 78.0),
            (45.0, 88.0),
            (34.0, 94.0),
        ],
        72,
    )
    collar = lathe(((35.0, 92.0), (35.0, 96.0)), 96)
    lid = lathe(((33.5, 95.0), (33.0, 98.0), (27.0, 104.0), (18.0, 108.5), (8.0, 111.0)), 80)
    knob = lathe(((4.0, 109.0), (8.0, 115.0), (9.5, 120.0), (8.5, 124.5), (5.0, 127.5), (2.0, 128.4)), 48)
    spout = sweep(
        [(-52, 0, 34), (-66, 0, 40), (-78, 0, 52), (-86, 0, 66), (-93, 0, 80), (-103, 0, 90)],
        [(16, 15), (14, 13), (11, 10.5), (9, 8.5), (8, 7.5), (8, 7.0)],
        up=(0, 1, 0),
        n=32,
        caps=(False, False),
    )
    loop = [
        (54.0, 78.0),
        (70.0, 86.0),
        *arc_path((82.0, 56.0), (27.0, 31.0), 85.0, -70.0, 11),
        (76.0, 25.0),
        (58.0, 26.0),
    ]
    handle = sweep([(x, 0.0, z) for x, z in loop], [(7.0, 4.5)], up=(0, 1, 0), n=24, caps=(False, False))
    return [body, collar, lid, knob, *spout, *handle]


@KITCHEN.item(
    "funnel",
    f"typical kitchen funnel, 120 x 135 mm, 2 mm wall; mass from volume x {POLYPROPYLENE}",
    density=905.0,
)
def funnel() -> Parts:
    """Cone, spout and hanging tab, standing on its wide end."""
    spout: Profile = [(11.0, 70.0), (7.0, 135.0)]
    rim: Profile = [(60.0, 0.0), (60.0, 5.0), (58.3, 6.0)]
    cone: Profile = [(58.3, 6.0), (11.0, 70.0)]
    bands = [
        (rim, ((57.4, 0.0), (55.8, 6.0))),
        (cone, ((55.8, 6.0), (8.6, 70.0))),
        (spout, ((8.6, 70.0), (5.0, 135.0))),
    ]
    tab = slab(
        [(57.9, 11), (59.4, 11.0), (72, 7), (76, 0), (72, -7), (59.4, -11.0), (57.9, -11), (57.9, 0)],
        0.3,
        3.3,
        0.5,
    )
    return [*shell(bands, 24, 8), tab]


@KITCHEN.item(
    "skillet",
    "typical 6.5 inch cast-iron skillet, 165 x 271 mm; mass from volume x grey cast iron at 7200 kg/m3",
    density=7200.0,
)
def skillet() -> Parts:
    """Small cast-iron pan with its handle."""
    floor = lathe(((66.0, 0.0), (68.0, 1.0), (70.0, 4.5)), 144)
    wall: Profile = [(70.0, 4.5), (81.6, 36.5), (82.5, 38.0), (82.2, 39.6), (81.0, 40.0)]
    wedges = shell([(wall, ((66.0, 4.5), (78.0, 40.0)))], 24, 6)
    handle = sweep(
        [(78.6, 0, 33.0), (95, 0, 34.5), (120, 0, 36), (150, 0, 37), (168, 0, 37.5)],
        [(15.0, 4.0), (9.0, 4.2), (9.0, 4.4), (12.0, 4.4), (13.0, 4.0)],
        n=32,
        power=3.0,
        caps=(False, False),
    )
    # The hole for hanging: short bars around it instead of a cut.
    eye = stroke(
        [(x, y, 4.5) for x, y in arc_path((176.0, 0.0), (8.5, 9.0), 0.0, 360.0, 13)], 33.5, 41.5, 1.2, 24
    )
    return [floor, *wedges, *handle, *eye]


@KITCHEN.item(
    "pot_lid",
    "typical 200 mm glass lid with a knob; mass from volume x soda-lime glass at 2500 kg/m3",
    density=2500.0,
)
def pot_lid() -> Parts:
    """Shallow dome with a rim and a knob."""
    rim: Profile = [(99.4, 0.0), (100.0, 0.6), (100.0, 3.4), (99.0, 4.6)]
    low: Profile = [(99.0, 4.6), (88.0, 12.0), (74.0, 19.0), (60.0, 23.8)]
    high: Profile = [(60.0, 23.8), (44.0, 27.4), (28.0, 29.6), (14.0, 30.6)]
    bands = [
        (rim, ((95.5, 0.0), (95.5, 3.0))),
        (low, ((95.5, 3.0), (58.0, 20.6))),
        (high, ((58.0, 20.6), (14.0, 27.0))),
    ]
    middle = lathe(((14.0, 27.0), (14.0, 30.6), (6.0, 31.0)), 96)
    post = lathe(((8.0, 29.0), (7.0, 40.0)), 64)
    knob = lathe(
        ((9.0, 38.0), (16.0, 42.0), (19.0, 47.0), (19.5, 50.0), (18.0, 53.0), (14.0, 55.0), (6.0, 56.0)), 96
    )
    return [*shell(bands, 24, 4), middle, post, knob]


@KITCHEN.item("fork", f"{YCB}: 030 fork, 14 x 20 x 198 mm, 34 g", kg=0.034)
def fork() -> Parts:
    """Table fork with four tines."""
    stem = sweep(
        [
            (0, 0, 3.0),
            (20, 0, 2.6),
            (50, 0, 3.6),
            (85, 0, 6.5),
            (110, 0, 9.5),
            (128, 0, 11.6),
            (140, 0, 11.2),
        ],
        [(8.6, 1.6), (8.4, 1.6), (6.4, 1.6), (4.4, 1.8), (3.4, 1.9), (3.4, 1.8), (6.0, 1.4)],
        n=32,
    )
    palm = sweep(
        [(139, 0, 11.3), (148, 0, 8.2), (157, 0, 5.6)],
        [(5.6, 1.4), (9.8, 1.2), (10.0, 1.2)],
        n=32,
        power=3.0,
        caps=(False, False),
    )
    tines = []
    for y in (-8.4, -2.8, 2.8, 8.4):
        line = [(155, y, 6.2), (165, y, 4.1), (176, y, 3.2), (187, y, 3.8), (197.4, y, 6.2)]
        tines += sweep(line, [(1.6, 1.2), (1.5, 1.2), (1.4, 1.2), (1.3, 1.1), (0.9, 0.8)], n=16)
    return [*stem, *palm, *tines]


@KITCHEN.item("spoon", f"{YCB}: 031 spoon, 14 x 195 mm, 30 g; 40 mm wide as a table spoon is", kg=0.030)
def spoon() -> Parts:
    """Table spoon with a hollow bowl."""
    stem = sweep(
        [
            (0, 0, 5.0),
            (20, 0, 4.6),
            (50, 0, 5.6),
            (85, 0, 9.0),
            (110, 0, 11.6),
            (126, 0, 11.6),
            (138, 0, 9.2),
        ],
        [(8.6, 1.6), (8.4, 1.6), (6.4, 1.6), (4.4, 1.8), (3.4, 1.9), (3.6, 1.8), (5.0, 1.3)],
        n=32,
    )
    # A dish of revolution, stretched along x into the oval of the bowl.
    floor = lathe(((9.0, 0.0), (9.6, 1.6)), 96)
    low: Profile = [(9.6, 1.6), (9.0, 0.0), (13.4, 2.4), (15.6, 4.0)]
    high: Profile = [(15.6, 4.0), (18.4, 7.0), (20.0, 9.6), (19.7, 9.9)]
    dish = [floor, *shell([(low, ((9.0, 1.6), (14.4, 5.2))), (high, ((14.4, 5.2), (18.6, 9.9)))], 16, 6)]
    return [*stem, *placed(dish, at=(165.0, 0.0, 0.0), scale=(1.5, 1.0, 1.0))]


@KITCHEN.item("table_knife", f"{YCB}: 032 knife, 14 x 20 x 215 mm, 31 g", kg=0.031)
def table_knife() -> Parts:
    """Rounded blade on a thick handle."""
    grip = sweep(
        [(0, 0, 7), (12, 0, 7), (50, 0, 7), (85, 0, 7), (100, 0, 7)],
        [(8.5, 5.0), (9.5, 6.8), (8.5, 6.0), (7.0, 4.4), (6.0, 3.0)],
        n=84,
    )
    edge = [
        (98.0, -5.5),
        (140.0, -9.0),
        (170.0, -9.6),
        *arc_path((198.0, 0.0), (16.0, 9.6), -90.0, 90.0, 25),
        (98.0, 7.0),
    ]
    return [*grip, slab(edge, 6.0, 8.0, 0.7)]


@KITCHEN.item(
    "spatula", "typical slotted turner, 303 x 82 mm; mass from volume x nylon at 1140 kg/m3", density=1140.0
)
def spatula() -> Parts:
    """Slotted blade, bent neck, long handle."""
    handle = sweep(
        [(0, 0, 32), (40, 0, 34), (90, 0, 34), (120, 0, 33)],
        [(10, 6), (11, 7), (10, 6), (7, 5)],
        n=64,
        power=2.5,
    )
    neck = sweep(
        [(118, 0, 33), (160, 0, 31), (185, 0, 22), (205, 0, 8), (216, 0, 3.0)],
        [(6, 4.5), (5.5, 4.0), (6.5, 3.4), (10, 2.2), (14, 1.6)],
        n=64,
        caps=(False, False),
    )
    bars = []
    for y in np.linspace(-35.0, 35.0, 5):
        inner = 33.0 / 35.0 * float(y)
        bars += stroke([(216.0, inner, 4.6), (284.0, float(y), 4.9)], 0.0, 2.6, 0.6, 24)
    back = stroke([(212.0, -33.0, 6.0), (212.0, 33.0, 6.0)], 0.0, 2.6, 0.6)
    front = slab([(282, -41), (282, 41), (298, 39), (300, 37), (300, -37), (298, -39)], 0.0, 2.6, 0.6)
    return [*handle, *neck, *bars, *back, front]


@KITCHEN.item(
    "storage_tray",
    f"typical drawer tray, 240 x 160 x 55 mm, 2.5 mm wall; mass from volume x {POLYPROPYLENE}",
    density=905.0,
)
def storage_tray() -> Parts:
    """Open rectangular tray with rounded corners, drafted walls and a rim."""

    def rectangle(width: float, depth: float, radius: float, z: float) -> np.ndarray:
        return rounded_rectangle(width, depth, radius, z, 36)

    floor = joined(
        rectangle(217, 137, 13.5, 0.0), rectangle(220, 140, 15.0, 1.5), rectangle(220.2, 140.2, 15.0, 2.5)
    )
    layers = [(220.2, 140.2, 15.0, 2.5), (235.4, 155.4, 17.0, 50.8)]
    rim = [
        (235.4, 155.4, 17.0, 50.8),
        (240.0, 160.0, 19.0, 51.6),
        (240.0, 160.0, 19.0, 54.0),
        (238.8, 158.8, 18.4, 55.0),
    ]
    inner = {2.5: (215.2, 135.2, 12.5), 50.8: (230.4, 150.4, 14.5), 55.0: (231.6, 151.6, 14.7)}
    parts = [floor]
    for band, bottom, top in ((layers, 2.5, 50.8), (rim, 50.8, 55.0)):
        for k in range(4):
            corner = slice(37 * k, 37 * k + 37)
            outside = [rectangle(*size)[corner] for size in band]
            for lo, hi in ((0, 12), (12, 24), (24, 36)):
                inside = [rectangle(*inner[z], z)[corner][[lo, hi]] for z in (bottom, top)]
                parts.append(joined(*(layer[lo : hi + 1] for layer in outside), *inside))
            this, following = 37 * k + 36, (37 * k + 37) % 148
            inside = [rectangle(*inner[z], z)[[this, following]] for z in (bottom, top)]
            parts.append(joined(*(rectangle(*size)[[this, following]] for size in band), *inside))
    return parts


@KITCHEN.item(
    "dish_brush", "typical dish brush, 248 mm; mass from volume x beech at 720 kg/m3", density=720.0
)
def dish_brush() -> Parts:
    """Round head with a cone of bristles, slender handle."""
    head = placed(
        lathe(((22.0, 0.0), (25.0, 2.0), (26.0, 6.0), (25.0, 10.0), (20.0, 13.0)), 72), at=(215, 0, 26)
    )
    bristles = placed(lathe(((28.0, 0.0), (29.5, 3.0), (22.5, 27.0)), 72), at=(215, 0, 0))
    handle = sweep(
        [(0, 0, 48), (30, 0, 50), (70, 0, 50), (110, 0, 47), (150, 0, 42), (180, 0, 36), (200, 0, 33)],
        [(9, 7), (10, 8), (9.5, 7), (8, 6), (7, 5.5), (8, 5), (10, 4.5)],
        n=40,
    )
    eye = rounded_box((6.0, 18.0, 13.0), 2.0, (1.0, 0.0, 48.0))
    return [*head, *bristles, *handle, eye]
