"""Things of the house: stationery, care, small equipment. Millimetres."""

from __future__ import annotations

from .solids import Parts, Profile, box, joined, lathe, oval, placed, rounded_box, shell, sweep, tube
from .spec import YCB, Section
from .tools import along_x

HOUSE = Section("household")


@HOUSE.item("large_marker", f"{YCB}: 040 large marker, 18 x 121 mm, 15.8 g", kg=0.0158)
def large_marker() -> Parts:
    """Marker with its cap on, lying."""
    barrel = along_x([(7.0, 0.0), (8.0, 1.0), (8.2, 4.0), (8.2, 70.0)], 64)
    plug = along_x([(8.2, 6.0), (8.8, 6.6), (8.8, 9.4), (8.2, 10.0)], 64)
    cap = along_x(
        [(8.4, 68.0), (9.0, 68.8), (9.0, 98.0), (8.4, 104.0), (7.0, 112.0), (6.0, 120.0), (5.4, 121.0)], 72
    )
    clip = rounded_box((42.0, 4.0, 2.4), 0.9, (92.0, 0.0, 9.0))
    ring = along_x([(8.2, 60.0), (8.7, 60.5), (8.7, 65.5), (8.2, 66.0)], 64)
    return placed([*barrel, *plug, *ring, *cap, clip])


@HOUSE.item(
    "light_bulb",
    "A19 lamp: 19 eighths of an inch across (60 x 110 mm) with an E26 cap; mass typical",
    kg=0.034,
)
def light_bulb() -> Parts:
    """Pear-shaped lamp with a threaded cap, standing on its globe."""
    globe = [(4.0, 0.0), (10.0, 1.6), (18.0, 6.0), (24.6, 13.0), (28.8, 22.0), (30.0, 31.0), (29.0, 39.0)]
    body = lathe([*globe, (26.2, 47.0), (22.0, 56.0)], 52)
    neck = lathe(((22.0, 56.0), (17.0, 70.0)), 52)
    throat = lathe(((17.0, 70.0), (14.0, 84.0)), 52)
    shaft = lathe(((12.2, 82.0), (12.2, 104.0)), 40)
    threads = [
        lathe(((12.0, z), (13.2, z + 1.2), (13.2, z + 1.8), (12.0, z + 3.0)), 40)
        for z in (84.0, 88.0, 92.0, 96.0, 100.0)
    ]
    tip = lathe(((12.0, 103.0), (8.0, 106.0), (5.0, 108.6), (4.0, 110.0)), 40)
    return [body, neck, throat, shaft, *threads, tip]


@HOUSE.item(
    "dumbbell", "typical 2 kg hexagonal dumbbell; mass from volume x cast iron at 7200 kg/m3", density=7200.0
)
def dumbbell() -> Parts:
    """Two hexagonal heads on a round bar."""
    across = 29.0 * 2.0 / 3.0**0.5
    heads = []
    for side in (-1, 1):
        rings = ((0.80, 44.0), (0.98, 46.5), (1.0, 49.0), (1.0, 77.0), (0.98, 79.5), (0.80, 83.0))
        hexes = [placed(lathe([(across * k, 0.0), (across * k, 0.01)], 6), at=(0, 0, z)) for k, z in rings]
        head = joined(*(points for group in hexes for points in group))
        # A flat of the hexagon is turned down, so that the dumbbell rests as one does.
        heads += placed(head, turn=(("y", 90.0 * side), ("x", 90.0)))
    grip = (
        (-46, 12.0),
        (-36, 12.0),
        (-27, 13.4),
        (-16, 14.3),
        (0, 14.6),
        (16, 14.3),
        (27, 13.4),
        (36, 12.0),
        (46, 12.0),
    )
    bar = sweep([(x, 0, 0) for x, _ in grip], [(r, r) for _, r in grip], n=104)
    return [*heads, *bar]


@HOUSE.item(
    "soap_bar", "typical bar of soap, 95 x 62 x 32 mm; mass from volume x soap at 1050 kg/m3", density=1050.0
)
def soap_bar() -> Parts:
    """Pillow-shaped bar."""
    layers = (
        (41.0, 24.5, 0.0),
        (44.5, 28.0, 2.0),
        (46.6, 30.0, 6.0),
        (47.5, 31.0, 12.0),
        (47.5, 31.0, 20.0),
        (46.6, 30.0, 26.0),
    )
    layers += ((44.5, 28.0, 30.0), (41.0, 24.5, 32.0))
    return [joined(*(oval(a, b, z, 128, 2.8) for a, b, z in layers))]


@HOUSE.item("sponge", f"{YCB}: 026 sponge, 72 x 114 x 14 mm, 6.2 g", kg=0.0062)
def sponge() -> Parts:
    """Flat sponge."""
    return [rounded_box((114.0, 72.0, 14.0), 2.0, (0.0, 0.0, 7.0), steps=3)]


@HOUSE.item("foam_brick", f"{YCB}: 061 foam brick, 50 x 75 x 50 mm, 28 g", kg=0.028)
def foam_brick() -> Parts:
    """Soft block."""
    return [rounded_box((75.0, 50.0, 50.0), 1.5, (0.0, 0.0, 25.0), steps=3)]


@HOUSE.item("wood_block", f"{YCB}: 036 wood block, 85 x 85 x 200 mm, 729 g", kg=0.729)
def wood_block() -> Parts:
    """Square timber."""
    return [box((85.0, 85.0, 200.0), 1.5)]


@HOUSE.item(
    "book",
    "typical hardcover novel, 140 x 216 x 30 mm; mass from volume x paper and board at 750 kg/m3",
    density=750.0,
)
def book() -> Parts:
    """Hardcover book, lying: boards stand over the pages, the spine is round."""
    pages = box((131.0, 208.0, 25.4), 0.3, (-0.8, 0.0, 15.0))
    boards = [box((136.0, 216.0, 2.6), 0.4, (2.0, 0.0, z)) for z in (1.3, 28.7)]
    spine = placed(
        joined(*(placed(oval(4.4, 14.6, z, 64, 2.6))[0] for z in (-108.0, 108.0))),
        at=(-65.6, 0.0, 15.0),
        turn=(("x", 90.0),),
    )
    return [pages, *boards, *spine]


@HOUSE.item(
    "flower_pot",
    "typical clay pot, 100 x 92 mm, 6 mm wall, drain hole; mass from volume x terracotta at 1900 kg/m3",
    density=1900.0,
)
def flower_pot() -> Parts:
    """Tapered clay pot with a rolled rim."""
    floor = shell([([(30.0, 0.0), (31.0, 1.0), (32.0, 7.0)], ((6.0, 0.0), (6.0, 7.0)))], 24, 5)
    wall: Profile = [(32.0, 7.0), (44.2, 70.0)]
    rim: Profile = [(44.2, 70.0), (48.4, 70.4), (49.0, 71.2), (50.0, 90.4), (49.4, 91.6), (48.4, 92.0)]
    wedges = shell([(wall, ((26.0, 7.0), (38.2, 70.0))), (rim, ((38.2, 70.0), (42.4, 92.0)))], 24, 5)
    return [*floor, *wedges]


@HOUSE.item("paper_roll", "typical toilet-paper roll, 110 x 100 mm on a 42 mm core; mass typical", kg=0.110)
def paper_roll() -> Parts:
    """Roll of paper, standing."""
    return [*tube(21.0, 22.4, 0.0, 100.4, 0.2, 24, 5), *tube(22.0, 55.0, 0.2, 100.2, 1.5, 24, 5)]


@HOUSE.item(
    "flashlight",
    "typical 2 x D metal flashlight, 215 mm; mass from volume x 1600 kg/m3, cells included",
    density=1600.0,
)
def flashlight() -> Parts:
    """Torch with a flared head, knurled barrel and a switch."""
    tail = along_x([(17.0, 0.0), (19.0, 1.5), (19.0, 24.0), (18.0, 25.0)], 36)
    barrel = along_x([(17.4, 20.0), (17.4, 150.0)], 36)
    rings = [
        p
        for x in range(34, 118, 12)
        for p in along_x([(17.2, x), (18.2, x + 1.0), (18.2, x + 6.0), (17.2, x + 7.0)], 36)
    ]
    switch = rounded_box((20.0, 11.0, 6.0), 2.0, (134.0, 0.0, 17.6))
    flare = along_x([(17.4, 148.0), (26.6, 186.0)], 36)
    head = along_x([(26.0, 184.0), (28.0, 186.0), (28.0, 210.0), (26.6, 215.0)], 36)
    return placed([*tail, *barrel, *rings, switch, *flare, *head])
