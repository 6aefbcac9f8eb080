"""Colours that the viewer page and the picture share, so that an item looks the same in both."""

from __future__ import annotations

import colorsys

# Neighbours in the list differ in hue *and* in lightness: they lie beside each other in the container,
# and a reader who cannot tell red from green still sees two items.
_PALETTE = (
    (0x4E, 0x8F, 0xD0),
    (0xF2, 0xA5, 0x41),
    (0x57, 0xA7, 0x73),
    (0xD9, 0x5D, 0x5A),
    (0x8C, 0x7A, 0xC6),
    (0xE9, 0xC8, 0x46),
    (0x3F, 0xA9, 0xA8),
    (0xE3, 0x8D, 0xB4),
    (0x9C, 0x6F, 0x4E),
    (0xA3, 0xC8, 0x5A),
    (0x5F, 0x6F, 0xA8),
    (0xF0, 0x8A, 0x6B),
)
_GOLDEN_RATIO = 0.618033988749895


def item_colour(index: int) -> tuple[int, int, int]:
    """Colour of the item at one place of the packing sequence.

    Args:
        index: 0 for the first placed item; any non-negative number.

    Returns:
        (red, green, blue), sRGB, 0 to 255 each.
    """
    if index < len(_PALETTE):
        return _PALETTE[index]
    # Past the palette, hues by the golden ratio never come near each other for long.
    turn = index - len(_PALETTE)
    red, green, blue = colorsys.hls_to_rgb(
        (0.07 + turn * _GOLDEN_RATIO) % 1.0, 0.48 + 0.12 * (turn % 3), 0.42 + 0.16 * (turn % 2)
    )
    return (round(red * 255), round(green * 255), round(blue * 255))


def hex_colour(colour: tuple[int, int, int]) -> str:
    """A colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
