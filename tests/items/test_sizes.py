"""Items far out of scale are said to be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from packenv.geometry.meshes import UNITS
from packenv.items.catalogue import open_catalogue
from packenv.items.check import check_items
from packenv.items.sizes import suspicious_sizes
from tests.mesh_samples import block, write_mesh


def test_one_of_another_unit(tmp_path):
    """A part of 1.5 m among parts of 15 mm, and the same in the table of `items check`."""
    said = suspicious_sizes({"a": 0.014, "b": 0.015, "c": 1.5, "d": 0.016})
    assert said == {
        "c": "suspicious: 1.5 m, 100 times longer than the others' median of 0.015 m; is its unit right?"
    }
    for name, size in (("a", 0.014), ("b", 0.015), ("c", 0.5), ("d", 0.016)):
        write_mesh(tmp_path / f"{name}.ply", block(size, size, size))
    texts = {report.name: report.text for report in check_items(tmp_path)}
    assert [name for name, text in texts.items() if text] == ["c"]
    assert texts["c"].startswith("suspicious: 0.5 m, 33 times longer")


@pytest.mark.parametrize("factor", [10.0, 25.4, 1000.0])
def test_every_mix_of_two_units_shows(factor):
    sizes = {str(k): 0.1 for k in range(5)}
    assert list(suspicious_sizes({**sizes, "x": 0.1 * factor})) == ["x"]
    assert list(suspicious_sizes({**sizes, "x": 0.1 / factor})) == ["x"]


@pytest.mark.parametrize("unit", [None, "mm", "cm", "m", "in"])
def test_what_is_refused_for_its_size_tells_of_the_others(tmp_path, unit):
    """A part whose --unit is another than that of most, which are too small with it, or too large."""
    for part, others in ((0.06, 0.0006), (0.006, 6.0)):
        for name, size in {"part": part, "x": others, "y": others * 1.1}.items():
            write_mesh(tmp_path / f"{name}.ply", block(*[size / UNITS[unit or "m"]] * 3))
        found = {report.name: report for report in check_items(tmp_path, unit)}
        assert [report.status for report in found.values()] == ["ok", "error", "error"]
        assert [name for name, report in found.items() if "suspicious" in report.text] == ["part"]


@pytest.mark.parametrize("refused", [0, 3])
def test_of_two_items_either_may_be_the_wrong_one(refused, tmp_path):
    """However many others are of no use at all, and near one of them in size."""
    small = {f"x{k}": 0.0015 + k / 1e4 for k in range(refused)}
    for name, size in {"long": 0.06, "short": 0.006, **small}.items():
        write_mesh(tmp_path / f"{name}.ply", block(*[size * 1000] * 3))
    found = {report.name: report.text for report in check_items(tmp_path, "mm")}
    assert "0.06 m, 10 times longer than the other's size of 0.006 m; is its unit right?" in found["long"]
    assert "0.006 m, 10 times shorter than the other's size of 0.06 m" in found["short"]
    write_mesh(tmp_path / "short.ply", block(9, 9, 9))
    assert not any("suspicious" in r.text for r in check_items(tmp_path, "mm") if r.name == "short")


@given(st.lists(st.floats(0.05, 0.39), max_size=20), st.floats(1e-3, 1e3))
def test_sizes_within_a_range_are_fine_in_any_unit(sizes, unit):
    assert suspicious_sizes({str(k): size * unit for k, size in enumerate(sizes)}) == {}


@pytest.mark.objects
def test_no_scan_and_no_item_of_the_product_is_suspicious(objects_dir):
    for folder in (objects_dir, None):
        catalogue = open_catalogue(folder)
        sizes = {name: float(np.max(catalogue.item(name).extents)) for name in catalogue.names}
        assert suspicious_sizes(sizes) == {}
