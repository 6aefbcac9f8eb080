"""Cans, cartons, bottles and fruit. Millimetres."""

from __future__ import annotations

import numpy as np

from .solids import (
    Parts,
    Points,
    box,
    geodesic,
    joined,
    lathe,
    orange_slices,
    oval,
    placed,
    rounded_rectangle,
    slab,
    sweep,
)
from .spec import YCB, Section

PACKAGES = Section("package")
FRUIT = Section("fruit")


def can(diameter: float, height: float, bead: float = 3.0, n: int = 88) -> Parts:
    """A food can: a body with a rolled bead at either end."""
    r = diameter / 2.0
    profile = (
        (r - 0.9, 0.0),
        (r - 0.25, 0.3),
        (r, 0.9),
        (r, bead - 0.9),
        (r - 0.25, bead - 0.3),
        (r - 0.9, bead),
    )
    low = lathe(profile, n)
    high = lathe([(radius, height - z) for radius, z in profile], n)
    return [lathe(((r - 0.9, 0.5), (r - 0.9, height - 0.5)), n), low, high]


@PACKAGES.item("chips_can", f"{YCB}: 001 chips can, 75 x 250 mm, 205 g", kg=0.205)
def chips_can() -> Parts:
    """Paper tube with a metal foot and an overhanging plastic lid."""
    tube = lathe(((36.4, 1.0), (36.4, 240.0)), 96)
    foot = lathe(((36.6, 0.0), (37.2, 0.4), (37.2, 3.6), (36.6, 4.0)), 96)
    lid = lathe(((36.9, 238.0), (37.5, 238.5), (37.5, 247.5), (37.1, 249.2), (36.0, 250.0)), 96)
    return [tube, foot, lid]


@PACKAGES.item("coffee_can", f"{YCB}: 002 master chef can, 102 x 139 mm, 414 g", kg=0.414)
def coffee_can() -> Parts:
    """Wide can with a plastic lid."""
    body = can(100.6, 134.0)
    lid = lathe(((50.4, 126.0), (51.0, 126.5), (51.0, 137.2), (50.6, 138.5), (49.4, 139.0)), 96)
    return [*body, lid]


@PACKAGES.item("soup_can", f"{YCB}: 005 tomato soup can, 66 x 101 mm, 349 g", kg=0.349)
def soup_can() -> Parts:
    """Can with two beads."""
    return can(66.0, 101.0)


@PACKAGES.item("tuna_can", f"{YCB}: 007 tuna fish can, 85 x 33 mm, 171 g", kg=0.171)
def tuna_can() -> Parts:
    """Flat can with two beads."""
    return can(85.0, 33.0)


@PACKAGES.item("potted_meat_can", f"{YCB}: 010 potted meat can, 50 x 97 x 82 mm, 370 g", kg=0.370)
def potted_meat_can() -> Parts:
    """Rounded rectangular can with two beads."""

    def layer(inset: float, z: float) -> Points:
        return rounded_rectangle(97.0 - 2 * inset, 50.0 - 2 * inset, 18.0 - inset, z, 28)

    bead = ((0.9, 0.0), (0.0, 0.9), (0.0, 2.1), (0.9, 3.0))
    return [
        joined(layer(1.0, 0.5), layer(1.0, 81.5)),
        joined(*(layer(i, z) for i, z in bead)),
        joined(*(layer(i, 82.0 - z) for i, z in bead)),
    ]


@PACKAGES.item("cracker_box", f"{YCB}: 003 cracker box, 60 x 158 x 210 mm, 411 g", kg=0.411)
def cracker_box() -> Parts:
    """Carton."""
    return [box((60.0, 158.0, 210.0))]


@PACKAGES.item("sugar_box", f"{YCB}: 004 sugar box, 38 x 89 x 175 mm, 514 g", kg=0.514)
def sugar_box() -> Parts:
    """Carton."""
    return [box((38.0, 89.0, 175.0))]


@PACKAGES.item("pudding_box", f"{YCB}: 008 pudding box, 35 x 110 x 89 mm, 187 g", kg=0.187)
def pudding_box() -> Parts:
    """Carton, lying."""
    return [box((110.0, 89.0, 35.0))]


@PACKAGES.item("gelatin_box", f"{YCB}: 009 gelatin box, 28 x 85 x 73 mm, 97 g", kg=0.097)
def gelatin_box() -> Parts:
    """Carton, lying."""
    return [box((85.0, 73.0, 28.0))]


@PACKAGES.item(
    "milk_carton",
    "typical 1 litre gable-top carton, 70 x 70 x 235 mm; mass: 1 l of milk at 1030 kg/m3 and 30 g of board",
    kg=1.06,
)
def milk_carton() -> Parts:
    """Gable-top carton."""
    body = box((70.0, 70.0, 195.0), 0.8, (0.0, 0.0, 97.5))
    eaves = np.array([(sx * 34.2, sy * 34.2, 195.0) for sx in (-1, 1) for sy in (-1, 1)])
    ridge = np.array([(sx * 34.2, sy * 1.5, 222.0) for sx in (-1, 1) for sy in (-1, 1)])
    fin = box((69.0, 3.0, 20.0), 0.4, (0.0, 0.0, 225.0))
    return [body, joined(eaves, eaves - (0.0, 0.0, 2.0), ridge), fin]


@PACKAGES.item("mustard_bottle", f"{YCB}: 006 mustard bottle, 58 x 95 x 190 mm, 603 g", kg=0.603)
def mustard_bottle() -> Parts:
    """Oval squeeze bottle with a pointed cap."""
    body = joined(
        *(
            oval(a, b, z, 96, 2.4)
            for a, b, z in (
                (45.5, 27.0, 0.0),
                (47.0, 28.4, 1.2),
                (47.5, 29.0, 4.0),
                (47.5, 29.0, 112.0),
                (46.0, 28.2, 122.0),
                (41.0, 25.5, 134.0),
                (33.0, 21.5, 144.0),
                (24.0, 18.0, 150.0),
            )
        )
    )
    cap = lathe(((17.0, 148.0), (17.5, 149.0), (17.5, 163.0), (16.6, 165.0), (13.0, 167.0)))
    nozzle = lathe(((9.0, 166.0), (8.0, 172.0), (4.0, 188.5), (3.0, 190.0)), 48)
    return [body, cap, nozzle]


@PACKAGES.item("bleach_bottle", f"{YCB}: 021 bleach cleanser, 98 x 65 x 250 mm, 1131 g", kg=1.131)
def bleach_bottle() -> Parts:
    """Rounded bottle with sloping shoulders and a ribbed cap."""
    layers = (
        (94.0, 61.0, 0.0),
        (96.8, 63.8, 1.2),
        (98.0, 65.0, 4.0),
        (98.0, 65.0, 160.0),
        (95.0, 63.5, 175.0),
        (84.0, 58.0, 192.0),
        (64.0, 50.0, 207.0),
        (44.0, 42.0, 215.0),
    )
    body = joined(*(rounded_rectangle(w, d, min(w, d) * 0.42, z, 20) for w, d, z in layers))
    collar = lathe(((20.0, 213.0), (20.0, 222.0)))
    cap = lathe(((18.4, 220.0), (19.0, 220.8), (18.0, 247.5), (17.4, 249.2), (16.0, 250.0)))
    return [body, collar, cap]


@PACKAGES.item("spray_bottle", f"{YCB}: 022 windex bottle, 80 x 105 x 270 mm, 1022 g", kg=1.022)
def spray_bottle() -> Parts:
    """Trigger sprayer on an oval bottle with a waist."""
    body = joined(
        *(
            oval(a, b, z, 96, 2.6)
            for a, b, z in ((48.5, 36, 0), (51.5, 39, 1.2), (52.5, 40, 4), (52.5, 40, 96), (44, 33, 112))
        )
    )
    shoulder = joined(
        *(
            oval(a, b, z, 96)
            for a, b, z in ((44, 33, 105), (42, 32, 140), (34, 27.5, 166), (22, 20, 186), (15, 15, 194))
        )
    )
    collar = lathe(((16.4, 192.0), (17.0, 192.8), (17.0, 211.0), (16.0, 212.0)))
    neck = placed(sweep([(6, 0, 210), (4, 0, 236)], [(11, 12)], up=(1, 0, 0), power=3.0, caps=(False, False)))
    head = slab(
        [(-42, 240), (-42, 262), (-30, 270), (34, 270), (44, 262), (50, 247), (50, 236), (-22, 232)],
        -14,
        14,
        3.0,
    )
    head_up = placed(head, turn=(("x", 90.0),))
    nozzle = placed(lathe(((9.0, 0.0), (9.0, 9.0), (7.5, 11.5)), 48), at=(-41, 0, 252), turn=(("y", -90.0),))
    trigger = sweep(
        [(-24, 0, 238), (-30, 0, 226), (-33, 0, 213), (-32, 0, 200), (-35, 0, 190)],
        [(7.0, 5.0), (7.0, 4.4), (7.0, 4.0), (6.5, 3.6), (6.0, 3.0)],
        up=(1, 0, 0),
        n=24,
    )
    return [body, shoulder, collar, *neck, *head_up, *nozzle, *trigger]


@PACKAGES.item(
    "water_bottle",
    "typical 0.5 litre PET bottle, 65 x 215 mm; mass: 0.5 litre of water plus 20 g",
    kg=0.52,
)
def water_bottle() -> Parts:
    """PET bottle with a grip waist, a long shoulder and a cap."""
    low = lathe(((27.0, 0.0), (31.0, 1.5), (32.5, 6.0), (32.5, 62.0), (30.0, 68.0)), 64)
    waist = lathe(((30.0, 66.0), (30.0, 86.0)), 64)
    high = lathe(
        (
            (30.0, 84.0),
            (32.5, 90.0),
            (32.5, 138.0),
            (31.0, 150.0),
            (27.0, 164.0),
            (21.0, 178.0),
            (15.0, 189.0),
            (13.0, 193.0),
        ),
        64,
    )
    neck = lathe(((13.0, 190.0), (13.0, 200.0)), 64)
    ring = lathe(((16.0, 196.0), (16.6, 196.8), (16.6, 198.2), (16.0, 199.0)), 64)
    cap = lathe(((14.4, 201.0), (15.0, 201.6), (15.0, 213.6), (14.0, 215.0)), 64)
    core = lathe(((12.5, 195.0), (12.5, 205.0)), 64)
    return [low, waist, high, neck, ring, cap, core]


@FRUIT.item("banana", f"{YCB}: 011 banana, 36 x 190 mm, 66 g (a plastic fruit, hence light)", kg=0.066)
def banana() -> Parts:
    """Bent, five-sided with soft edges, a stem at one end."""
    count = 21
    t = np.linspace(-1.0, 1.0, count)
    angle = np.radians(52.0) * t
    path = np.column_stack((109.7 * np.sin(angle), 109.7 * (1.0 - np.cos(angle)), np.full(count, 18.0)))
    girth = 17.6 * np.sqrt(np.clip(1.0 - 0.86 * np.abs(t) ** 3.2, 0.0, 1.0))
    girth[-3:] = (10.0, 5.6, 4.6)
    path[-1] += 12.0 * np.array((np.cos(angle[-1]), np.sin(angle[-1]), 0.0))
    return sweep(path, np.column_stack((girth, girth * 1.02)), n=52, power=2.3)


@FRUIT.item("apple", f"{YCB}: 013 apple, 75 mm, 68 g (a plastic fruit, hence light)", kg=0.068)
def apple() -> Parts:
    """Dimpled at both ends, with a stem."""
    profile = [
        (0.0, 8.0),
        (9.0, 1.2),
        (13.0, 0.0),
        (18.0, 1.0),
        (24.0, 5.0),
        (30.0, 12.0),
        (34.8, 21.0),
        (37.1, 31.0),
    ]
    profile += [
        (37.5, 40.0),
        (36.6, 48.0),
        (33.6, 56.0),
        (28.5, 63.0),
        (22.0, 67.6),
        (16.0, 69.2),
        (11.0, 68.4),
    ]
    profile += [(0.0, 60.0)]
    stem = sweep(
        [(0, 0, 57), (0.5, 0, 66), (3, 0, 75)], [(1.5, 1.5), (1.4, 1.4), (2.0, 2.0)], up=(0, 1, 0), n=16
    )
    return [*orange_slices(profile, 16, 5), *stem]


@FRUIT.item("pear", f"{YCB}: 016 pear, 66.2 x 100 mm, 49 g (a plastic fruit, hence light)", kg=0.049)
def pear() -> Parts:
    """Round below, a narrower neck above, with a stem."""
    low = lathe(
        [(33.1 * np.sin(a), 33.1 - 33.1 * np.cos(a)) for a in np.radians(np.arange(15.0, 140.0, 12.5))], 80
    )
    neck = lathe(((30.0, 47.09), (18.173, 75.542), (16.62, 78.59)), 80)
    high = lathe(
        [(19.6 * np.sin(a), 68.2 - 19.6 * np.cos(a)) for a in np.radians(np.arange(112.0, 178.0, 10.0))], 80
    )
    stem = sweep(
        [(0, 0, 84), (0.4, 0, 93), (2.5, 0, 99.6)], [(1.6, 1.6), (1.5, 1.5), (1.8, 1.8)], up=(0, 1, 0), n=16
    )
    return [low, neck, high, *stem]


@FRUIT.item("lemon", f"{YCB}: 014 lemon, 54 x 68 mm, 29 g (a plastic fruit, hence light)", kg=0.029)
def lemon() -> Parts:
    """Ellipsoid with a nipple at each end, lying."""
    t = np.linspace(0.12, np.pi - 0.12, 17)
    body = lathe([(27.0 * np.sin(a) ** 0.92, -30.0 * np.cos(a)) for a in t], 64)
    tip = lathe(((17.5, 22.0), (10.0, 28.0), (6.5, 31.0), (5.6, 33.0), (3.5, 34.0)), 64)
    tail = lathe(((17.5, -22.0), (9.5, -29.0), (6.0, -32.0), (5.0, -33.4), (3.0, -34.0)), 64)
    return placed([body, tip, tail], turn=(("y", 90.0),))


@FRUIT.item("orange", f"{YCB}: 017 orange, 73 mm, 47 g (a plastic fruit, hence light)", kg=0.047)
def orange() -> Parts:
    """Sphere with the button of the stem."""
    button = lathe(((4.5, 35.0), (4.0, 36.9), (3.0, 37.3)), 32)
    return [geodesic(36.5), button]


@FRUIT.item(
    "strawberry", f"{YCB}: 012 strawberry, 43.8 x 55 mm, 18 g (a plastic fruit, hence light)", kg=0.018
)
def strawberry() -> Parts:
    """Heart-shaped cone with a crown of five leaves."""
    profile = [(2.5, 0.0), (6.0, 2.0), (10.0, 6.2), (14.5, 13.0), (18.4, 21.5), (21.0, 30.0), (21.9, 36.0)]
    profile += [(21.4, 41.0), (19.0, 45.2), (15.0, 47.6), (9.0, 48.6)]
    leaf = np.array(
        [
            (0, 4, 47.5),
            (0, -4, 47.5),
            (9, 6, 49.6),
            (9, -6, 49.6),
            (22.5, 0, 50.4),
            (9, 0, 51.6),
            (0, 0, 51.4),
        ]
    )
    leaf = joined(leaf, leaf - (0.0, 0.0, 1.4))
    stem = sweep([(0, 0, 47), (0.8, 0, 54.2)], 1.6, up=(0, 1, 0), n=16)
    leaves = [part for k in range(5) for part in placed(leaf, turn=(("z", 72.0 * k),))]
    return [lathe(profile, 96), *leaves, *stem]
