"""Every bad input ends in one line that names the file or value: never a traceback, never a wrong mesh."""

from __future__ import annotations

import gzip
import io
import json
import struct
import tarfile
import time
import zipfile

import numpy as np
import pytest

from packenv.errors import CatalogueError, InputError, MeshError, OrderError, UnitError
from packenv.geometry.mass import signed_volume
from packenv.geometry.topology import is_solid
from packenv.io.orders import read_order
from packenv.items.catalogue import open_catalogue
from tests.mesh_samples import arrays, ball, block, cup, load_mesh, write_mesh, write_obj, write_ply

SUFFIXES = ("stl", "obj", "ply", "off", "glb", "3mf")


def refused(call, *words, error=InputError):
    """The message of the error that a call must end in."""
    with pytest.raises(error) as problem:
        call()
    message = str(problem.value)
    assert "\n" not in message
    assert 20 < len(message) < 500
    for word in words:
        assert str(word) in message
    return message


def good(suffix):
    """Bytes of a sound file of a kind, written by another engine."""
    data = cup().export(file_type=suffix)
    return data.encode() if isinstance(data, str) else data


class TestFiles:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_missing(self, suffix, tmp_path):
        path = tmp_path / f"none.{suffix}"
        refused(lambda: load_mesh(path), path, "no such file", error=MeshError)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_empty(self, suffix, tmp_path):
        path = tmp_path / f"a.{suffix}"
        path.touch()
        refused(lambda: load_mesh(path), path, "is empty", error=MeshError)

    def test_a_folder(self, tmp_path):
        path = tmp_path / "a.ply"
        path.mkdir()
        refused(lambda: load_mesh(path), path, "not a file", error=MeshError)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("share", [0.0005, 0.01, 0.3, 0.6, 0.97])
    def test_truncated(self, suffix, share, tmp_path):
        data = good(suffix)
        path = tmp_path / f"a.{suffix}"
        path.write_bytes(data[: int(len(data) * share) + 1])
        refused(lambda: load_mesh(path, unit="m"), path, error=MeshError)

    @pytest.mark.parametrize("keep", [83, 84, 85, 133, 134, 135])
    def test_stl_cut_anywhere(self, keep, tmp_path):
        path = tmp_path / "a.stl"
        path.write_bytes(good("stl")[:keep])
        refused(lambda: load_mesh(path), path, error=MeshError)

    def test_text_stl_cut_between_facets(self, tmp_path):
        text = cup().export(file_type="stl_ascii")
        path = tmp_path / "a.stl"
        path.write_text(text[: text.rindex("endfacet", 0, text.rindex("endfacet")) + 8])
        refused(lambda: load_mesh(path), path, "truncated", error=MeshError)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_garbage(self, suffix, tmp_path):
        path = tmp_path / f"a.{suffix}"
        for seed in range(20):
            path.write_bytes(np.random.default_rng(seed).bytes(5000))
            refused(lambda: load_mesh(path), path, error=MeshError)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize(
        "text",
        [
            "hello world\n",
            "<html><body>Not found</body></html>",
            '{"asset": {}}',
            "v\nf\n",
            "\n\n\n",
            "OFF\n",
        ],
    )
    def test_text_that_is_no_mesh(self, suffix, text, tmp_path):
        path = tmp_path / f"a.{suffix}"
        path.write_text(text)
        refused(lambda: load_mesh(path), path, error=MeshError)

    @pytest.mark.parametrize("name", ["a.txt", "a", "a.step", "a.dae", "a.py"])
    def test_wrong_extension(self, name, tmp_path):
        path = write_mesh(tmp_path / name, cup())
        refused(lambda: load_mesh(path), path, "stl, obj, ply, off, glb, 3mf", error=MeshError)

    @pytest.mark.parametrize("kind", ["zip", "gz", "tar"])
    @pytest.mark.parametrize("named", [True, False])
    def test_archives(self, kind, named, tmp_path):
        buffer = io.BytesIO()
        if kind == "zip":
            with zipfile.ZipFile(buffer, "w") as archive:
                archive.writestr("a.ply", good("ply"))
        elif kind == "tar":
            with tarfile.open(fileobj=buffer, mode="w") as archive:
                info = tarfile.TarInfo("a.ply")
                info.size = len(good("ply"))
                archive.addfile(info, io.BytesIO(good("ply")))
        else:
            buffer.write(gzip.compress(good("ply")))
        path = tmp_path / (f"a.ply.{kind}" if named else "a.ply")
        path.write_bytes(buffer.getvalue())
        refused(lambda: load_mesh(path), path, "archive", "unpack", error=MeshError)

    def test_url(self):
        from pathlib import Path

        url = Path("https://example.org/mug.stl")
        refused(lambda: load_mesh(url), "URL", "download", error=MeshError)

    @pytest.mark.parametrize("suffix", [*SUFFIXES, "stl_ascii"])
    def test_any_damaged_byte_is_an_error_or_a_solid(self, suffix, tmp_path):
        """The head of a file decides how it is read, so half of the damage is there."""
        path = tmp_path / f"a.{suffix[:3]}"
        sound = ball(subdivisions=1).export(file_type=suffix)
        sound = sound.encode() if isinstance(sound, str) else sound
        if suffix == "3mf":
            with zipfile.ZipFile(io.BytesIO(sound)) as archive:
                sound = archive.read("3D/3dmodel.model")
        for seed in range(60):
            rng = np.random.default_rng(seed)
            content = bytearray(sound)
            for _ in range(rng.integers(1, 6)):
                k = rng.integers(min(len(content), 400) if seed % 2 else len(content))
                content[k] = rng.integers(256) if seed % 3 else rng.choice(list(b"0123456789-.e \n"))
            if suffix == "3mf":
                with zipfile.ZipFile(path, "w") as archive:
                    archive.writestr("3D/3dmodel.model", bytes(content))
            else:
                path.write_bytes(content)
            self.assert_error_or_solid(path)

    @staticmethod
    def assert_error_or_solid(path):
        try:
            mesh = load_mesh(path, unit="m")
        except InputError as problem:
            message = str(problem)
        else:
            assert np.isfinite(mesh.vertices).all()
            assert is_solid(mesh.faces)[0]
            assert signed_volume(mesh.vertices, mesh.faces) > 0
            return
        assert "\n" not in message
        assert str(path) in message


class TestTooLarge:
    """Refused by what the header says, before memory is asked for it."""

    def test_binary_stl(self, tmp_path):
        path = tmp_path / "a.stl"
        n = 1_000_001
        with path.open("wb") as stream:
            stream.write(bytes(80) + struct.pack("<I", n))
            stream.truncate(84 + 50 * n)
        refused(lambda: load_mesh(path), path, "1,000,001 faces", "1,000,000", error=MeshError)

    def test_ten_million_faces_by_size(self, tmp_path):
        path = tmp_path / "a.stl"
        n = 10_000_000
        with path.open("wb") as stream:
            stream.write(bytes(80) + struct.pack("<I", n))
            stream.truncate(84 + 50 * n)
        refused(lambda: load_mesh(path), path, "476 MiB", "400 MiB", error=MeshError)

    @pytest.mark.parametrize("element", ["vertex", "face"])
    def test_ply(self, element, tmp_path):
        path = tmp_path / "a.ply"
        counts = {"vertex": 5, "face": 5, element: 10_000_000}
        path.write_text(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {counts['vertex']}\nproperty float x\n"
            f"property float y\nproperty float z\nelement face {counts['face']}\n"
            "property list uchar int vertex_indices\nend_header\n"
        )
        refused(lambda: load_mesh(path), path, "10,000,000", "the limit is", error=MeshError)

    def test_ply_that_announces_more_than_it_has(self, tmp_path):
        path = tmp_path / "a.ply"
        path.write_bytes(good("ply").replace(b"element face ", b"element face 9"))
        refused(lambda: load_mesh(path), path, "truncated", error=MeshError)

    def test_off(self, tmp_path):
        path = tmp_path / "a.off"
        path.write_text("OFF\n5 10000000 0\n")
        refused(lambda: load_mesh(path), path, "10,000,000 faces", error=MeshError)

    @pytest.mark.parametrize("count", ["9" * 4000, "-" + "9" * 4000])
    def test_a_number_of_more_digits_than_a_line_holds(self, count, tmp_path):
        path = tmp_path / "a.off"
        path.write_text(f"OFF\n5 {count} 0\n")
        refused(lambda: load_mesh(path), path, "999", error=MeshError)
        path = write_ply(tmp_path / "a.ply", *arrays(block()))
        path.write_text(path.read_text().replace("element face 12", f"element face {count}"))
        refused(lambda: load_mesh(path), path, "999", error=MeshError)

    def test_obj(self, tmp_path):
        path = tmp_path / "a.obj"
        path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 1_000_001)
        refused(lambda: load_mesh(path), path, "1,000,001 faces", error=MeshError)

    def test_3mf_that_unpacks_to_too_much(self, tmp_path):
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            faces = b'<triangle v1="0" v2="1" v3="2"/>' * 1_000_001
            text = b'<model><object id="1">' + faces + b'</object><item objectid="1"/></model>'
            archive.writestr("3D/3dmodel.model", text)
        refused(lambda: load_mesh(path), path, "1,000,001 faces", error=MeshError)

    def test_3mf_of_countless_tags(self, tmp_path):
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("3D/3dmodel.model", b"<model>" + b"<a/>" * 4_100_001 + b"</model>")
        assert path.stat().st_size < 2**20
        refused(lambda: load_mesh(path), path, "XML tags", error=MeshError)


class TestContent:
    def test_obj_index_out_of_range(self, tmp_path):
        vertices, faces = arrays(block())
        path = write_obj(tmp_path / "a.obj", vertices, faces + (faces == 7))
        refused(lambda: load_mesh(path), path, "vertex 8", "has 8", error=MeshError)

    @pytest.mark.parametrize("index", ["0", "-9", "1.5", "x", "", "9" * 4000])
    def test_obj_index_that_is_none(self, index, tmp_path):
        vertices, faces = arrays(block())
        path = write_obj(tmp_path / "a.obj", vertices, faces)
        path.write_text(path.read_text() + f"f 1 2 {index}\n")
        refused(lambda: load_mesh(path), path, error=MeshError)

    @pytest.mark.parametrize(
        "rows", [{4: "0 0"}, {4: "0 0 0 0"}, {8: "2 0 1"}, {8: "4 0 1 2"}, {8: "2 0 1 2"}]
    )
    def test_ply_rows_of_a_wrong_length(self, rows, tmp_path):
        path = write_ply(tmp_path / "a.ply", *arrays(block()))
        lines = path.read_text().splitlines()
        start = lines.index("end_header") + 1
        for k, text in rows.items():
            lines[start + k] = text
        path.write_text("\n".join(lines))
        refused(lambda: load_mesh(path), path, error=MeshError)

    def test_binary_ply_with_another_list_of_the_same_total(self, tmp_path):
        """Lists of 3, 4 and 2 corners are as long as three triangles."""
        vertices = np.array(block().vertices, dtype="<f8")
        header = (
            "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty double x\nproperty double y\n"
            "property double z\nelement face 3\nproperty list uchar int vertex_indices\nend_header\n"
        )
        faces = struct.pack("<B3iB4iB2i", 3, 0, 1, 2, 4, 0, 1, 2, 3, 2, 4, 5)
        path = tmp_path / "a.ply"
        path.write_bytes(header.encode() + vertices.tobytes() + faces)
        refused(lambda: load_mesh(path), path, "different lengths", error=MeshError)

    def test_stl_that_holds_more_than_it_announces(self, tmp_path):
        data = bytearray(good("stl"))
        data[80:84] = struct.pack("<I", struct.unpack_from("<I", data, 80)[0] - 1)
        path = tmp_path / "a.stl"
        path.write_bytes(data)
        refused(lambda: load_mesh(path), path, "announces", error=MeshError)

    def test_ply_of_triangle_strips(self, tmp_path):
        path = write_ply(tmp_path / "a.ply", *arrays(block()))
        path.write_text(path.read_text().replace("element face", "element tristrips"))
        refused(lambda: load_mesh(path), path, "tristrips", error=MeshError)

    @pytest.mark.parametrize("suffix", ["ply", "off"])
    @pytest.mark.parametrize("index", [8, -1, 2**40])
    def test_index_out_of_range(self, suffix, index, tmp_path):
        vertices, faces = arrays(block())
        faces[3, 1] = index
        path = tmp_path / f"a.{suffix}"
        if suffix == "ply":
            write_ply(path, vertices, faces)
        else:
            rows = [" ".join(map(str, v)) for v in vertices] + ["3 " + " ".join(map(str, f)) for f in faces]
            path.write_text("OFF\n8 12 0\n" + "\n".join(rows))
        refused(lambda: load_mesh(path), path, f"vertex {index}", error=MeshError)

    @pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
    @pytest.mark.parametrize("suffix", ["ply", "obj", "stl"])
    def test_not_finite(self, value, suffix, tmp_path):
        path = tmp_path / f"a.{suffix}"
        if suffix == "stl":
            vertices, faces = arrays(block())
            soup = vertices[faces].astype("<f4")
            soup[3, 1, 2] = np.float32(float(value))
            body = b"".join(struct.pack("<12fH", *([0.0] * 3), *t.reshape(-1).tolist(), 0) for t in soup)
            path.write_bytes(bytes(80) + struct.pack("<I", len(soup)) + body)
        else:
            vertices, faces = arrays(block())
            (write_ply if suffix == "ply" else write_obj)(path, vertices, faces)
            path.write_text(path.read_text().replace(repr(float(vertices[0, 0])), value, 1))
        refused(lambda: load_mesh(path), path, "finite", error=MeshError)

    @pytest.mark.parametrize("suffix", ["ply", "obj"])
    def test_comma_decimals_in_a_mesh(self, suffix, tmp_path):
        vertices, faces = arrays(block())
        path = tmp_path / f"a.{suffix}"
        (write_ply if suffix == "ply" else write_obj)(path, vertices, faces)
        path.write_text(path.read_text().replace("0.05", "0,05"))
        refused(lambda: load_mesh(path), path, "0,05", "point", error=MeshError)

    def test_no_faces(self, tmp_path):
        path = write_ply(tmp_path / "a.ply", arrays(block())[0], np.empty((0, 3), int))
        refused(lambda: load_mesh(path), path, "8 points but no faces", error=MeshError)

    def test_faces_of_one_point(self, tmp_path):
        path = write_ply(tmp_path / "a.ply", arrays(block())[0], [[0, 0, 0], [1, 1, 2]])
        refused(lambda: load_mesh(path), path, "no surface", error=MeshError)

    def test_all_at_one_point(self, tmp_path):
        vertices, faces = arrays(block())
        path = write_ply(tmp_path / "a.ply", vertices * 0 + 0.1, faces)
        refused(lambda: load_mesh(path), path, "one point", error=MeshError)

    @pytest.mark.parametrize("double", [False, True])
    def test_planar(self, double, tmp_path):
        vertices = np.array([[0, 0, 0.3], [0.1, 0, 0.3], [0.1, 0.1, 0.3], [0, 0.1, 0.3]])
        turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        faces = np.concatenate([faces, faces[:, ::-1]]) if double else faces
        path = write_ply(tmp_path / "a.ply", vertices @ turn, faces)
        refused(lambda: load_mesh(path), path, "flat", "thickness", error=MeshError)

    def test_zero_volume(self, tmp_path):
        """A bent sheet with a front and a back: closed, but nothing between."""
        vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.05], [0, 0.1, 0]])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        soup = np.concatenate([vertices, vertices])
        path = write_ply(tmp_path / "a.ply", vertices, np.concatenate([faces, faces[:, ::-1]]))
        refused(lambda: load_mesh(path), path, "no volume", "thickness", error=MeshError)
        path = write_ply(tmp_path / "b.ply", soup, np.concatenate([faces, faces[:, ::-1] + 4]))
        refused(lambda: load_mesh(path), path, "no volume", "thickness", error=MeshError)

    def test_large_hole(self, tmp_path):
        """An open box: its missing lid is a surface that nobody drew."""
        vertices, faces = arrays(block(0.1, 0.06, 0.04))
        lid = (vertices[faces][:, :, 2] > 0).all(axis=1)
        path = write_ply(tmp_path / "a.ply", vertices, faces[~lid])
        # The lid's diagonal is 117 mm, 5 % of the box's 6 mm.
        refused(lambda: load_mesh(path), path, "117 mm", "6.16 mm", error=MeshError)

    def test_a_sheet_beside_a_solid(self, tmp_path):
        vertices, faces = arrays(block())
        n = len(vertices)
        sheet = np.array([[0.2, 0, 0], [0.25, 0, 0], [0.2, 0.05, 0]])
        faces = np.concatenate([faces, [[n, n + 1, n + 2], [n, n + 2, n + 1]]])
        path = write_ply(tmp_path / "a.ply", np.concatenate([vertices, sheet]), faces)
        refused(lambda: load_mesh(path), path, "sheet without thickness", error=MeshError)

    def test_inner_wall_with_three_faces_at_its_edges(self, tmp_path):
        vertices, faces = arrays(block())
        path = write_ply(tmp_path / "a.ply", vertices, np.concatenate([faces, [[0, 1, 7]]]))
        refused(lambda: load_mesh(path), path, error=MeshError)

    def test_one_sided(self, tmp_path):
        """A closed Möbius strip (a projective plane of six vertices) has no inside."""
        faces = np.array(
            [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1],
             [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2], [5, 1, 3]]
        )  # fmt: skip
        vertices = np.random.default_rng(0).uniform(0, 0.1, (6, 3))
        path = write_ply(tmp_path / "a.ply", vertices, faces)
        refused(lambda: load_mesh(path), path, "one-sided", error=MeshError)

    @pytest.mark.parametrize(
        ("size", "hint"), [(117.0, "--unit mm makes it 0.117 m"), (2000.0, "--unit mm"), (2.01, "--unit")]
    )
    def test_millimetres_as_metres(self, size, hint, tmp_path):
        path = write_mesh(tmp_path / "a.ply", block(size, size / 2, size / 2))
        refused(lambda: load_mesh(path), path, hint, "if its numbers are metres", error=UnitError)

    def test_metres_as_millimetres(self, tmp_path):
        path = write_mesh(tmp_path / "a.ply", cup())
        refused(lambda: load_mesh(path, unit="mm"), path, "with --unit mm", "--unit m ", error=UnitError)

    @pytest.mark.parametrize("size", [1e-9, 1e-300, 1e9, 1e300])
    def test_no_unit_makes_it_right(self, size, tmp_path):
        vertices, faces = arrays(block())
        path = write_ply(tmp_path / "a.ply", vertices / 0.1 * size, faces)
        refused(lambda: load_mesh(path), path, "2 mm to 2 m", error=UnitError)

    @pytest.mark.parametrize(
        ("change", "word"),
        [
            ({"buffers": [{"byteLength": 9, "uri": "x.bin"}]}, "another file"),
            ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
            ({"extensionsRequired": ["X" * 2000]}, "XXX..."),
            ({"nodes": [{"children": [0]}], "scenes": [{"nodes": [0]}]}, "circle"),
            ({"accessors": []}, "damaged"),
            (
                {"bufferViews": [{"buffer": 0, "byteOffset": 10**9, "byteLength": 9}] * 9},
                "truncated or damaged",
            ),
            ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]}, "points, lines"),
            ({"scenes": [{"nodes": []}]}, "no faces"),
            ({"meshes": [{"primitives": [{"attributes": {"POSITION": 1}}] * 99999}]}, "the limit is"),
            ({"bufferViews": [{"buffer": 0, "byteLength": 10**6}] * 2000}, "unpacks to"),
            ({"meshes": [{"primitives": [], "weights": [0.0, 0.5]}]}, "morph"),
            ({"nodes": [{"mesh": 0, "weights": [1.0]}]}, "morph"),
        ],
    )
    def test_glb_that_cannot_be_read(self, change, word, tmp_path):
        data = good("glb")
        size = struct.unpack_from("<I", data, 12)[0]
        text = json.dumps(json.loads(data[20 : 20 + size]) | change).encode()
        text += b" " * (-len(text) % 4)
        rest = data[20 + size :]
        head = b"glTF" + struct.pack("<IIII", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
        path = tmp_path / "a.glb"
        path.write_bytes(head + text + rest)
        refused(lambda: load_mesh(path), path, word, error=MeshError)

    @pytest.mark.parametrize(
        ("table", "change", "word"),
        [
            ("accessors", {"sparse": {"count": 1}}, "sparse"),
            ("accessors", {"bufferView": None}, "damaged"),
            ("accessors", {"count": -1}, "-1"),
            ("accessors", {"count": 10**10}, "the limit is"),
            ("accessors", {"type": "VEC3", "componentType": 5126}, "no float VEC3"),
            ("accessors", {"type": "SCALAR", "componentType": 5125}, "no float VEC3"),
            ("accessors", {"byteOffset": 10**10}, "truncated or damaged"),
            ("bufferViews", {"byteOffset": -4}, "-4"),
            ("nodes", {"mesh": -1}, "-1"),
            ("nodes", {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, None, 0, 0, 0, 0, 1]}, "finite"),
            ("nodes", {"matrix": [float("nan")] * 16}, "finite"),
        ],
    )
    def test_glb_with_a_damaged_entry_in_each_row(self, table, change, word, tmp_path):
        """What lenient loaders read as zeros, as another row or as nothing at all."""
        data = good("glb")
        size = struct.unpack_from("<I", data, 12)[0]
        rows = json.loads(data[20 : 20 + size])[table]
        self.test_glb_that_cannot_be_read({table: [row | change for row in rows]}, word, tmp_path)

    def test_glb_nested_deeper_than_can_be_read_in_time(self, tmp_path):
        nodes = [{"children": [k + 1]} for k in range(3000)] + [{"mesh": 0}]
        change = {"nodes": nodes, "scenes": [{"nodes": [0]}]}
        self.test_glb_that_cannot_be_read(change, "deeper than", tmp_path)

    @pytest.mark.parametrize(
        ("change", "word"),
        [({"skin": 0}, "skin"), ({"extensions": {"EXT_mesh_gpu_instancing": {}}}, "EXT_mesh_gpu_instancing")],
    )
    def test_glb_nodes_that_change_what_they_hold(self, change, word, tmp_path):
        self.test_glb_that_cannot_be_read({"nodes": [{"mesh": 0} | change]}, word, tmp_path)

    def test_glb_that_expands_to_too_much(self, tmp_path):
        """A small file: one mesh of 768 vertices under many nodes."""
        nodes = [{"mesh": 0}] * 8000
        change = {"nodes": nodes, "scenes": [{"nodes": list(range(8000))}]}
        self.test_glb_that_cannot_be_read(change, "the limit is", tmp_path)

    def test_glb_without_data(self, tmp_path):
        data = good("glb")
        size = struct.unpack_from("<I", data, 12)[0]
        rows = json.loads(data[20 : 20 + size])["accessors"]
        for row in rows:
            del row["bufferView"]
        self.test_glb_that_cannot_be_read({"accessors": rows}, "sparse", tmp_path)

    @pytest.mark.parametrize(
        ("old", "new", "word"),
        [
            ('v1="0"', 'v1="-1"', "vertex -1"),
            ('v1="0"', 'v1="8"', "vertex 8"),
            ('v1="0"', 'v1="0.5"', "0.5"),
            (' x="', ' x="1,', "could not convert"),
            (' x="', ' w="', "'x'"),
            ('<item objectid="', '<item objectid="9', "placed but not there"),
            ("<build>", "<building>", "damaged"),
            ('<item objectid="', '<item objectid="' + "9" * 2000, "placed but not there"),
            ('unit="meter"', f'unit="{"m" * 2000}"', "millimeter"),
            ('<item objectid="1"/>', '<item objectid="1"/>' * 2_001, "placed too often"),
            ("<resources>", '<resources><object id="1"/>', "twice"),
            (
                "<resources>",
                "<resources>" + "".join(f'<object id="{k}"/>' for k in range(9, 2100)),
                "too many",
            ),
            (' y="', ' y="0 ', "0 "),
        ],
    )
    def test_3mf_that_cannot_be_read(self, old, new, word, tmp_path):
        vertices, faces = arrays(block())
        points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
        corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
        model = (
            f'<model unit="meter"><resources><object id="1"><mesh><vertices>{points}</vertices>'
            f"<triangles>{corners}</triangles></mesh></object></resources>"
            '<build><item objectid="1"/></build></model>'
        )
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("3D/3dmodel.model", model)
        assert len(load_mesh(path).vertices) == 8
        assert old in model
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("3D/3dmodel.model", model.replace(old, new))
        refused(lambda: load_mesh(path), path, word, error=MeshError)

    def test_3mf_whose_member_has_another_name_than_its_directory_says(self, tmp_path):
        """The library's own words then hold that name, here most of the file."""
        data = bytearray(good("3mf"))
        data[26:28] = struct.pack("<H", 1500)
        path = tmp_path / "a.3mf"
        path.write_bytes(data)
        refused(lambda: load_mesh(path), path, "damaged", error=MeshError)

    def test_3mf_with_entities(self, tmp_path):
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("3D/3dmodel.model", '<!DOCTYPE x [<!ENTITY a "b">]><model>&a;</model>')
        refused(lambda: load_mesh(path), path, "entities", error=MeshError)

    @pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "latin-1"])
    def test_3mf_with_entities_in_another_encoding(self, encoding, tmp_path):
        path = tmp_path / "a.3mf"
        name = {"utf-8-sig": "utf-8", "latin-1": "iso-8859-1"}.get(encoding, "utf-16")
        text = f'<?xml version="1.0" encoding="{name}"?><!DOCTYPE x [<!ENTITY a "b">]><model>&a;</model>'
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("3D/3dmodel.model", text.encode(encoding))
        refused(lambda: load_mesh(path), path, "entities", error=MeshError)

    def test_3mf_that_places_a_mesh_very_often(self, tmp_path):
        """A few kilobytes: 40,000 vertices placed 1,900 times."""
        path = tmp_path / "a.3mf"
        points = '<vertex x="1" y="2" z="3"/>' * 40_000
        items = '<item objectid="1"/>' * 1_900
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(
                "3D/3dmodel.model",
                f'<model><resources><object id="1"><mesh><vertices>{points}</vertices></mesh></object>'
                f"</resources><build>{items}</build></model>",
            )
        start = time.process_time()
        refused(lambda: load_mesh(path), path, "76,000,000 vertices", error=MeshError)
        assert time.process_time() - start < 5

    def test_3mf_of_a_zip_version_that_is_not_known(self, tmp_path):
        data = bytearray(good("3mf"))
        for k in range(len(data) - 4):
            if data[k : k + 4] == b"PK\x01\x02":
                data[k + 6] = 105
        path = tmp_path / "a.3mf"
        path.write_bytes(data)
        refused(lambda: load_mesh(path), path, "damaged", error=MeshError)

    def test_3mf_nested_wider_than_is_walked(self, tmp_path):
        """Twenty-three references make 4,095 places."""
        levels = "".join(
            f'<object id="{k + 1}"><components><component objectid="{k}"/><component objectid="{k}"/>'
            "</components></object>"
            for k in range(1, 12)
        )
        mesh = (
            '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>'
            '<vertex x="0" y="1" z="0"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'
        )
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(
                "3D/3dmodel.model",
                f'<model><resources><object id="1">{mesh}</object>{levels}</resources>'
                '<build><item objectid="12"/></build></model>',
            )
        refused(lambda: load_mesh(path), path, "nested, over 2,000 in all; export fewer", error=MeshError)

    def test_3mf_with_components_in_a_circle(self, tmp_path):
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(
                "3D/3dmodel.model",
                '<model unit="meter"><resources><object id="1"><components><component objectid="1"/>'
                '<component objectid="1"/></components></object></resources>'
                '<build><item objectid="1"/></build></model>',
            )
        refused(lambda: load_mesh(path), path, "circle", error=MeshError)


class TestCatalogues:
    def table(self, tmp_path, text):
        write_mesh(tmp_path / "mug.ply", cup())
        write_mesh(tmp_path / "box.ply", block())
        path = tmp_path / "objects.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("name,mass_kg\nmug,0.1\n", ["no column 'file'", "name,file"]),
            ("file\nmug.ply\n", ["no column 'name'"]),
            ("name,file\n", ["lists no items"]),
            ("", ["is empty"]),
            ("\ufeff", ["is empty"]),
            ("name;file;mass_kg\nmug;mug.ply;1.0,1\n", ["line 2", "'1.0,1'", "not a number"]),
            ("name\tfile\tmass_kg\nmug\tmug.ply\t1,234\n", ["line 2", "'1,234'", "point: 1.234"]),
            ("name;file;mass_kg\nmug;mug.ply\n", ["line 2", "2 cells"]),
            ("name,file,masskg\nmug,mug.ply,0.1\n", ["unknown column 'masskg'", "did you mean 'mass_kg'"]),
            ("Name,file\nmug,mug.ply\n", ["unknown column 'Name'", "did you mean 'name'"]),
            ("name,file,xyzzy\nmug,mug.ply,1\n", ["unknown column 'xyzzy'", "mass_kg", "begin with '_'"]),
            ("name,,file\nmug,,mug.ply\n", ["column 2 has no name"]),
            (b"\xff\xfen\x00a\x00m", ["UTF-8"]),
            (b"\xff\xfe\x00\x00n\x00\x00\x00", ["zero bytes"]),
            (b"\xd0\xcf\x11\xe0" + bytes(600), ["Excel workbook (xls)", "CSV UTF-8"]),
            (b"PK\x03\x04" + bytes(90), ["zip archive", "CSV UTF-8"]),
            ("name,file,mass_kg\nmug,mug.ply,0,118\n", ["line 2", "4 cells", "point"]),
            ('name,file,mass_kg\nmug,mug.ply,"0,118"\n', ["line 2", "mass_kg", "point: 0.118"]),
            ("name,file,mass_kg\nmug,mug.ply,0\n", ["line 2", "mass_kg is 0", "above 0"]),
            ("name,file,mass_kg\nmug,mug.ply,-0.2\n", ["line 2", "mass_kg is -0.2"]),
            ("name,file,mass_kg\nmug,mug.ply,nan\n", ["line 2", "mass_kg is nan"]),
            ("name,file,mass_kg\nmug,mug.ply,inf\n", ["line 2", "mass_kg is inf"]),
            ("name,file,mass_kg\nmug,mug.ply,heavy\n", ["line 2", "'heavy'"]),
            ("name,file,mass\nmug,mug.ply,118\n", ["'mass'", "mass_kg"]),
            (
                "name,file\nmug,mug.ply\nbox,box.ply\nmug,box.ply\n",
                ["line 4", "'mug' is there twice", "mug.ply", "box.ply"],
            ),
            ("name,file,file\nmug,mug.ply,box.ply\n", ["'file' is there twice"]),
            ("name,file\n,mug.ply\n", ["line 2", "'name' is empty"]),
            ("name,file\nmug,\n", ["line 2", "'file' is empty"]),
            ("name,file\nmug\n", ["line 2", "1 cells"]),
            ("name,file\nmug,../mug.ply\n", ["'../mug.ply'", "inside"]),
            ("name,file\nmug,a/../../mug.ply\n", ["inside"]),
            ("name,file\nmug,/etc/mug.ply\n", ["'/etc/mug.ply'", "inside"]),
            ("name,file\nmug,C:\\mug.ply\n", ["inside"]),
            ("name,file\nmug,..\\mug.ply\n", ["inside"]),
            ("name,file\nmug,https://example.org/mug.ply\n", ["URL"]),
            ("name,file\nmug,file:///mug.ply\n", ["URL"]),
            ("name,file\nmug,mug.zip\n", ["archive", "unpack"]),
            ("name,file\nmug,mug.tar.gz\n", ["archive"]),
            ("name,file\nmug,mug.txt\n", ["'mug.txt'", "stl, obj, ply"]),
            ("name,file,unit\nmug,mug.ply,inch\n", ["'inch'", "m, cm, mm, in"]),
            ("name,file,parts_file\nmug,mug.ply,../x.obj\n", ["'../x.obj'", "inside"]),
            ('name,file\n"mug\x07",mug.ply\n', ["printable"]),
            ('name,file\n"mug,mug.ply\n', ["not a CSV table"]),
            (b"name,file\nm\xfcg,mug.ply\n", ["UTF-8"]),
            (b"name,file\nmug\0,mug.ply\n", ["zero bytes"]),
        ],
    )
    def test_a_bad_table(self, text, words, tmp_path):
        path = self.table(tmp_path, text)
        refused(lambda: open_catalogue(tmp_path), path, *words, error=CatalogueError)

    def test_a_missing_mesh_is_told_when_its_item_is_asked_for(self, tmp_path):
        self.table(tmp_path, "name,file\nmug,mug.ply\njug,jug.ply\n")
        catalogue = open_catalogue(tmp_path)
        assert catalogue.item("mug").name == "mug"
        refused(lambda: catalogue.item("jug"), tmp_path / "jug.ply", "no such file", error=MeshError)

    def test_folders(self, tmp_path):
        none = tmp_path / "none"
        refused(lambda: open_catalogue(none), none, "no such folder", error=CatalogueError)
        refused(
            lambda: open_catalogue(tmp_path), tmp_path, "neither objects.csv nor a mesh", error=CatalogueError
        )
        archive = tmp_path / "shelf.zip"
        archive.write_bytes(b"PK\x03\x04")
        refused(lambda: open_catalogue(archive), archive, "archive", "unpack", error=CatalogueError)
        file = write_mesh(tmp_path / "a.ply", cup())
        refused(lambda: open_catalogue(file), file, "is a file", error=CatalogueError)
        url = "https://example.org/shelf"
        refused(lambda: open_catalogue(url), url, "URL", error=CatalogueError)
        refused(lambda: open_catalogue(tmp_path, unit="ft"), "'ft'", error=UnitError)

    def test_two_bare_meshes_of_one_name(self, tmp_path):
        write_mesh(tmp_path / "mug.ply", cup())
        write_mesh(tmp_path / "mug.stl", cup())
        refused(lambda: open_catalogue(tmp_path), "mug.ply", "mug.stl", "'mug'", error=CatalogueError)


class TestOrders:
    NAMES = ("red mug", "bowl", "025_plate")

    @pytest.mark.parametrize(
        ("name", "text", "words"),
        [
            ("o.csv", "", ["is empty"]),
            ("o.csv", " \n\n", ["is empty"]),
            ("o.csv", "item,qty\n", ["the order is empty"]),
            ("o.json", "[]", ["the order is empty"]),
            ("o.json", '{"items": []}', ["the order is empty"]),
            ("o.csv", "item,qty\nbowl,0\n", ["line 2", "qty is 0", "above 0"]),
            ("o.csv", "item,qty\nbowl,-1\n", ["line 2", "qty is -1"]),
            ("o.csv", "item,qty\nbowl,1.5\n", ["line 2", "'1.5'", "whole number"]),
            ("o.csv", "item,qty\nbowl,1e2\n", ["'1e2'"]),
            ("o.csv", "item,qty\nbowl,two\n", ["'two'"]),
            ("o.csv", "item,qty\nbowl,\n", ["'qty' is empty"]),
            ("o.csv", "item,qty\nbowl,1,5\n", ["line 2", "3 cells", "point"]),
            ("o.csv", "item,qty\nbowl\n", ["1 cells"]),
            ("o.csv", "item,qty\n,2\n", ["'item' is empty"]),
            ("o.csv", "item,qty\nbowl,99999999999\n", ["99,999,999,999 pieces", "limit"]),
            ("o.csv", "item,qty\nbowls,2\n", ["line 2", "'bowls'", "did you mean 'bowl'"]),
            ("o.csv", "item,qty\nplate,2\n", ["did you mean '025_plate'"]),
            ("o.csv", "item,qty\nRED MUG,2\n", ["did you mean 'red mug'"]),
            ("o.csv", "item,qty\nxylophone,2\n", ["'xylophone'", "3 items"]),
            ("o.csv", "qty\n2\n", ["no column 'item'", "item,qty"]),
            ("o.csv", "bowl,2\n", ["no column 'item'", "item,qty"]),
            ("o.csv", "item,quantity\nbowl,2\n", ["unknown column 'quantity'", "did you mean 'qty'"]),
            ("o.xlsx", b"PK\x03\x04rest", ["Excel workbook (xlsx)", "CSV UTF-8"]),
            ("o.csv", "item,Qty\nbowl,2\n", ["unknown column 'Qty'", "did you mean 'qty'"]),
            ("o.csv", "items,qty\nbowl,2\n", ["unknown column 'items'", "did you mean 'item'"]),
            ("o.csv", "item;qty\nbowl;1,5\n", ["line 2", "'1,5'", "whole number"]),
            ("o.csv", "item,qty\nbowl,2,,x\n", ["line 2", "4 cells"]),
            ("o.csv", b"item,qty\nb\xf6wl,2\n", ["UTF-8"]),
            ("o.json", "{", ["is not JSON"]),
            ("o.json", "3", ["no list of items"]),
            ("o.json", '{"order": []}', ["no list of items"]),
            ("o.json", "[3]", ["item 1", "name"]),
            ("o.json", '[{"qty": 2}]', ["item 1", "name"]),
            ("o.json", '["bowl", {"item": "bowl", "qty": 0}]', ["item 2", "qty is 0"]),
            ("o.json", '[{"item": "bowl", "qty": 1.0}]', ["qty is 1.0"]),
            ("o.json", '[{"item": "bowl", "qty": true}]', ["qty is true"]),
            ("o.json", '[{"item": "bowl", "qty": "2"}]', ['qty is "2"']),
            ("o.json", '[{"item": "bowl", "qty": NaN}]', ["qty is NaN"]),
            ("o.json", '[{"item": "bowl", "count": 2}]', ["unknown key 'count'"]),
            ("o.json", '[{"item": "bowl", "QTY": 2}]', ["unknown key 'QTY'", "did you mean 'qty'"]),
            ("o.json", '["bowk"]', ["item 1", "did you mean 'bowl'"]),
            ("o.json", "[" * 100_000, ["is not JSON"]),
        ],
    )
    def test_a_bad_order(self, name, text, words, tmp_path):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        refused(lambda: read_order(path, self.NAMES), path, *words, error=OrderError)

    def test_missing(self, tmp_path):
        refused(
            lambda: read_order(tmp_path / "none.csv", self.NAMES),
            "none.csv",
            "no such file",
            error=OrderError,
        )
        refused(lambda: read_order(tmp_path, self.NAMES), tmp_path, "not a file", error=OrderError)


def test_an_error_is_one_line_even_where_the_name_is_not(tmp_path):
    path = tmp_path / "two\nlines.ply"
    assert "two lines.ply: no such file" in refused(lambda: load_mesh(path))


def test_a_ball_is_still_a_ball(tmp_path):
    """The guard of this file: what is good is not refused."""
    for suffix in SUFFIXES:
        path = tmp_path / f"a.{suffix}"
        data = ball().export(file_type=suffix)
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        mesh = load_mesh(path, unit="m")
        assert signed_volume(mesh.vertices, mesh.faces) == pytest.approx(ball().volume, rel=1e-5)
