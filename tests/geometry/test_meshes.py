"""Loading meshes: every format gives the same solid, a sound one untouched, a mended one said so."""

from __future__ import annotations

import hashlib
import itertools
import json
import struct
import time
import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings, strategies as st

from packenv.errors import MeshError, UnitError
from packenv.geometry.mass import signed_volume
from packenv.geometry.meshes import make_item
from packenv.geometry.topology import is_solid
from tests.mesh_samples import (
    arrays,
    ball,
    block,
    cup,
    load_mesh,
    model_3mf,
    object_3mf,
    write_3mf,
    write_mesh,
    write_obj,
    write_ply,
)

QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
"""The faces of a block."""

FORMATS = ("stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "glb", "3mf")


def export(mesh, kind, folder):
    """A file written by trimesh, an engine of its own."""
    if kind == "ply_ascii":
        data = mesh.export(file_type="ply", encoding="ascii")
    elif kind == "3mf":
        scene = trimesh.Scene([mesh])
        scene.units = "meter"
        data = scene.export(file_type="3mf")
    else:
        data = mesh.export(file_type=kind)
    path = folder / f"thing.{kind.split('_')[0]}"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def assert_solid(mesh):
    assert is_solid(mesh.faces)[0]
    assert signed_volume(mesh.vertices, mesh.faces) > 0
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int64
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))


@pytest.mark.parametrize("shape", [block, ball, cup])
@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_solid(kind, shape, tmp_path):
    mesh = shape()
    # 3MF files by trimesh say millimetres whatever the scene's unit, and that unit counts.
    unit = "m" if kind == "3mf" else None
    found = load_mesh(export(mesh, kind, tmp_path), unit=unit)
    assert_solid(found)
    assert found.repairs == ()
    assert signed_volume(found.vertices, found.faces) == pytest.approx(mesh.volume, rel=1e-5)
    assert len(found.vertices) == len(mesh.vertices)
    assert len(found.faces) == len(mesh.faces)
    assert found.vertices.min(axis=0) == pytest.approx(mesh.bounds[0], abs=1e-7)
    assert found.vertices.max(axis=0) == pytest.approx(mesh.bounds[1], abs=1e-7)


@pytest.mark.parametrize("name", ["vase facet v2", "vertex 1 2 3", "facet", "endfacet", "solid", "3 vertex"])
@pytest.mark.parametrize("end", ["endsolid", "end solid", "EndSolid"])
def test_the_name_in_a_text_stl_may_hold_any_word(name, end, tmp_path):
    text = block().export(file_type="stl_ascii")
    lines = [f"solid {name}", *text.splitlines()[1:-1], f"{end} {name}"]
    for newline in ("\n", "\r\n", "\r"):
        path = tmp_path / "a.stl"
        path.write_bytes(newline.join(lines).encode())
        assert len(load_mesh(path).faces) == 12


@pytest.mark.parametrize("kind", ["stl_ascii", "obj", "off", "ply_ascii"])
def test_a_mark_of_utf8_is_passed_over(kind, tmp_path):
    path = export(block(), kind, tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(load_mesh(path).faces) == 12


def test_a_binary_stl_may_begin_with_solid_and_end_in_more(tmp_path):
    data = block().export(file_type="stl")
    path = tmp_path / "a.stl"
    path.write_bytes(b"solid facet".ljust(80) + data[80:] + b"a trailer")
    found = load_mesh(path)
    assert len(found.faces) == 12
    assert found.notes == ("9 bytes after the last triangle were ignored",)


@pytest.mark.parametrize("suffix", ["ply", "obj", "off"])
def test_a_sound_file_keeps_its_very_numbers(suffix, tmp_path):
    vertices, faces = arrays(cup())
    path = tmp_path / f"cup.{suffix}"
    if suffix == "ply":
        write_ply(path, vertices, faces)
    elif suffix == "obj":
        write_obj(path, vertices, faces)
    else:
        body = [" ".join(repr(float(x)) for x in v) for v in vertices]
        body += ["3 " + " ".join(map(str, f)) for f in faces.tolist()]
        path.write_text(f"OFF\n# made by hand\n{len(vertices)} {len(faces)} 0\n" + "\n".join(body))
    found = load_mesh(path)
    assert np.array_equal(found.vertices, vertices)
    assert np.array_equal(found.faces, faces)
    assert found.repairs == found.notes == ()


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**31))
def test_the_sequence_of_faces_and_vertices_plays_no_part(tmp_path, seed):
    rng = np.random.default_rng(seed)
    vertices, faces = arrays(cup())
    order = rng.permutation(len(vertices))
    turned = np.stack([np.roll(f, rng.integers(3)) for f in np.argsort(order)[faces]])
    found = load_mesh(write_ply(tmp_path / "cup.ply", vertices[order], rng.permutation(turned)))
    assert found.repairs == ()
    assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**31), share=st.floats(0.02, 0.98))
def test_any_mixed_winding_is_mended_to_the_same_solid(tmp_path, seed, share):
    rng = np.random.default_rng(seed)
    vertices, faces = arrays(cup())
    wrong = rng.random(len(faces)) < share
    mixed = np.where(wrong[:, None], faces[:, ::-1], faces)
    found = load_mesh(write_ply(tmp_path / "cup.ply", vertices, mixed))
    assert_solid(found)
    assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume)
    assert bool(found.repairs) == bool(wrong.any())


def test_a_mended_mesh_saved_again_needs_no_repair(tmp_path):
    vertices, faces = arrays(block(), ball(0.03, at=(0.05, 0, 0)))
    first = load_mesh(write_ply(tmp_path / "a.ply", vertices, faces[:, ::-1]))
    assert len(first.repairs) == 2
    second = load_mesh(write_ply(tmp_path / "b.ply", first.vertices, first.faces))
    assert second.repairs == ()
    assert np.array_equal(second.vertices, first.vertices)
    assert np.array_equal(second.faces, first.faces)


class TestUnits:
    @pytest.mark.parametrize(("unit", "factor"), [("m", 1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)])
    def test_a_unit_scales(self, unit, factor, tmp_path):
        vertices, faces = arrays(block(0.1, 0.2, 0.3))
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices / factor, faces), unit=unit)
        assert np.ptp(found.vertices, axis=0) == pytest.approx([0.1, 0.2, 0.3])

    @pytest.mark.parametrize(
        ("unit", "metres"),
        [
            ("micron", 1e-6),
            ("millimeter", 1e-3),
            ("centimeter", 0.01),
            ("inch", 0.0254),
            ("foot", 0.3048),
            ("meter", 1),
        ],
    )
    def test_3mf_states_its_own(self, unit, metres, tmp_path):
        path = tmp_path / "a.3mf"
        size = 0.12 / metres
        write_3mf(path, model_3mf(unit, [object_3mf(1, block(size, size, size))], ['<item objectid="1"/>']))
        assert np.ptp(load_mesh(path).vertices, axis=0) == pytest.approx([0.12] * 3)

    def test_3mf_without_one_is_millimetres(self, tmp_path):
        path = tmp_path / "a.3mf"
        model = model_3mf("x", [object_3mf(1, block(50, 60, 70))], ['<item objectid="1"/>'])
        write_3mf(path, model.replace(' unit="x"', ""))
        assert np.ptp(load_mesh(path).vertices, axis=0) == pytest.approx([0.05, 0.06, 0.07])

    def test_glb_is_metres_unless_told_otherwise(self, tmp_path):
        path = export(block(100, 60, 40), "glb", tmp_path)
        with pytest.raises(UnitError, match="--unit mm"):
            load_mesh(path)
        assert np.ptp(load_mesh(path, unit="mm").vertices, axis=0) == pytest.approx([0.1, 0.06, 0.04])

    def test_unknown(self, tmp_path):
        with pytest.raises(UnitError, match=r"'inch'.*m, cm, mm, in"):
            load_mesh(write_mesh(tmp_path / "a.ply", block()), unit="inch")


class TestScenes:
    def test_glb_parts_come_with_their_transforms(self, tmp_path):
        scene = trimesh.Scene()
        turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.01, 0.02, 0.03))
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        mirror[:3, 3] = (0.5, 0, 0)
        meshes = [cup(), block()]
        transforms = [turn, mirror]
        for k, (mesh, transform) in enumerate(zip(meshes, transforms, strict=True)):
            scene.add_geometry(mesh, node_name=f"n{k}", transform=transform)
        path = tmp_path / "s.glb"
        path.write_bytes(scene.export(file_type="glb"))
        found = load_mesh(path)
        assert_solid(found)
        assert found.repairs == ()
        assert found.notes == ("2 disjoint bodies: taken as one rigid item",)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(
            sum(m.volume for m in meshes), rel=1e-5
        )
        expected = np.concatenate(
            [np.array(m.vertices) @ t[:3, :3].T + t[:3, 3] for m, t in zip(meshes, transforms, strict=True)]
        )
        assert found.vertices.min(axis=0) == pytest.approx(expected.min(axis=0), abs=1e-6)
        assert found.vertices.max(axis=0) == pytest.approx(expected.max(axis=0), abs=1e-6)

    def test_glb_node_transforms_are_nested(self, tmp_path):
        path = tmp_path / "s.glb"
        mesh = block()
        nodes = [
            {"children": [1], "translation": [1.0, 0, 0], "scale": [2, 2, 2]},
            {"mesh": 0, "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "translation": [0, 0.1, 0]},
        ]
        write_glb(path, mesh.vertices, [(mesh.faces, 4)], nodes)
        found = load_mesh(path)
        assert found.vertices.mean(axis=0) == pytest.approx([1.0, 0.2, 0], abs=1e-6)
        assert np.ptp(found.vertices, axis=0) == pytest.approx([0.12, 0.2, 0.08], abs=1e-6)

    def test_glb_strips_are_read_and_fans_refused(self, tmp_path):
        """A tetrahedron as one strip: 1/6 of the cube of the edge."""
        path = tmp_path / "s.glb"
        corners = np.vstack([np.zeros(3), np.eye(3)]) * 0.06
        write_glb(path, corners, [([0, 2, 1, 3, 0, 2], 5)], [{"mesh": 0}])
        found = load_mesh(path)
        assert found.repairs == ()
        assert signed_volume(found.vertices, found.faces) == pytest.approx(0.06**3 / 6)
        tips = np.vstack([np.eye(3), -np.eye(3)]) * 0.06
        fans = [([2, 0, 1, 3, 4, 0], 6), ([5, 0, 4, 3, 1, 0], 6)]
        write_glb(path, tips, fans, [{"mesh": 0}])
        with pytest.raises(MeshError, match=r"s\.glb: points, lines or triangle fans are not read; export"):
            load_mesh(path)

    @pytest.mark.parametrize(
        ("nodes", "word"),
        [
            ([{"camera": 0, "mesh": 0, "children": [1]}, {"mesh": 0}], "camera"),
            ([{"mesh": 1, "children": [1]}, {"mesh": 0}], "points, lines"),
        ],
    )
    def test_glb_parts_below_a_camera_or_below_lines_are_refused(self, nodes, word, tmp_path):
        """The library leaves them out without a word."""
        path = tmp_path / "s.glb"
        mesh = block()
        triangles = {"attributes": {"POSITION": 0}, "indices": 1}
        meshes = [{"primitives": [triangles]}, {"primitives": [{"attributes": {"POSITION": 0}, "mode": 3}]}]
        lens = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
        write_glb(path, mesh.vertices, [(mesh.faces, 4)], nodes, meshes=meshes[: len(nodes)], cameras=[lens])
        with pytest.raises(MeshError, match=word):
            load_mesh(path)

    def test_glb_may_hold_a_camera_beside_its_parts(self, tmp_path):
        path = tmp_path / "s.glb"
        lens = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
        changes = {"cameras": [lens], "scenes": [{"nodes": [0, 1]}]}
        write_glb(path, block().vertices, [(block().faces, 4)], [{"camera": 0}, {"mesh": 0}], **changes)
        assert len(load_mesh(path).faces) == 12

    def test_3mf_components_of_components_are_all_there(self, tmp_path):
        """Every level holds the one below twice: 2 to the 5th bodies."""
        path = tmp_path / "a.3mf"
        levels = [
            f'<object id="{k + 1}"><components><component objectid="{k}"/><component objectid="{k}" '
            f'transform="1 0 0 0 1 0 0 0 1 {20 * 2 ** (k - 1)} 0 0"/></components></object>'
            for k in range(1, 6)
        ]
        items = ['<item objectid="6"/>']
        write_3mf(path, model_3mf("millimeter", [object_3mf(1, block(10, 10, 10)), *levels], items))
        found = load_mesh(path)
        assert found.notes == ("32 disjoint bodies: taken as one rigid item",)
        assert np.ptp(found.vertices, axis=0) == pytest.approx([0.63, 0.01, 0.01])

    def test_3mf_components_are_nested_and_the_build_decides(self, tmp_path):
        path = tmp_path / "a.3mf"
        group = (
            '<object id="7"><components>'
            '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 0"/>'
            '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 100 0 0"/></components></object>'
        )
        unused = object_3mf(3, block(500, 500, 500))
        items = ['<item objectid="7" transform="1 0 0 0 1 0 0 0 1 5 6 7"/>']
        write_3mf(path, model_3mf("millimeter", [object_3mf(1, block(40, 20, 10)), unused, group], items))
        found = load_mesh(path)
        assert found.notes == ("2 disjoint bodies: taken as one rigid item",)
        # The second copy is turned by 90° about z, then moved: 20 wide in x about x = 105.
        assert found.vertices.min(axis=0) == pytest.approx([-0.015, -0.014, 0.002])
        assert found.vertices.max(axis=0) == pytest.approx([0.115, 0.026, 0.012])

    def test_3mf_whose_relations_name_the_model(self, tmp_path):
        path = tmp_path / "a.3mf"
        model = model_3mf("millimeter", [object_3mf(1, block(40, 20, 10))], ['<item objectid="1"/>'])
        kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
        relations = (
            '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
            f'<Relationship Target="/3D/Main.model" Id="r" Type="{kind}"/></Relationships>'
        )
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("_rels/.rels", relations)
            archive.writestr("3D/Main.model", model)
        assert np.ptp(load_mesh(path).vertices, axis=0) == pytest.approx([0.04, 0.02, 0.01])

    def test_3mf_pieces_of_one_part_number_are_all_there(self, tmp_path):
        path = tmp_path / "a.3mf"
        items = [
            f'<item objectid="1" partnumber="7" transform="1 0 0 0 1 0 0 0 1 {x} 0 0"/>' for x in (0, 100)
        ]
        write_3mf(path, model_3mf("millimeter", [object_3mf(1, block(40, 20, 10))], items))
        assert np.ptp(load_mesh(path).vertices, axis=0) == pytest.approx([0.14, 0.02, 0.01])


class TestPly:
    @pytest.mark.parametrize("order", ["<", ">"])
    @pytest.mark.parametrize("mixed", [False, True])
    def test_binary_with_other_properties_elements_and_polygons(self, order, mixed, tmp_path):
        """What the format allows around the part that counts; lists of one length in each column."""
        vertices = np.array(block().vertices)
        faces = QUADS if not mixed else [*QUADS[:5], [1, 5, 7], [1, 7, 3]]
        name = {"<": "little", ">": "big"}[order]
        header = (
            f"ply\nformat binary_{name}_endian 1.0\ncomment hello\n"
            "element camera 2\nproperty float f\nproperty list uchar short ids\n"
            f"element vertex {len(vertices)}\nproperty uchar red\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(faces)}\nproperty uchar flag\n"
            "property list uchar uint vertex_index\nproperty float quality\n"
            "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
        )
        body = 2 * struct.pack(order + "fBhh", 1.5, 2, 7, 8)
        for v in vertices:
            body += struct.pack(order + "Bddd", 9, *v)
        for f in faces:
            body += struct.pack(order + f"BB{len(f)}If", 1, len(f), *f, 0.5)
        body += struct.pack(order + "ii", 3, 4)
        path = tmp_path / "a.ply"
        path.write_bytes(header.encode() + body)
        if mixed:
            with pytest.raises(MeshError, match="different lengths; export triangles"):
                load_mesh(path)
            return
        found = load_mesh(path)
        assert_solid(found)
        assert len(found.faces) == 12
        assert np.array_equal(found.vertices, vertices)

    def test_text_with_other_properties_elements_and_polygons(self, tmp_path):
        vertices = np.array(block().vertices)
        faces = [*QUADS[:5], [1, 5, 7], [1, 7, 3]]
        header = (
            "ply\nformat ascii 1.0\ncomment hello\nelement camera 2\nproperty list uchar short ids\n"
            "property float f\nelement vertex 8\nproperty uchar red\nproperty double x\n"
            "property double y\nproperty double z\nelement face 7\nproperty uchar flag\n"
            "property list uchar uint vertex_index\nproperty list uchar float texcoord\nend_header\n"
        )
        rows = ["0 1.5", "2 7 8 1.5", *(f"9 {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist())]
        rows += [f"1 {len(f)} {' '.join(map(str, f))} 2 0.5 0.5" for f in faces]
        path = tmp_path / "a.ply"
        path.write_text(header + "\n\n".join(rows))
        found = load_mesh(path)
        assert_solid(found)
        assert np.array_equal(found.vertices, vertices)
        fans = [[f[0], b, c] for f in faces for b, c in itertools.pairwise(f[1:])]
        assert found.faces.tolist() == fans


class TestDents:
    """A fan of triangles from one corner covers a polygon without dents, and some others."""

    @staticmethod
    def prism(first):
        """An L that is extruded, its polygons beginning at a corner; two of them see it whole."""
        ell = np.array([[2, 1], [1, 1], [1, 2], [0, 2], [0, 0], [2, 0]]) * 0.05
        low, high = np.column_stack([ell, np.zeros(6)]), np.column_stack([ell, np.full(6, 0.05)])
        ring = np.roll(np.arange(6), -first).tolist()
        sides = [[k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6)]
        return np.concatenate([low, high]), [[ring[0], *ring[:0:-1]], [6 + k for k in ring], *sides]

    @pytest.mark.parametrize("kind", ["ply", "obj", "off"])
    @pytest.mark.parametrize("first", range(6))
    def test_a_polygon_is_covered_once_or_refused(self, kind, first, tmp_path):
        vertices, faces = self.prism(first)
        path = tmp_path / f"ell.{kind}"
        if kind == "ply":
            write_ply(path, vertices, faces)
        elif kind == "obj":
            write_obj(path, vertices, faces)
        else:
            rows = [" ".join(map(repr, v)) for v in vertices.tolist()]
            rows += [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
            path.write_text("OFF\n12 8 0\n" + "\n".join(rows))
        if first not in (1, 4):
            with pytest.raises(MeshError, match=r"2 dented \(non-convex\) faces; triangulate"):
                load_mesh(path)
            return
        found = load_mesh(path)
        top = found.faces[(found.vertices[found.faces][:, :, 2] == 0.05).all(axis=1)]
        a, b, c = (found.vertices[top[:, k], :2] for k in range(3))
        areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
        assert (areas > -1e-12).all()
        assert areas.sum() == pytest.approx(3 * 0.05**2)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(3 * 0.05**3)

    def test_in_a_binary_ply_too(self, tmp_path):
        """Every polygon of an arrowhead's prism has four corners; the dent and the tip see it whole."""
        flat = np.array([[0, 0], [2, -1], [0.5, 0], [2, 1]]) * 0.05
        vertices = np.concatenate([np.column_stack([flat, np.full(4, z)]) for z in (0.0, 0.05)])
        sides = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
        header = (
            "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty double x\nproperty double y\n"
            "property double z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n"
        )
        path = tmp_path / "a.ply"
        for turn, read in ((0, True), (1, False)):
            ring = np.roll(np.arange(4), -turn).tolist()
            faces = [[ring[0], *ring[:0:-1]], [4 + k for k in ring], *sides]
            body = b"".join(struct.pack("<B4i", 4, *f) for f in faces)
            path.write_bytes(header.encode() + vertices.astype("<f8").tobytes() + body)
            if read:
                found = load_mesh(path)
                assert signed_volume(found.vertices, found.faces) == pytest.approx(0.5 * 0.05**3)
            else:
                with pytest.raises(MeshError, match="2 dented"):
                    load_mesh(path)

    def test_corners_on_one_line_are_no_dent(self, tmp_path):
        """A square with the middles of its edges, off their line by rounding."""
        ring = np.array([[0, 0], [1, 1e-9], [2, 0], [2 - 1e-9, 1], [2, 2], [1, 2], [0, 2], [1e-9, 1]]) * 0.05
        vertices = np.concatenate([np.column_stack([ring, np.full(8, z)]) for z in (0.0, 0.05)])
        for first in range(8):
            turned = np.roll(np.arange(8), first).tolist()
            faces = [turned[::-1], [8 + k for k in turned]]
            faces += [[k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k] for k in range(8)]
            found = load_mesh(write_obj(tmp_path / "a.obj", vertices, faces))
            assert signed_volume(found.vertices, found.faces) == pytest.approx(4 * 0.05**3, rel=1e-6)


class TestObj:
    def test_everything_but_vertices_and_faces_is_passed_over(self, tmp_path):
        vertices = np.array(block().vertices)
        quads = QUADS
        lines = ["# a comment", "mtllib none.mtl", "o thing", "vn 0 0 1", "vt 0 0", "s off"]
        lines += [f"v {x!r} {y!r} {z!r} 0.5 0.5 0.5" for x, y, z in vertices.tolist()]
        lines += ["usemtl none", "l 1 2"]
        lines += ["f " + " ".join(f"{k - 8}/1/1" for k in quads[0]) + " # back from the end"]
        lines += ["f " + " ".join(f"{k + 1}//1" for k in q) for q in quads[1:-1]]
        last = [f"{k + 1}" for k in quads[-1]]
        lines += ["\tf " + " ".join(last[:2]) + " \\", " ".join(last[2:])]
        path = tmp_path / "a.obj"
        path.write_text("\r\n".join(lines), newline="")
        found = load_mesh(path)
        assert_solid(found)
        assert np.array_equal(found.vertices, vertices)


class TestRepairs:
    def test_inverted(self, tmp_path):
        vertices, faces = arrays(cup())
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices, faces[:, ::-1]))
        assert_solid(found)
        assert found.repairs == ("turned inside out (the faces pointed inward)",)

    @pytest.mark.parametrize("which", [0, 7, 500])
    def test_one_missing_triangle(self, which, tmp_path):
        mesh = ball()
        vertices, faces = arrays(mesh)
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices, np.delete(faces, which, axis=0)))
        assert_solid(found)
        # The triangle that went is the only one that fits.
        assert signed_volume(found.vertices, found.faces) == pytest.approx(mesh.volume)
        assert len(found.repairs) == 1
        assert found.repairs[0].startswith("1 hole closed, up to ")

    def test_holes_that_touch_in_a_vertex(self, tmp_path):
        mesh = ball()
        vertices, faces = arrays(mesh)
        about = np.flatnonzero((faces == 30).any(axis=1))
        gone = about[:1].tolist()
        gone += [k for k in about[1:] if len(set(faces[k]) & set(faces[gone[0]])) == 1][:1]
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices, np.delete(faces, gone, axis=0)))
        assert_solid(found)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(mesh.volume)
        assert "2 holes closed" in found.repairs[0]

    def test_a_slit_is_closed_exactly(self, tmp_path):
        """An edge divided on one side only: the hole is long but has no area."""
        vertices, faces = arrays(block())
        middle = vertices[faces[0, :2]].mean(axis=0)
        a, b, c = faces[0]
        divided = np.concatenate([faces[1:], [[a, len(vertices), c], [len(vertices), b, c]]])
        found = load_mesh(write_ply(tmp_path / "a.ply", np.vstack([vertices, middle]), divided))
        assert is_solid(found.faces)[0]
        assert signed_volume(found.vertices, found.faces) == pytest.approx(block().volume)
        assert found.repairs[0].startswith("1 hole closed")

    @pytest.mark.parametrize("shared", [True, False])
    @pytest.mark.parametrize("turned", [True, False])
    def test_duplicate_shell(self, shared, turned, tmp_path):
        vertices, faces = arrays(cup())
        again = faces[:, ::-1] if turned else faces
        if shared:
            twice = vertices, np.concatenate([faces, again])
        else:
            twice = np.concatenate([vertices, vertices]), np.concatenate([faces, again + len(vertices)])
        found = load_mesh(write_ply(tmp_path / "a.ply", *twice))
        assert_solid(found)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume)
        assert len(found.repairs) == 1
        assert "duplicate shell" in found.repairs[0]

    def test_duplicate_shell_in_a_format_without_shared_vertices(self, tmp_path):
        mesh = trimesh.Trimesh(*arrays(cup(), cup()), process=False)
        found = load_mesh(export(mesh, "stl", tmp_path))
        assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume, rel=1e-5)
        assert found.repairs == ("duplicate shell dropped",)

    def test_overlapping_bodies(self, tmp_path):
        """Two boxes that share a cube: the union's volume in closed form."""
        one, two = block(0.1, 0.1, 0.1), block(0.1, 0.1, 0.1, at=(0.06, 0.05, 0.04))
        found = load_mesh(write_mesh(tmp_path / "a.ply", one, two))
        assert_solid(found)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(2e-3 - 0.04 * 0.05 * 0.06)
        assert found.repairs == ("2 overlapping bodies united",)
        assert found.notes == ()

    def test_a_body_within_a_solid_is_swallowed(self, tmp_path):
        found = load_mesh(write_mesh(tmp_path / "a.ply", block(), ball(0.01)))
        assert signed_volume(found.vertices, found.faces) == pytest.approx(block().volume)
        assert found.repairs == ("2 overlapping bodies united",)

    def test_one_inverted_body_of_two(self, tmp_path):
        other = block(at=(0.3, 0, 0))
        other.invert()
        found = load_mesh(write_mesh(tmp_path / "a.ply", cup(), other))
        assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume + block().volume)
        assert found.repairs == ("1 body turned inside out (the faces pointed inward)",)

    @pytest.mark.parametrize("shift", [(0.08, 0.08, 0.0), (0.08, 0.08, 0.08)])
    def test_an_inverted_body_that_touches_in_an_edge_or_a_vertex(self, shift, tmp_path):
        other = block(0.06, 0.06, 0.06, at=shift)
        other.invert()
        mesh = trimesh.Trimesh(*arrays(block(0.1, 0.1, 0.1), other), process=False)
        corner = np.array(mesh.vertices)
        corner[8:] = np.where(np.isclose(corner[8:], 0.05), 0.05, corner[8:])
        if shift[2] == 0.0:
            corner[8:, 2] *= 0.1 / 0.06
        merged = trimesh.Trimesh(corner, mesh.faces, process=False)
        merged.merge_vertices()
        assert len(merged.vertices) < 16
        path = write_ply(tmp_path / "a.ply", np.array(merged.vertices), np.array(merged.faces))
        found = load_mesh(path)
        assert is_solid(found.faces)[0]
        expected = 1e-3 + 0.06 * 0.06 * (0.1 if shift[2] == 0.0 else 0.06)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(expected)
        assert found.repairs == ("1 body turned inside out (the faces pointed inward)",)

    @pytest.mark.parametrize("inverted", [False, True])
    def test_a_cavity_stays_one_even_in_a_file_inside_out(self, inverted, tmp_path):
        inner = ball(0.03)
        inner.invert()
        vertices, faces = arrays(ball(0.05), inner)
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices, faces[:, ::-1] if inverted else faces))
        assert signed_volume(found.vertices, found.faces) == pytest.approx(
            ball(0.05).volume - ball(0.03).volume
        )
        assert found.notes == ("1 closed cavity inside",)
        assert bool(found.repairs) == inverted

    def test_specks_are_dropped(self, tmp_path):
        sheet = np.array([[0.2, 0, 0], [0.2005, 0, 0], [0.2, 0.0005, 0]])
        vertices, faces = arrays(block())
        n = len(vertices)
        faces = np.concatenate([faces, [[n, n + 1, n + 2], [n, n + 2, n + 1]]])
        path = write_ply(tmp_path / "a.ply", np.concatenate([vertices, sheet]), faces)
        found = load_mesh(path)
        assert_solid(found)
        assert np.ptp(found.vertices, axis=0) == pytest.approx([0.1, 0.06, 0.04])
        assert len(found.repairs) == 1

    def test_the_wall_between_two_joined_boxes_goes(self, tmp_path):
        one, two = block(0.1, 0.1, 0.1), block(0.1, 0.1, 0.1, at=(0.1, 0, 0))
        mesh = trimesh.Trimesh(*arrays(one, two), process=False)
        mesh.merge_vertices()
        # Give both the same diagonal on the common wall.
        wall = (mesh.triangles[:, :, 0] == 0.05).all(axis=1)
        first, second = np.flatnonzero(wall)[:2], np.flatnonzero(wall)[2:]
        faces = np.array(mesh.faces)
        faces[second] = faces[first][:, ::-1]
        found = load_mesh(write_ply(tmp_path / "a.ply", np.array(mesh.vertices), faces))
        assert_solid(found)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(2e-3)

    def test_vertices_that_nearly_meet_are_merged_to_close(self, tmp_path):
        vertices, faces = arrays(cup())
        soup = vertices[faces].reshape(-1, 3) + np.random.default_rng(1).normal(0, 1e-9, (3 * len(faces), 3))
        found = load_mesh(write_ply(tmp_path / "a.ply", soup, np.arange(len(soup)).reshape(-1, 3)))
        assert_solid(found)
        assert len(found.vertices) == len(vertices)
        assert "merged" in found.repairs[0]


class TestNotes:
    def test_disjoint_bodies_are_one_item(self, tmp_path):
        found = load_mesh(write_mesh(tmp_path / "a.ply", cup(), block(at=(0.2, 0, 0))))
        assert found.repairs == ()
        assert found.notes == ("2 disjoint bodies: taken as one rigid item",)

    def test_nested_but_disjoint(self, tmp_path):
        """A ball in a cup: the boxes meet, the solids do not."""
        vertices, faces = arrays(cup(), ball(0.01, at=(0, 0, 0.06)))
        found = load_mesh(write_ply(tmp_path / "a.ply", vertices, faces))
        assert found.repairs == ()
        assert np.array_equal(found.vertices, vertices)
        assert np.array_equal(found.faces, faces)

    def test_content_that_is_not_what_the_name_says(self, tmp_path):
        path = tmp_path / "cup.stl"
        write_mesh(path, cup())
        found = load_mesh(path)
        assert signed_volume(found.vertices, found.faces) == pytest.approx(cup().volume)
        assert found.notes == ("the content is PLY although the name ends in .stl",)

    def test_stray_vertices(self, tmp_path):
        vertices, faces = arrays(block())
        found = load_mesh(write_ply(tmp_path / "a.ply", np.vstack([vertices, [[9, 9, 9]]]), faces))
        assert len(found.vertices) == 8
        assert found.notes == ("1 vertices without a face ignored",)


class TestItem:
    def test_given_mass(self, tmp_path):
        mesh = load_mesh(write_mesh(tmp_path / "a.ply", block(at=(1, 0, 0))))
        item = make_item("a", mesh, file="a.ply", mass=0.24)
        assert item.mass == 0.24
        assert not item.mass_estimated
        assert item.com == pytest.approx([1, 0, 0])
        assert np.diag(item.inertia) == pytest.approx(
            [0.02 * (0.06**2 + 0.04**2), 0.02 * (0.1**2 + 0.04**2), 0.02 * (0.1**2 + 0.06**2)]
        )
        assert item.extents == pytest.approx([0.1, 0.06, 0.04])

    def test_missing_mass_is_estimated_and_says_so(self, tmp_path):
        mesh = load_mesh(write_mesh(tmp_path / "a.ply", block()))
        item = make_item("a", mesh, file="a.ply", mass=None)
        assert item.mass_estimated
        assert item.mass == pytest.approx(370 * block().volume)

    def test_grams_are_suspected(self, tmp_path):
        mesh = load_mesh(write_mesh(tmp_path / "a.ply", block()))
        assert any("grams" in note for note in make_item("a", mesh, file="a.ply", mass=240.0).notes)

    @pytest.mark.parametrize("mass", [0.0, -1.0, float("nan"), float("inf")])
    def test_no_mass(self, mass, tmp_path):
        mesh = load_mesh(write_mesh(tmp_path / "a.ply", block()))
        with pytest.raises(MeshError, match="item a: its mass"):
            make_item("a", mesh, file="a.ply", mass=mass)

    def test_the_hash_is_of_the_mesh_as_used(self, tmp_path):
        vertices, faces = arrays(block())
        item = make_item(
            "a", load_mesh(write_ply(tmp_path / "a.ply", vertices, faces)), file="a.ply", mass=1.0
        )
        head = f"mesh <f8 ({len(vertices)}, 3) <i8 ({len(faces)}, 3)\n".encode()
        assert item.sha256 == hashlib.sha256(head + vertices.tobytes() + faces.tobytes()).hexdigest()
        same = load_mesh(write_obj(tmp_path / "b.obj", vertices, faces))
        assert make_item("b", same, file="b.obj", mass=2.0).sha256 == item.sha256
        moved = load_mesh(write_ply(tmp_path / "c.ply", vertices * (1 + 1e-15), faces))
        assert make_item("c", moved, file="c.ply", mass=1.0).sha256 != item.sha256


@pytest.mark.objects
def test_the_scanned_items_load_untouched(objects_dir):
    import csv

    bodies = {}
    with (objects_dir / "objects.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            path = objects_dir / row["file"]
            found = load_mesh(path)
            assert found.repairs == (), path
            assert (len(found.vertices), len(found.faces)) == (int(row["n_vertices"]), int(row["n_faces"]))
            assert signed_volume(found.vertices, found.faces) == pytest.approx(
                float(row["volume_m3"]), rel=1e-5
            )
            bodies[row["name"]] = (int(row["n_bodies"]), found.notes)
    assert len(bodies) == 94
    for name, (n, notes) in bodies.items():
        assert notes == ((f"{n} disjoint bodies: taken as one rigid item",) if n > 1 else ()), name


@pytest.mark.objects
def test_loading_a_scan_is_quick(objects_dir):
    path = objects_dir / "ycb_025_mug.ply"
    load_mesh(path)
    times = []
    for _ in range(7):
        start = time.process_time()
        load_mesh(path)
        times.append(time.process_time() - start)
    # About 16 ms; the bound leaves room for a machine that is busy.
    assert min(times) < 0.05


def write_glb(path, vertices, runs, nodes, **changes):
    """A GLB of one mesh: ``runs`` are (indices, glTF mode) of its primitives; ``changes`` replace tables."""
    points = np.array(vertices, dtype="<f4").tobytes()
    indices = [np.array(run, dtype="<u2").reshape(-1) for run, _ in runs]
    binary = points + b"".join(run.tobytes() for run in indices)
    starts = np.cumsum([0, *(2 * len(run) for run in indices)]).tolist()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "indices": k, "mode": mode}
                    for k, (_, mode) in enumerate(runs, start=1)
                ]
            }
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            *(
                {
                    "bufferView": 1,
                    "byteOffset": start,
                    "componentType": 5123,
                    "count": len(run),
                    "type": "SCALAR",
                }
                for start, run in zip(starts, indices, strict=False)
            ),
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(binary) - len(points)},
        ],
        "buffers": [{"byteLength": len(binary)}],
    } | changes
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A)
        + text
        + struct.pack("<II", len(binary), 0x004E4942)
        + binary
    )
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
