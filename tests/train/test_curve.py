"""The picture of the learning curve."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from packenv.train.curve import curve_svg

SVG = "{http://www.w3.org/2000/svg}"


def rows(values):
    return [
        {"timesteps": 1000 * k, "return": value, "return_ci95": 0.1, "episodes": 50}
        for k, value in enumerate(values)
    ]


def heights(svg: str) -> tuple[list[float], dict[str, float]]:
    """Y of the curve's points, and of the level lines by the label that follows them."""
    root = ET.fromstring(svg)
    line = root.find(f"{SVG}polyline")
    assert line is not None
    curve = [float(pair.split(",")[1]) for pair in line.attrib["points"].split()]
    levels = re.findall(r'y1="([\d.]+)"[^>]*dasharray[^>]*>\n<text[^>]*>([^<]*)<', svg)
    return curve, {name: float(y) for y, name in levels}


def test_what_is_higher_is_drawn_higher():
    svg = curve_svg(rows([1.0, 1.4, 1.9]), {"random": rows([1.1])[0], "hm": rows([1.8])[0]})
    curve, levels = heights(svg)
    assert curve[0] > levels["random"] > curve[1] > levels["hm"] > curve[2]


def test_equal_values_lie_on_one_line():
    curve, levels = heights(curve_svg(rows([1.5, 1.5]), {"hm": rows([1.5])[0]}))
    assert curve[0] == curve[1] == levels["hm"]


def test_everything_stays_inside_the_picture():
    for values in ([0.0], [-3.0, 2000.0], [1e-9, 2e-9]):
        svg = curve_svg(rows(values), {"random": rows([0.0])[0]})
        coordinates = [float(y) for y in re.findall(r'(?:cy|y|y1|y2)="(-?[\d.]+)"', svg)]
        assert all(0 <= y <= 420 for y in coordinates)


def test_a_single_row_without_spread_can_be_drawn():
    row = {**rows([0.0])[0], "return_ci95": 0.0}
    ET.fromstring(curve_svg([row], {}))


def test_names_are_text_not_markup():
    ET.fromstring(curve_svg(rows([1.0]), {"<b>&": rows([1.0])[0]}))
