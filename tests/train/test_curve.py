"""The picture of the learning curve."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from packenv.train.curve import curve_figure, curve_svg

pytest.importorskip("matplotlib")


def rows(values):
    return [
        {"timesteps": 1000 * k, "return": value, "return_ci95": 0.1, "episodes": 50}
        for k, value in enumerate(values)
    ]


def test_every_value_is_a_point_and_every_baseline_a_level():
    figure = curve_figure(rows([1.0, 1.4, 1.9]), {"random": rows([1.1])[0], "hm": rows([1.8])[0]})
    (axes,) = figure.axes
    drawn = {line.get_label(): line for line in axes.lines}
    np.testing.assert_array_equal(drawn["learned"].get_xydata(), [[0, 1.0], [1000, 1.4], [2000, 1.9]])
    for name, value in {"random": 1.1, "hm": 1.8}.items():
        assert set(drawn[name].get_ydata()) == {value}
    assert {text.get_text(): text.xy[1] for text in axes.texts} == {"learned": 1.9, "random": 1.1, "hm": 1.8}
    band = axes.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == pytest.approx((0.9, 2.0))


@pytest.mark.parametrize("values", [[0.0], [-3.0, 2000.0], [1e-9, 2e-9]])
def test_everything_stays_inside_the_picture(values):
    (axes,) = curve_figure(rows(values), {"random": rows([0.0])[0]}).axes
    low, high = axes.get_ylim()
    assert low <= min(*values, 0.0) - 0.1
    assert high >= max(*values, 0.0) + 0.1


def test_a_single_row_without_spread_can_be_drawn():
    row = {**rows([0.0])[0], "return_ci95": 0.0}
    ET.fromstring(curve_svg([row], {}))


def test_names_are_text_and_the_same_rows_give_the_same_picture():
    svg = curve_svg(rows([1.0]), {"<b>& $x$ _y": rows([1.0])[0]})
    assert "<b>& $x$ _y" in "".join(ET.fromstring(svg).itertext())
    assert svg == curve_svg(rows([1.0]), {"<b>& $x$ _y": rows([1.0])[0]})
