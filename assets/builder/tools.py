"""Hand tools. Millimetres; long tools lie along x."""

from __future__ import annotations

import numpy as np

from .solids import (
    Parts,
    arc_path,
    box,
    joined,
    lathe,
    mirrored,
    placed,
    rounded_box,
    slab,
    stroke,
    sweep,
    tube,
)
from .spec import YCB, Section

TOOLS = Section("tool")
STEEL = "steel at 7850 kg/m3"


def along_x(
    profile: list[tuple[float, float]], n: int = 64, at: tuple[float, float, float] = (0, 0, 0)
) -> Parts:
    """A convex body of revolution whose axis is x; the profile is (radius, x)."""
    return placed(lathe(profile, n), at=at, turn=(("y", 90.0),))


@TOOLS.item(
    "power_drill",
    f"{YCB}: 035 power drill, 184 mm long, 895 g; height and battery typical of its class",
    kg=0.895,
)
def power_drill() -> Parts:
    """Cordless drill: motor housing, gear case, chuck, grip, trigger, battery."""
    z = 159.5
    motor = along_x(
        [(18.0, 0.0), (24.0, 2.0), (26.5, 8.0), (27.5, 16.0), (27.5, 88.0), (26.5, 92.0)], 72, (0, 0, z)
    )
    band = along_x([(27.5, 60.0), (28.5, 61.0), (28.5, 70.0), (27.5, 71.0)], 72, (0, 0, z))
    gear = along_x([(26.0, 88.0), (25.5, 112.0), (22.5, 124.0)], 72, (0, 0, z))
    clutch = along_x([(23.0, 120.0), (24.0, 121.0), (24.0, 133.0), (23.0, 134.0)], 72, (0, 0, z))
    chuck = along_x([(19.0, 132.0), (20.5, 134.0), (20.5, 148.0), (19.0, 150.0)], 60, (0, 0, z))
    nose = along_x([(19.5, 149.0), (18.0, 158.0), (10.0, 168.0), (7.0, 170.0)], 60, (0, 0, z))
    bit = along_x([(3.2, 168.0), (3.2, 183.0), (2.4, 184.0)], 32, (0, 0, z))
    grip = sweep(
        [(47, 0, 136), (44, 0, 112), (38, 0, 84), (33, 0, 58), (31, 0, 42)],
        [(17, 24), (16.5, 21), (16, 20), (17, 20), (19, 25)],
        up=(1, 0, 0),
        n=48,
        power=2.6,
        caps=(False, False),
    )
    trigger = sweep(
        [(66, 0, 126), (67, 0, 116), (63, 0, 106), (58, 0, 99)],
        [(6, 8), (6, 8.5), (6, 9), (6, 8)],
        up=(1, 0, 0),
        n=24,
    )
    adapter = rounded_box((86, 50, 18), 6.0, (47, 0, 34))
    battery = rounded_box((98, 57, 30), 7.0, (49, 0, 15))
    switch = rounded_box((18, 14, 8), 2.5, (34, 0, z + 25.8))
    return [*motor, *band, *gear, *clutch, *chuck, *nose, *bit, *grip, *trigger, adapter, battery, switch]


@TOOLS.item("hammer", f"{YCB}: 048 hammer, head 32 x 135 mm, 665 g; length of the handle typical", kg=0.665)
def hammer() -> Parts:
    """Claw hammer, lying."""
    grip = sweep(
        [(0, 0, 16), (15, 0, 16), (60, 0, 16), (105, 0, 16), (140, 0, 16)],
        [(15, 13), (17, 14.5), (15, 12.5), (16.5, 13.5), (13, 11)],
        up=(0, 0, 1),
        n=48,
        power=2.6,
    )
    shaft = sweep(
        [(138, 0, 16), (220, 0, 16), (285, 0, 16)],
        [(10.5, 8), (9.5, 7.5), (10.5, 8)],
        n=40,
        caps=(False, False),
    )
    x = 302.0
    cheek = box((36, 34, 24), 3.0, (x, 2, 16))
    face = placed(
        lathe(((13.0, 0.0), (15.0, 1.6), (16.0, 4.0), (16.0, 14.0), (12.5, 18.0)), 64),
        at=(x, -63, 16),
        turn=(("x", -90.0),),
    )
    neck = placed(
        lathe(((12.0, 16.0), (11.0, 26.0), (12.0, 48.0)), 64), at=(x, -63, 16), turn=(("x", -90.0),)
    )
    # Two tines that bend back towards the grip.
    bend = [(x, 17), (x - 1, 32), (x - 5, 45), (x - 12, 56), (x - 22, 65), (x - 31, 70)]
    half = [(14, 10.6), (13, 8.8), (12, 7.0), (10, 5.2), (8, 3.6), (6.6, 1.8)]
    spread = (5.8, 6.2, 6.6, 7.0, 7.4, 7.8)
    claw = []
    for side in (-1, 1):
        line = [(a, b, 16 + side * s) for (a, b), s in zip(bend, spread, strict=True)]
        # The section's first half-axis lies across the tine (in z), the second along the bend's radius.
        claw += sweep(
            line,
            [(5.6 - 0.55 * i, h[1]) for i, h in enumerate(half)],
            up=(1, 0, 0),
            n=32,
            power=3.0,
            caps=(False, False),
        )
    return [*grip, *shaft, cheek, *face, *neck, *claw]


@TOOLS.item(
    "adjustable_wrench",
    f"{YCB}: 042 adjustable wrench, 205 x 55 mm, 252 g; thickness of head and handle typical",
    kg=0.252,
)
def adjustable_wrench() -> Parts:
    """Open adjustable spanner with a hanging eye."""
    widths = ((16, 8.2), (40, 8.2), (60, 8.5), (80, 9.0), (98, 9.8), (114, 10.8), (128, 12.0), (140, 13.0))
    handle = sweep([(x, 0, 6.5) for x, _ in widths], [(w, 4.2) for _, w in widths], n=100, power=3.0)
    rail = stroke([(18.0, 0.0, 10.5), (130.0, 0.0, 12.0)], 1.5, 3.5, 0.8, 24)
    rail2 = stroke([(18.0, 0.0, 10.5), (130.0, 0.0, 12.0)], 9.5, 11.5, 0.8, 24)
    eye = stroke([(x, y, 3.2) for x, y in arc_path((10.8, 0.0), 7.6, 0.0, 360.0, 11)], 1.5, 11.5, 0.8, 28)
    neck = slab(
        [
            (126, -12),
            (140, -14),
            (158, -22),
            (166, -16),
            (172, 2),
            (168, 10),
            (158, 18),
            (140, 16),
            (126, 12),
        ],
        0.0,
        13.0,
        1.5,
    )
    fixed = slab(
        [
            (160, 4),
            (170, 5),
            (190, 11.0),
            (204, 10.0),
            (205, 14.0),
            (198, 22.0),
            (180, 27.0),
            (164, 24),
            (150, 18),
        ],
        0.0,
        13.0,
        1.5,
    )
    under = slab([(150, -26), (158, -28), (171, -26), (174, -4), (160, 8), (146, -6)], 0.0, 13.0, 1.5)
    moving = slab(
        [(164, -18), (172, -17.5), (192, -9.5), (203, -9.5), (204, -12), (194, -19), (176, -26), (164, -27)],
        1.0,
        12.0,
        1.2,
    )
    worm = placed(
        lathe(((5.0, 0.0), (6.6, 1.0), (6.6, 13.0), (5.0, 14.0)), 72), at=(150, -23, 6.5), turn=(("y", 90.0),)
    )
    return [*handle, *rail, *rail2, *eye, neck, fixed, under, moving, *worm]


def screwdriver(tip: Parts) -> Parts:
    """Fluted grip and round shank along x; the tip is given."""
    pommel = along_x([(9.0, 0.0), (12.5, 1.6), (14.5, 5.0), (15.0, 9.0), (15.0, 12.0)], 64)
    core = along_x([(12.2, 8.0), (12.6, 40.0), (12.6, 82.0), (11.0, 88.0)], 64)
    # Six ribs make the flutes between them.
    ribs = []
    for k in range(6):
        angle = np.radians(60.0 * k)
        y, z = 10.6 * np.cos(angle), 10.6 * np.sin(angle)
        rib = sweep(
            [(9, y, z), (40, y * 1.02, z * 1.02), (82, y * 0.98, z * 0.98), (90, y * 0.7, z * 0.7)], 4.9, n=18
        )
        ribs += rib
    neck = along_x([(10.5, 86.0), (8.8, 94.0), (8.8, 98.0)], 64)
    guard = along_x([(8.6, 96.0), (11.6, 102.0), (11.6, 105.0), (8.0, 110.0)], 64)
    shank = along_x([(3.4, 108.0), (3.4, 206.0)], 48)
    return placed([*pommel, *core, *ribs, *neck, *guard, *shank, *tip])


@TOOLS.item("phillips_screwdriver", f"{YCB}: 043 phillips screwdriver, 31 x 215 mm, 97 g", kg=0.097)
def phillips_screwdriver() -> Parts:
    """Screwdriver with a cross tip."""
    blade = joined(
        *(
            np.array([(x, s * h, t * 0.9) for s in (-1, 1) for t in (-1, 1)])
            for x, h in ((203, 3.2), (211, 2.4), (215, 1.0))
        )
    )
    return screwdriver([blade, *placed(blade, turn=(("x", 90.0),))])


@TOOLS.item("flat_screwdriver", f"{YCB}: 044 flat screwdriver, 31 x 215 mm, 98.4 g", kg=0.0984)
def flat_screwdriver() -> Parts:
    """Screwdriver with a flared flat tip."""
    flare = joined(
        *(
            np.array([(x, s * h, t * d) for s in (-1, 1) for t in (-1, 1)])
            for x, h, d in ((200, 2.6, 2.2), (207, 4.4, 1.6), (215, 4.0, 0.6))
        )
    )
    return screwdriver([flare])


@TOOLS.item("scissors", f"{YCB}: 037 scissors, 200 x 14 mm, 82 g; opened to a width of 95 mm", kg=0.082)
def scissors() -> Parts:
    """Household scissors, a little open."""

    def half(large: bool) -> Parts:
        a, b = (29.0, 17.0) if large else (24.0, 16.0)
        loop = arc_path((0.0, 0.0), (a, b), -180.0, 180.0, 15)
        bow = stroke([(x, y, 4.6) for x, y in loop], 0.0, 14.0, 3.0, 24)
        return placed(
            bow,
            at=(34.0 if large else 30.0, -25.5 if large else 26.5, 0.0),
            turn=(("z", 12.0 if large else -12.0),),
        )

    arm_a = stroke([(58.0, -15.0, 5.6), (80.0, -7.5, 6.5), (106.0, 0.0, 8.5)], 2.0, 8.0, 1.2, 40)
    arm_b = stroke([(50.0, 17.0, 5.6), (78.0, 8.5, 6.5), (106.0, 0.0, 8.5)], 6.0, 12.0, 1.2, 40)
    blade_a = slab(
        [(100, -5), (106, -8.4), (120, -3.0), (198, 16.5), (200, 18.2), (150, 15.0), (112, 7.5), (102, 6)],
        4.6,
        7.2,
        0.5,
    )
    blade_b = slab(
        [(100, 5), (106, 8.4), (120, 3.0), (198, -16.5), (200, -18.2), (150, -15.0), (112, -7.5), (102, -6)],
        7.0,
        9.6,
        0.5,
    )
    rivet = placed(lathe(((4.0, 0.0), (5.6, 1.0), (5.6, 10.6), (4.0, 11.6)), 40), at=(107, 0, 1.2))
    return [*half(True), *half(False), *arm_a, *arm_b, blade_a, blade_b, *rivet]


@TOOLS.item(
    "padlock", f"{YCB}: 038 padlock, 24 x 47 x 65 mm; mass from volume x brass at 8500 kg/m3", density=8500.0
)
def padlock() -> Parts:
    """Locked padlock standing on its body."""
    body = rounded_box((46.4, 23.4, 36.0), 3.5, (0.0, 0.0, 18.0), steps=6)
    band = rounded_box((47.0, 24.0, 4.0), 1.2, (0.0, 0.0, 30.0))
    bow = [
        (-15.5, 30.0),
        (-15.5, 45.2),
        *arc_path((0.0, 45.2), 15.5, 180.0, 0.0, 15)[1:-1],
        (15.5, 45.2),
        (15.5, 30.0),
    ]
    shackle = sweep([(x, 0.0, z) for x, z in bow], 4.3, up=(0, 1, 0), n=32, caps=(False, False))
    return [body, band, *shackle]


def spring_clamp(length: float, width: float, thick: float) -> Parts:
    """Spring clamp in the xy plane: crossed arms, coil at the pivot, pads at the jaws."""
    pivot = 0.56 * length
    w = width / 2.0
    r = 0.055 * length
    arm = [
        (r, -w + r, r),
        (0.16 * length, -w + 1.02 * r, 1.02 * r),
        (0.36 * length, -0.50 * w, 1.05 * r),
        (pivot, 0.30 * w, 1.45 * r),
        (0.72 * length, 0.62 * w, 1.1 * r),
        (0.84 * length, 0.60 * w, 0.95 * r),
        (0.94 * length, 0.26 * w, 0.8 * r),
    ]
    low, high = 0.14 * thick, 0.86 * thick
    side = stroke(arm, low, high, 0.06 * thick, 64)
    pad = slab(
        [
            (0.89 * length, 0.02 * w),
            (length, 0.02 * w),
            (length, 0.22 * w),
            (0.97 * length, 0.34 * w),
            (0.89 * length, 0.30 * w),
        ],
        0.08 * thick,
        0.92 * thick,
        0.05 * thick,
    )
    coil = placed(
        lathe(((1.2 * r, 0.0), (1.35 * r, 0.03 * thick), (1.35 * r, 0.97 * thick), (1.2 * r, thick)), 72),
        at=(pivot, 0, 0),
    )
    half = [*side, pad]
    return [*half, *mirrored(half, 1), *coil]


@TOOLS.item("medium_clamp", f"{YCB}: 050 medium clamp, 90 x 115 x 27 mm, 59 g", kg=0.059)
def medium_clamp() -> Parts:
    """Spring clamp."""
    return spring_clamp(115.0, 90.0, 27.0)


@TOOLS.item("large_clamp", f"{YCB}: 051 large clamp, 125 x 165 x 32 mm, 125 g", kg=0.125)
def large_clamp() -> Parts:
    """Spring clamp."""
    return spring_clamp(165.0, 125.0, 32.0)


@TOOLS.item("c_clamp", f"typical 3 inch C-clamp, 110 x 167 mm; mass from volume x {STEEL}", density=7850.0)
def c_clamp() -> Parts:
    """C-shaped frame, screw with a swivel pad and a sliding bar."""
    frame = stroke(
        [
            (0, 0, 9.0),
            (34, 0, 8.0),
            (58, 3, 8.0),
            (68, 16, 8.0),
            (68, 84, 8.0),
            (58, 97, 8.0),
            (34, 100, 8.0),
            (4, 100, 11.0),
        ],
        3.0,
        15.0,
        1.6,
        40,
    )
    web = stroke([(66, 14, 5.0), (66, 86, 5.0)], 0.0, 18.0, 1.2, 32)
    anvil = placed(
        lathe(((9.5, 0.0), (10.5, 1.0), (10.5, 5.0), (9.0, 8.0)), 48), at=(0, 14.0, 9), turn=(("x", 90.0),)
    )
    screw = placed(
        lathe(((5.5, 0.0), (6.0, 0.6), (6.0, 120.0), (5.5, 121.0)), 48), at=(0, 34, 9), turn=(("x", -90.0),)
    )
    pad = placed(
        lathe(((9.5, 0.0), (10.5, 1.0), (10.5, 4.0), (7.0, 9.0)), 48), at=(0, 28, 9), turn=(("x", -90.0),)
    )
    head = placed(
        lathe(((6.5, 0.0), (7.5, 1.0), (7.5, 11.0), (6.5, 12.0)), 40), at=(0, 146, 9), turn=(("x", -90.0),)
    )
    bar = along_x([(2.6, -32.0), (2.6, 32.0)], 32, (0, 152, 9))
    knobs = [
        p
        for x in (-34.0, 30.0)
        for p in along_x([(3.0, 0.0), (4.6, 1.0), (4.6, 3.0), (3.0, 4.0)], 32, (x, 152, 9))
    ]
    return [*frame, *web, *anvil, *screw, *pad, *head, *bar, *knobs]


@TOOLS.item(
    "pliers",
    "typical 180 mm combination pliers; mass from volume x 5000 kg/m3 (steel with plastic sleeves)",
    density=5000.0,
)
def pliers() -> Parts:
    """Combination pliers with bowed handles, a little open."""
    arm = [
        (6.0, -27.0, 5.5),
        (30.0, -29.0, 6.4),
        (60.0, -25.0, 6.4),
        (90.0, -15.0, 6.0),
        (108.0, -6.0, 6.5),
        (124.0, 3.0, 10.0),
    ]
    sleeve = [(4.5 + 1.0, -27.0, 5.5), (30.0, -29.0, 7.6), (60.0, -25.0, 7.6), (84.0, -17.0, 6.8)]
    jaw = slab(
        [
            (118, -2),
            (122, 12.5),
            (134, 12.0),
            (150, 8.0),
            (178, 5.5),
            (180, 4.5),
            (180, 1.4),
            (150, 0.6),
            (134, -2),
        ],
        1.0,
        11.0,
        1.0,
    )
    half = [*stroke(arm, 2.0, 10.0, 1.2, 44), *stroke(sleeve, 0.0, 12.0, 2.4, 56), jaw]
    rivet = placed(lathe(((7.0, 0.0), (8.0, 0.8), (8.0, 11.6), (7.0, 12.4)), 40), at=(125, 0, -0.2))
    return [*half, *mirrored(half, 1), *rivet]


@TOOLS.item(
    "packing_tape",
    "typical roll of packing tape, 110 x 49 mm on a 76 mm core; mass from volume x 950 kg/m3",
    density=950.0,
)
def packing_tape() -> Parts:
    """Roll of tape, lying; the core stands out by half a millimetre."""
    core = tube(38.0, 41.5, 0.0, 49.0, 0.4, 24, 6)
    roll = tube(40.6, 55.0, 0.5, 48.5, 0.4, 24, 6)
    return [*core, *roll]
