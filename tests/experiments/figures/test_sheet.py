"""Pictures beside each other: pixel by pixel, with their words."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.experiments.figures.figure import azimuth_from, size_words
from packenv.experiments.figures.sheet import Panel, drawn, sheet
from packenv.types import Container

pytest.importorskip("matplotlib")


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (40, 200, 3), dtype=np.uint8)


def found(page: np.ndarray, picture: np.ndarray) -> tuple[int, int]:
    """Row and column at which a picture is on a page."""
    high, wide = picture.shape[:2]
    corners = np.argwhere((page == picture[0, 0]).all(axis=2))
    places = [(r, c) for r, c in corners if np.array_equal(page[r : r + high, c : c + wide], picture)]
    (place,) = places
    return int(place[0]), int(place[1])


def test_pictures_are_kept_pixel_by_pixel() -> None:
    pictures = [noise(k) for k in range(3)]
    page = drawn(sheet([Panel(p, f"picture {k}") for k, p in enumerate(pictures)], 2))
    places = [found(page, picture) for picture in pictures]
    assert places[0][0] == places[1][0] < places[2][0]
    assert places[0][1] == places[2][1] < places[1][1]
    assert len(set(places)) == 3


def test_long_names_are_cut_and_long_notes_go_on_in_a_second_line() -> None:
    plain = sheet([Panel(noise(0), "a")], 1)
    name = "an_item_with_a_name_that_is_longer_than_the_picture_is_wide"
    worded = sheet([Panel(noise(0), "a", (("#ff0000", name),), ("word " * 30,))], 1)
    texts = [text.get_text() for text in worded.texts]
    assert not any(name in text for text in texts)
    assert any(text.endswith("…") and name.startswith(text[:-1]) for text in texts)
    assert sum("word" in text for text in texts) > 1
    assert worded.get_size_inches()[1] > plain.get_size_inches()[1]
    page = drawn(worded)
    assert (page[:, -6:] == 255).all()  # nothing reaches the margin


def test_names_with_dollars_are_no_formulas() -> None:
    drawn(sheet([Panel(noise(0), "$x_", (("#ff0000", "$\\frac"),))], 1))


@pytest.mark.parametrize(
    ("side", "view"), [((0.0, -1.0), -58.0), ((1.0, 0.2), 32.0), ((-0.3, 1.0), 122.0), ((-1.0, 0.0), 212.0)]
)
def test_a_view_is_from_the_side_that_is_asked(side: tuple[float, float], view: float) -> None:
    assert azimuth_from(np.array(side)) == view


def test_sizes_are_in_centimetres() -> None:
    assert size_words(Container(0.32, 0.279, 0.3)) == "32 × 27.9 × 30 cm"
