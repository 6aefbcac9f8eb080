"""Odd files are read as they were meant, or it is said what is odd about them; values in closed form."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh

from packenv.errors import MeshError, UnitError
from packenv.geometry.mass import impossible, signed_volume, solid_properties
from tests.mesh_samples import arrays, ball, block, cup, load_mesh, write_mesh, write_obj, write_ply

BRICK = 0.06 * 0.04 * 0.03
"""m³ of a block of 60 x 40 x 30 mm."""


def brick():
    return block(0.06, 0.04, 0.03)


class TestStl:
    def test_bytes_of_attributes_are_passed_over(self, tmp_path):
        """The last field of a triangle says how many bytes follow it; here none, 6, or 250."""
        data = brick().export(file_type="stl")
        records = [data[84 + 50 * k : 84 + 50 * k + 48] for k in range(12)]
        sizes = [0, 6, 250] * 4
        body = b"".join(r + struct.pack("<H", n) + b"x" * n for r, n in zip(records, sizes, strict=True))
        path = tmp_path / "a.stl"
        path.write_bytes(data[:84] + body)
        found = load_mesh(path)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(BRICK)
        assert found.notes == ("1,024 bytes of attributes were ignored",)
        path.write_bytes(data[:84] + body[:-1])
        with pytest.raises(MeshError):
            load_mesh(path)

    def test_text_without_endsolid_is_whole_where_it_is_closed(self, tmp_path):
        text = cup().export(file_type="stl_ascii")
        end = text.rindex("endfacet") + len("endfacet")
        path = tmp_path / "a.stl"
        path.write_text(text[:end])
        found = load_mesh(path)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume, rel=1e-5)
        path.write_text(text[: text.rindex("endfacet", 0, end - 8) + len("endfacet")])
        with pytest.raises(MeshError, match="truncated"):
            load_mesh(path)

    @pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
    @pytest.mark.parametrize("kind", ["stl_ascii", "obj", "off"])
    def test_text_in_another_encoding(self, kind, encoding, tmp_path):
        path = tmp_path / f"a.{kind.partition('_')[0]}"
        path.write_bytes(brick().export(file_type=kind).encode(encoding))
        found = load_mesh(path)
        assert len(found.vertices) == 8
        assert signed_volume(found.vertices, found.faces) == pytest.approx(BRICK)


@pytest.mark.parametrize("faces", ["", "element face 0\nproperty list uchar int vertex_indices\n"])
def test_ply_triangle_strips_are_named(faces, tmp_path):
    points = "\n".join(f"{x} {y} {z}" for x, y, z in np.vstack([np.zeros(3), np.eye(3)]))
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        f"{faces}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{points}\n6 0 2 1 3 0 2\n"
    )
    with pytest.raises(MeshError, match=r"triangle strips \(tristrips\); export it with faces"):
        load_mesh(path)


class TestUnits:
    @pytest.mark.parametrize(("size", "word"), [(1.5, "in makes it 0.0381 m"), (1.8, "cm makes it 0.018 m")])
    def test_a_long_item_is_suspicious_where_nobody_said_metres(self, size, word, tmp_path):
        path = write_mesh(tmp_path / "a.ply", block(size, 1.0, 0.5))
        (note,) = load_mesh(path).notes
        assert note.startswith(f"suspicious: {size} m if its numbers are metres")
        assert word in note
        assert load_mesh(path, unit="m").notes == ()

    def test_every_unit_that_fits_is_named(self, tmp_path):
        path = write_mesh(tmp_path / "a.ply", block(1.5, 1.0, 0.5))
        with pytest.raises(UnitError, match=r"--unit m makes it 1\.5 m, cm makes .*, in makes it 0\.0381 m"):
            load_mesh(path, unit="mm")


class TestFarFromTheOrigin:
    """Single precision has 24 bits: at 2,000 m its steps are 0.12 mm."""

    @pytest.mark.parametrize(
        ("far", "words"),
        [
            (2_000.0, "2e+03 m from the origin, where single precision is 0.12 mm coarse"),
            (30_000.0, "3e+04 m from the origin, where single precision is 2 mm coarse"),
            (300_000.0, "3e+05 m from the origin, where single precision is 31 mm coarse"),
        ],
    )
    @pytest.mark.parametrize("suffix", ["stl", "obj"])
    def test_it_is_said(self, suffix, far, words, tmp_path):
        """Whether or not what is left of the shape is still closed."""
        mesh = ball(0.03)
        mesh.apply_translation((far, 0, 0))
        vertices, faces = arrays(mesh)
        mesh = trimesh.Trimesh(vertices.astype(np.float32).astype(float), faces, process=False)
        path = tmp_path / f"a.{suffix}"
        if suffix == "obj":
            write_obj(path, np.array(mesh.vertices), faces)
        else:
            path.write_bytes(mesh.export(file_type=suffix))
        try:
            said = " ".join(load_mesh(path).notes)
        except MeshError as problem:
            said = str(problem)
        assert words in said
        assert "move it to the origin" in said

    def test_double_precision_has_lost_nothing(self, tmp_path):
        vertices, faces = arrays(ball(0.03))
        path = write_ply(tmp_path / "a.ply", vertices + np.array([2000.0, 0, 0]), faces)
        assert load_mesh(path).notes == ()


class TestImpossible:
    """A prism over a bow tie: the right triangle is wound the other way and counts below zero."""

    @staticmethod
    def bow_tie(right):
        corners = np.array([[-1, -1], [right, right], [right, -right], [-1, 1]]) * 0.05
        n = len(corners)
        points = np.vstack([np.column_stack([corners, np.full(n, z)]) for z in (0.0, 0.1)])
        faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
        for k in range(n):
            m = (k + 1) % n
            faces += [[k, m, n + m], [k, n + m, n + k]]
        return points, np.array(faces)

    @pytest.mark.parametrize("right", [0.9, 0.8, 0.6])
    def test_centre_of_mass_outside_the_hull(self, right, tmp_path):
        """The areas are 1 and -r², their centroids at -2/3 and 2r/3: (-2/3)(1 + r³) / (1 - r²)."""
        points, faces = self.bow_tie(right)
        solid = solid_properties(points, faces)
        expected = -2 / 3 * (1 + right**3) / (1 - right**2)
        assert solid.com[0] / 0.05 == pytest.approx(expected)
        path = write_ply(tmp_path / "a.ply", points, faces)
        if expected < -1:
            with pytest.raises(MeshError, match=r"centre of mass lies .* mm outside.*Remesh"):
                load_mesh(path)

    def test_more_than_the_hull(self):
        """A ball's surface that is passed twice encloses its volume twice."""
        vertices, faces = arrays(ball())
        solid = solid_properties(vertices, np.vstack([faces, faces]))
        assert impossible(vertices, solid) == "it encloses more than its convex hull"

    def test_moments_of_no_mass(self):
        """A block less eight balls in its corners, each outside the rest: moments below zero, centre inside."""
        small = []
        for corner in np.array(brick().vertices):
            one = ball(0.0125, at=tuple(corner))
            one.invert()
            small.append(one)
        mesh = trimesh.util.concatenate([brick(), *small])
        vertices, faces = arrays(mesh)
        assert signed_volume(vertices, faces) > 0
        solid = solid_properties(vertices, faces)
        assert np.linalg.eigvalsh(solid.inertia)[0] < 0
        assert impossible(vertices, solid) == "its moments of inertia are those of no mass"

    @pytest.mark.parametrize(
        "shape", [brick, ball, cup, lambda: block(0.3, 0.2, 1e-5), lambda: block(0.3, 1e-4, 1e-4)]
    )
    def test_sound_solids_are_possible_anywhere(self, shape):
        vertices, faces = arrays(shape())
        for shift in (0.0, 1000.0):
            assert impossible(vertices + shift, solid_properties(vertices + shift, faces)) is None
