"""3MF files mean what the slicers that write them mean; volumes in closed form."""

from __future__ import annotations

import re
import time
import zipfile

import numpy as np
import pytest
import trimesh

from packenv.errors import MeshError
from packenv.geometry.mass import signed_volume
from tests.mesh_samples import block, load_mesh, model_3mf, object_3mf, write_3mf

PLATE = '<item objectid="1"/>'
PRODUCTION = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
BRICK = 60.0 * 40.0 * 30.0
"""mm³ of the solid that every file holds."""
HOLE = 20.0 * 20.0 * 40.0
"""mm³ of a helper through the brick that reaches out of it below and above by 5 mm."""


def brick():
    return block(60, 40, 30)


def helper():
    return block(20, 20, 40)


def both():
    """The brick, faces 0 to 11, and the helper, faces 12 to 23, in one mesh."""
    return trimesh.util.concatenate([brick(), helper()])


def cubic_mm(path):
    found = load_mesh(path)
    return signed_volume(found.vertices, found.faces) * 1e9, found.notes


def prusa(kind):
    volumes = [(0, 11, "ModelPart"), (12, 23, kind)]
    rows = [
        f'<volume firstid="{a}" lastid="{b}"><metadata type="volume" key="volume_type" value="{word}"/></volume>'
        for a, b, word in volumes
    ]
    text = f'<config><object id="1">{"".join(rows)}</object></config>'
    return {"Metadata/Slic3r_PE_model.config": text}


def bambu(kind):
    parts = f'<part id="1" subtype="normal_part"/><part id="2" subtype="{kind}"/>'
    return {"Metadata/model_settings.config": f'<config><object id="3">{parts}</object></config>'}


def bambu_model():
    group = (
        '<object id="3"><components><component objectid="1"/><component objectid="2"/></components></object>'
    )
    helper_object = object_3mf(2, helper()).replace("<object", '<object type="other"')
    return model_3mf("millimeter", [object_3mf(1, brick()), helper_object, group], ['<item objectid="3"/>'])


class TestVolumes:
    @pytest.mark.parametrize("kind", ["ParameterModifier", "SupportEnforcer", "SupportBlocker"])
    def test_modifiers_and_supports_are_left_out(self, kind, tmp_path):
        model = model_3mf("millimeter", [object_3mf(1, both())], [PLATE])
        volume, notes = cubic_mm(write_3mf(tmp_path / "a.3mf", model, **prusa(kind)))
        assert volume == pytest.approx(BRICK)
        assert notes == ("1 modifier or support volumes left out",)

    @pytest.mark.parametrize("kind", ["modifier_part", "support_blocker", "support_enforcer"])
    def test_so_are_parts(self, kind, tmp_path):
        volume, notes = cubic_mm(write_3mf(tmp_path / "a.3mf", bambu_model(), **bambu(kind)))
        assert volume == pytest.approx(BRICK)
        assert notes == ("1 modifier or support volumes left out",)

    def test_negative_volumes_are_subtracted(self, tmp_path):
        """The helper passes through the brick: what they share is 20 x 20 x 30 mm."""
        model = model_3mf("millimeter", [object_3mf(1, both())], [PLATE])
        first = write_3mf(tmp_path / "a.3mf", model, **prusa("NegativeVolume"))
        second = write_3mf(tmp_path / "b.3mf", bambu_model(), **bambu("negative_part"))
        for path in (first, second):
            volume, notes = cubic_mm(path)
            assert volume == pytest.approx(BRICK - HOLE * 30 / 40)
            assert notes == ("1 negative volumes subtracted",)

    def test_a_negative_volume_cuts_its_own_object_only(self, tmp_path):
        """A second object at the same place keeps its inside: the union is the brick and what it adds."""
        items = [PLATE, '<item objectid="2"/>']
        model = model_3mf("millimeter", [object_3mf(1, both()), object_3mf(2, block(10, 10, 30))], items)
        volume, _ = cubic_mm(write_3mf(tmp_path / "a.3mf", model, **prusa("NegativeVolume")))
        assert volume == pytest.approx(BRICK - HOLE * 30 / 40 + 10 * 10 * 30)

    def test_parts_of_every_kind_without_a_helper_are_united(self, tmp_path):
        model = model_3mf("millimeter", [object_3mf(1, both())], [PLATE])
        volume, notes = cubic_mm(write_3mf(tmp_path / "a.3mf", model, **prusa("ModelPart")))
        assert volume == pytest.approx(BRICK + HOLE / 4)
        assert notes == ()

    @pytest.mark.parametrize(
        ("config", "word"),
        [
            (prusa("Turbo"), "volume of type 'Turbo'"),
            (bambu("negative_part"), "leave nothing"),
        ],
    )
    def test_what_cannot_be_meant_is_refused(self, config, word, tmp_path):
        if "Turbo" in str(config):
            model = model_3mf("millimeter", [object_3mf(1, both())], [PLATE])
        else:
            model = bambu_model().replace(object_3mf(1, brick()), object_3mf(1, block(10, 10, 10)))
        with pytest.raises(MeshError, match=word):
            load_mesh(write_3mf(tmp_path / "a.3mf", model, **config))

    def test_an_open_part_cannot_be_cut(self, tmp_path):
        text = object_3mf(1, both())
        text = text.replace(re.search(r"<triangle [^>]*>", text)[0], "", 1)
        config = prusa("NegativeVolume")
        config = {k: v.replace('"11"', '"10"').replace('"12"', '"11"') for k, v in config.items()}
        with pytest.raises(MeshError, match="not closed"):
            load_mesh(write_3mf(tmp_path / "a.3mf", model_3mf("millimeter", [text], [PLATE]), **config))

    @pytest.mark.parametrize(
        ("kind", "word"), [("support", "left out"), ("solidsupport", "left out"), ("surface", "'surface'")]
    )
    def test_objects_that_are_not_models(self, kind, word, tmp_path):
        other = object_3mf(2, helper()).replace("<object", f'<object type="{kind}"')
        items = [PLATE, '<item objectid="2"/>']
        path = write_3mf(tmp_path / "a.3mf", model_3mf("millimeter", [object_3mf(1, brick()), other], items))
        if kind == "surface":
            with pytest.raises(MeshError, match=word):
                load_mesh(path)
        else:
            volume, notes = cubic_mm(path)
            assert volume == pytest.approx(BRICK)
            assert word in " ".join(notes)

    @pytest.mark.parametrize(("value", "expected"), [("True", BRICK), ("False", BRICK + HOLE / 4)])
    def test_helpers_of_cura(self, value, expected, tmp_path):
        said = f'<metadatagroup><metadata name="cura:support_mesh">{value}</metadata></metadatagroup>'
        other = object_3mf(2, helper()).replace("<mesh>", said + "<mesh>")
        items = [PLATE, '<item objectid="2"/>']
        model = model_3mf("millimeter", [object_3mf(1, brick()), other], items)
        assert cubic_mm(write_3mf(tmp_path / "a.3mf", model))[0] == pytest.approx(expected)

    @pytest.mark.parametrize("shape", ["beamlattice", "bo:booleanshape"])
    def test_shapes_that_are_no_mesh_are_refused(self, shape, tmp_path):
        model = model_3mf("millimeter", [object_3mf(1, brick())], [PLATE])
        path = write_3mf(tmp_path / "a.3mf", model.replace("</mesh>", f"<{shape}/></mesh>"))
        with pytest.raises(MeshError, match=f"3MF {shape.rpartition(':')[2]}, which is not read"):
            load_mesh(path)


class TestPlate:
    def test_several_items_are_said(self, tmp_path):
        moved = '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 100 0 0"/>'
        model = model_3mf("millimeter", [object_3mf(1, brick())], [PLATE, moved])
        volume, notes = cubic_mm(write_3mf(tmp_path / "a.3mf", model))
        assert volume == pytest.approx(2 * BRICK)
        assert notes[0].startswith("2 items on its build plate")

    @pytest.mark.parametrize("word", ["printable", "slic3rpe:printable"])
    def test_what_is_not_printed_is_left_out(self, word, tmp_path):
        items = [PLATE, f'<item objectid="2" {word}="0"/>']
        model = model_3mf("millimeter", [object_3mf(1, brick()), object_3mf(2, block(90, 90, 90))], items)
        volume, notes = cubic_mm(write_3mf(tmp_path / "a.3mf", model))
        assert volume == pytest.approx(BRICK)
        assert notes == ("1 on its build plate left out (not printable)",)

    @pytest.mark.parametrize(
        ("items", "word"),
        [
            ([], "nothing solid is on its build plate$"),
            (['<item objectid="1" printable="0"/>'], "plate; 1 on its build plate left out"),
        ],
    )
    def test_a_plate_without_a_solid(self, items, word, tmp_path):
        model = model_3mf("millimeter", [object_3mf(1, brick())], items)
        with pytest.raises(MeshError, match=word):
            load_mesh(write_3mf(tmp_path / "a.3mf", model))

    def test_objects_of_other_model_files(self, tmp_path):
        """The same number stands for another object in each file; both transforms apply."""
        there = f'{PRODUCTION} p:path="/3D/Objects/part.model" objectid="2"'
        group = (
            f'<object id="1"><components><component {there} transform="0 1 0 -1 0 0 0 0 1 100 0 0"/>'
            "</components></object>"
        )
        items = ['<item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 7"/>']
        main = model_3mf("millimeter", [group, object_3mf(2, block(90, 90, 90))], items)
        other = model_3mf("inch", [object_3mf(2, brick())], ['<item objectid="2"/>'])
        found = load_mesh(write_3mf(tmp_path / "a.3mf", main, **{"3D/Objects/part.model": other}))
        assert found.vertices.min(axis=0) == pytest.approx([0.08, -0.03, -0.008])
        assert found.vertices.max(axis=0) == pytest.approx([0.12, 0.03, 0.022])
        assert found.notes == ()

    def test_a_mirrored_part_keeps_its_outside(self, tmp_path):
        items = ['<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>']
        found = load_mesh(
            write_3mf(tmp_path / "a.3mf", model_3mf("millimeter", [object_3mf(1, brick())], items))
        )
        assert found.repairs == ()
        assert signed_volume(found.vertices, found.faces) * 1e9 == pytest.approx(BRICK)

    def test_the_relations_decide_which_model_is_the_root(self, tmp_path):
        kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
        relations = f"<Relationships><Relationship Type='{kind}' Target='/3D/Main.model'/></Relationships>"
        main = model_3mf("millimeter", [object_3mf(1, brick())], [PLATE])
        wrong = model_3mf("millimeter", [object_3mf(1, helper())], [PLATE])
        path = write_3mf(tmp_path / "a.3mf", wrong, **{"_rels/.rels": relations, "3D/Main.model": main})
        assert cubic_mm(path)[0] == pytest.approx(BRICK)

    def test_utf16_is_read(self, tmp_path):
        text = model_3mf("millimeter", [object_3mf(1, brick())], [PLATE])
        data = f'<?xml version="1.0" encoding="UTF-16"?>{text}'.encode("utf-16")
        assert cubic_mm(write_3mf(tmp_path / "a.3mf", data))[0] == pytest.approx(BRICK)

    def test_numbers_are_kept(self, tmp_path):
        mesh = trimesh.creation.icosphere(2, 0.05)
        mesh.apply_translation((0.1, 0.2, 0.3))
        found = load_mesh(write_3mf(tmp_path / "a.3mf", model_3mf("meter", [object_3mf(1, mesh)], [PLATE])))
        assert set(map(tuple, found.vertices)) == set(map(tuple, np.array(mesh.vertices)))


class TestSmallFilesThatExpand:
    """Nothing is expanded before it is counted: one line, within a second."""

    @pytest.mark.parametrize(
        ("model", "others", "word"),
        [
            ("<model>" + "<a/>" * 2_000_001 + "</model>", {}, "XML tags"),
            (
                "<model>"
                + "".join(f'<item p:path="/{k}.model" objectid="1"/>' for k in range(9))
                + "</model>",
                {f"{k}.model": "<model>" + "<a/>" * 300_000 + "</model>" for k in range(9)},
                "XML tags",
            ),
            ("<model>" + "".join(f'<object id="{k}"/>' for k in range(400_000)) + "</model>", {}, "too many"),
            ("<model>" + "<a/>" * 6_000_000 + "</model>", {}, "unpack to"),
            (f"<model><!--{'x ' * 2_000_000}--></model>", {}, "over 1 MiB"),
            (f'<model><a b="{"x" * 4_000_000}"/></model>', {}, "over 1 MiB"),
        ],
        ids=["tags", "nine models", "objects", "ratio", "comment", "attribute"],
    )
    def test_refused(self, model, others, word, tmp_path):
        path = write_3mf(tmp_path / "a.3mf", model, **others)
        start = time.process_time()
        with pytest.raises(MeshError, match=word):
            load_mesh(path)
        assert time.process_time() - start < 1

    def test_a_damaged_bzip2_member(self, tmp_path):
        path = tmp_path / "a.3mf"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive:
            archive.writestr("3D/3dmodel.model", model_3mf("meter", [object_3mf(1, brick())], [PLATE]))
        data = bytearray(path.read_bytes())
        data[100] ^= 0xFF
        path.write_bytes(data)
        with pytest.raises(MeshError, match="deflate"):
            load_mesh(path)
