"""Plan files: what is written is what is read, and every damaged plan is one line that names the place."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packenv as rp
from packenv.errors import InputError, PlanError
from packenv.io.plans import read_plan, write_plan
from packenv.types import Container, Leftover, MeshRecord, OrderLine, Placement, Plan
from tests.memory_samples import QUICK
from tests.mesh_samples import block, write_mesh


def _plan(seed: int = 0, catalogue: str = "builtin") -> Plan:
    rng = np.random.default_rng(seed)
    placements = tuple(
        Placement(
            item=f"thing {k % 2}",
            instance=k // 2 + 1,
            rotation=Rotation.random(random_state=rng).as_matrix(),
            position=rng.normal(size=3),
            corner=rng.random(3),
            extents=rng.random(3),
            pose_index=k,
            yaw=float(rng.random()),
            score=float(rng.normal()),
            candidates=int(rng.integers(1, 1000)),
        )
        for k in range(4)
    )
    return Plan(
        container=Container(0.32, 0.31, 0.3),
        placements=placements,
        leftovers=(Leftover("pole", 1, "larger-than-container", "pole is larger"),),
        settings={"heuristic": "hm", "cell_size": 0.002},
        metrics={"packed": 4, "utilization": 0.25},
        catalogue=catalogue,
        order=(OrderLine("thing 0", 2), OrderLine("thing 1", 2), OrderLine("pole", 1)),
        meshes={
            name: MeshRecord(f"{name}.ply", "ab" * 32, 1e-3, 0.5, True, friction=friction)
            for name, friction in (("thing 0", None), ("thing 1", 0.3), ("pole", None))
        },
    )


def test_reading_gives_back_what_was_written(tmp_path: Path) -> None:
    plan = _plan()
    write_plan(tmp_path / "p.json", plan)
    again = read_plan(tmp_path / "p.json")
    assert again.container == plan.container
    assert again.leftovers == plan.leftovers
    assert (again.settings, again.metrics, again.order, again.meshes, again.catalogue) == (
        plan.settings,
        plan.metrics,
        plan.order,
        plan.meshes,
        plan.catalogue,
    )
    for a, b in zip(again.placements, plan.placements, strict=True):
        np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-15)
        for name in ("position", "corner", "extents"):
            assert getattr(a, name).tolist() == getattr(b, name).tolist()
        for name in ("item", "instance", "pose_index", "yaw", "score", "candidates", "route"):
            assert getattr(a, name) == getattr(b, name)


def test_only_an_item_with_its_own_friction_says_so(tmp_path: Path) -> None:
    write_plan(tmp_path / "p.json", _plan())
    meshes = json.loads((tmp_path / "p.json").read_text())["meshes"]
    assert {name: mesh.get("friction") for name, mesh in meshes.items() if "friction" in mesh} == {
        "thing 1": 0.3
    }


def test_same_plan_same_bytes(tmp_path: Path) -> None:
    for name in ("a.json", "b.json"):
        write_plan(tmp_path / name, _plan())
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_the_catalogue_is_found_from_wherever_the_plan_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shelf").mkdir()
    (tmp_path / "plans").mkdir()
    monkeypatch.chdir(tmp_path)
    write_plan(tmp_path / "plans" / "p.json", _plan(catalogue="shelf"))
    assert json.loads((tmp_path / "plans" / "p.json").read_text())["catalogue"] == "../shelf"
    monkeypatch.chdir("/")
    assert (
        Path(read_plan(tmp_path / "plans" / "p.json").catalogue).resolve() == (tmp_path / "shelf").resolve()
    )


@pytest.mark.parametrize("written", ["NFC", "NFD"])
@pytest.mark.parametrize("on_disk", ["NFC", "NFD"])
def test_names_are_the_same_in_every_normal_form(written: str, on_disk: str, tmp_path: Path) -> None:
    """File systems and editors mix them: in the catalogue, in the plan, or in both."""
    name = "Krüg"
    write_mesh(tmp_path / f"{unicodedata.normalize(on_disk, name)}.ply", block())
    order = rp.Order.of(*[unicodedata.normalize(on_disk, name)] * 3)
    planned = rp.plan(order, rp.Container(0.11, 0.07, 0.1), str(tmp_path), constraints="overlap", **QUICK)
    assert planned.placements
    assert planned.leftovers
    path = tmp_path / "p.json"
    rp.save_plan(planned, path)
    text = json.dumps(json.loads(path.read_text()), ensure_ascii=False)
    path.write_text(unicodedata.normalize(written, text), encoding="utf-8")
    loaded = rp.load_plan(path)
    names = {p.item for p in loaded.placements} | {left.item for left in loaded.leftovers} | {*loaded.meshes}
    assert names == {unicodedata.normalize("NFC", name)}
    assert rp.verify(loaded).ok


def _set(*path: str | int, value: object) -> Callable[[dict], None]:
    def damage(document: dict) -> None:
        place: object = document
        for key in path[:-1]:
            place = place[key]  # type: ignore[index]
        place[path[-1]] = value  # type: ignore[index]

    return damage


def _drop(*path: str | int) -> Callable[[dict], None]:
    def damage(document: dict) -> None:
        place: object = document
        for key in path[:-1]:
            place = place[key]  # type: ignore[index]
        del place[path[-1]]  # type: ignore[attr-defined]

    return damage


@pytest.mark.parametrize(
    ("damage", "names"),
    [
        (_drop("schema_version"), "schema_version"),
        (_set("schema_version", value=99), "99"),
        (_drop("steps"), "steps"),
        (_set("steps", value={}), "steps"),
        (_set("steps", 1, "position", value=[0, 1]), "steps[1].position"),
        (_set("steps", 1, "position", value=[0, 1, "2"]), "steps[1].position"),
        (_set("steps", 2, "quat_xyzw", value=[0, 0, 0, 2]), "steps[2].quat_xyzw"),
        (_set("meshes", "pole", "friction", value=0), "meshes.pole.friction"),
        (_set("meshes", "pole", "friction", value="rough"), "meshes.pole.friction"),
        (_set("meshes", "pole", "friction", value=None), "meshes.pole.friction"),
        (_set("steps", 0, "step", value=3), "steps[0].step"),
        (_set("steps", 0, "item", value="ghost"), "ghost"),
        (_set("steps", 0, "instance", value=0), "steps[0].instance"),
        (_set("steps", 3, "score", value=True), "steps[3].score"),
        (_drop("steps", 3, "yaw"), "steps[3]"),
        (_set("schema_version", value=True), "True"),
        (_set("schema_version", value=1.0), "1.0"),
        (_set("steps", 1, "yaw", value=10**400), "steps[1].yaw"),
        (_set("steps", 1, "position", value=[1e308, 0, 0]), "steps[1].position"),
        (_set("steps", 2, "instance", value=1), "steps[2].instance"),
        (_set("steps", 2, "instance", value=3), "steps[2].instance"),
        (_set("units", "length", value="ft"), "units"),
        (_set("order", value=[]), "order"),
        (_set("container", "size", value=[0.3, 0.3]), "container.size"),
        (_set("container", "size", value=[0.3, 0.3, -1]), "height"),
        (_set("order", 0, "qty", value=1.5), "order[0].qty"),
        (_drop("meshes", "pole", "sha256"), "meshes.pole"),
        (_set("leftovers", 0, "reason", value=7), "leftovers[0].reason"),
    ],
)
def test_a_damaged_plan_is_refused(tmp_path: Path, damage: Callable[[dict], None], names: str) -> None:
    path = tmp_path / "p.json"
    write_plan(path, _plan())
    document = json.loads(path.read_text())
    damage(document)
    path.write_text(json.dumps(document))
    with pytest.raises(PlanError) as caught:
        read_plan(path)
    assert names in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe\x00", b"null", b'{"schema_version": NaN}'])
def test_what_is_no_plan_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "p.json"
    path.write_bytes(content)
    with pytest.raises(PlanError, match=r"p\.json"):
        read_plan(path)


def test_nan_in_a_pose_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    write_plan(path, _plan())
    document = json.loads(path.read_text())
    document["steps"][0]["position"][2] = float("nan")
    path.write_text(json.dumps(document))
    with pytest.raises(PlanError, match=r"steps\[0\]\.position"):
        read_plan(path)


def test_a_missing_plan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="nowhere"):
        read_plan(tmp_path / "nowhere.json")


def test_nothing_is_left_behind_when_writing_fails(tmp_path: Path) -> None:
    folder = tmp_path / "p.json"
    folder.mkdir()
    with pytest.raises(InputError, match=r"p\.json"):
        write_plan(folder, _plan())
    assert [entry.name for entry in tmp_path.iterdir()] == ["p.json"]
