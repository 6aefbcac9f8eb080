"""Mass properties against closed forms, and their laws under motion."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from packenv.geometry.mass import (
    area,
    estimated_mass,
    hull_volume,
    signed_volume,
    solid_properties,
)
from tests.mesh_samples import arrays, ball, block, cup

SHAPES = {"block": arrays(block()), "cup": arrays(cup()), "ball": arrays(ball(at=(0.3, -0.2, 0.1)))}


@pytest.mark.parametrize("name", SHAPES)
@given(
    seed=st.integers(0, 2**31),
    shift=st.tuples(*[st.floats(-5, 5)] * 3),
    scale=st.floats(0.1, 10),
)
def test_properties_move_turn_and_scale_with_the_mesh(name, seed, shift, scale):
    vertices, faces = SHAPES[name]
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    before = solid_properties(vertices, faces)
    after = solid_properties(scale * vertices @ turn.T + np.array(shift), faces)
    assert after.volume == pytest.approx(before.volume * scale**3, rel=1e-9)
    assert after.com == pytest.approx(scale * turn @ before.com + shift, abs=1e-10 * (1 + scale))
    expected = scale**5 * turn @ before.inertia @ turn.T
    assert after.inertia == pytest.approx(expected, abs=1e-8 * np.trace(expected))


@pytest.mark.parametrize("name", SHAPES)
def test_turning_every_face_changes_the_sign_of_the_volume_only(name):
    vertices, faces = SHAPES[name]
    there, back = solid_properties(vertices, faces), solid_properties(vertices, faces[:, ::-1])
    assert back.volume == pytest.approx(-there.volume)
    assert back.com == pytest.approx(there.com)
    assert back.inertia == pytest.approx(-there.inertia)


def test_two_solids_together_add_up():
    one, two = block(), ball(at=(0.4, 0, 0))
    both = solid_properties(*arrays(one, two))
    a, b = solid_properties(*arrays(one)), solid_properties(*arrays(two))
    assert both.volume == pytest.approx(a.volume + b.volume)
    com = (a.volume * a.com + b.volume * b.com) / both.volume
    assert both.com == pytest.approx(com)
    # Parallel axes (Steiner).
    inertia = np.zeros((3, 3))
    for part in (a, b):
        d = part.com - com
        inertia += part.inertia + part.volume * (d @ d * np.eye(3) - np.outer(d, d))
    assert both.inertia == pytest.approx(inertia)


def test_box():
    x, y, z = 0.1, 0.06, 0.04
    found = solid_properties(*arrays(block(x, y, z, at=(7.0, -3.0, 2.0))))
    v = x * y * z
    assert found.volume == pytest.approx(v)
    assert found.com == pytest.approx([7.0, -3.0, 2.0])
    diagonal = [v * (y * y + z * z) / 12, v * (x * x + z * z) / 12, v * (x * x + y * y) / 12]
    assert found.inertia == pytest.approx(np.diag(diagonal), abs=1e-15)
    assert area(*arrays(block(x, y, z))) == pytest.approx(2 * (x * y + y * z + z * x))


def test_sphere_within_the_error_of_its_mesh():
    r = 0.05
    found = solid_properties(*arrays(ball(r, subdivisions=5)))
    v = 4 / 3 * np.pi * r**3
    assert found.volume == pytest.approx(v, rel=1e-3)
    assert found.inertia == pytest.approx(np.eye(3) * 0.4 * v * r * r, rel=2e-3, abs=1e-12)


def test_prism_in_the_place_of_a_cylinder():
    r, h, n = 0.03, 0.2, 128
    mesh = trimesh.creation.cylinder(radius=r, height=h, sections=n)
    found = solid_properties(*arrays(mesh))
    # Exact for the regular n-gon prism that the mesh is.
    step = 2 * np.pi / n
    base = n / 2 * r * r * np.sin(step)
    polar = base * r * r * (2 + np.cos(step)) / 6
    assert found.volume == pytest.approx(base * h)
    sideways = h * polar / 2 + base * h**3 / 12
    assert found.inertia == pytest.approx(np.diag([sideways, sideways, h * polar]), abs=1e-12)
    assert found.volume == pytest.approx(np.pi * r * r * h, rel=1e-3)


def test_tetrahedron():
    a = 0.1
    vertices = np.array([[0, 0, 0], [a, 0, 0], [0, a, 0], [0, 0, a]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = solid_properties(vertices, faces)
    v = a**3 / 6
    assert found.volume == pytest.approx(v)
    assert found.com == pytest.approx([a / 4] * 3)
    # About the right-angled corner: the integral of x² is a⁵/60 and of xy is a⁵/120.
    corner = np.full((3, 3), -(a**5) / 120)
    np.fill_diagonal(corner, a**5 / 30)
    d = found.com
    assert found.inertia == pytest.approx(corner - v * (d @ d * np.eye(3) - np.outer(d, d)), abs=1e-16)
    assert area(vertices, faces) == pytest.approx(1.5 * a * a + np.sqrt(3) / 2 * a * a)


def test_no_volume_is_refused():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    with pytest.raises(ValueError, match="volume of 0"):
        solid_properties(vertices, np.array([[0, 1, 2], [0, 2, 1]]))


def test_hull_of_a_cup_is_its_filled_frustum():
    vertices, faces = arrays(cup())
    solid = hull_volume(vertices)
    assert solid > 2 * signed_volume(vertices, faces)
    frustum = np.pi * 0.1 / 3 * (0.03**2 + 0.03 * 0.04 + 0.04**2)
    assert solid == pytest.approx(frustum, rel=0.01)


@given(v=st.floats(1e-7, 1e-2), hull=st.floats(1e-7, 1e-2))
def test_estimated_mass_grows_with_volume_and_scales_as_a_mass(v, hull):
    mass = estimated_mass(v, hull)
    assert mass > 0
    assert estimated_mass(2 * v, hull) > mass
    assert estimated_mass(v, 2 * hull) > mass
    assert estimated_mass(8 * v, 8 * hull) == pytest.approx(8 * mass)


@pytest.mark.objects
def test_estimated_mass_is_as_good_as_its_docstring_says(objects_dir):
    import csv

    assemblies = ("063", "070", "072", "073")
    factors = []
    with (objects_dir / "objects.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            if row["mass_kg"] and not row["name"].startswith(assemblies):
                guess = estimated_mass(float(row["volume_m3"]), float(row["hull_volume_m3"]))
                factors.append(abs(np.log(guess / float(row["mass_kg"]))))
    assert len(factors) == 62
    assert np.exp(np.median(factors)) == pytest.approx(2.0, abs=0.05)
    assert np.exp(np.quantile(factors, 0.9)) == pytest.approx(3.9, abs=0.1)
