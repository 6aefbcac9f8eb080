"""Limits of items in whole plans: what may not be on, beside or under another is not, and verify knows by itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import packenv as rp
from packenv.errors import InputError, MeshError, OrderError
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.types import Item

BOX = rp.Container(0.16, 0.16, 0.14)
"""One slab wide, and lower than a slab on edge: what comes next lies on it."""


def solid(size: tuple[float, float, float], name: str, mass: float, **words: Any) -> Item:
    return Item.from_trimesh(trimesh.creation.box(size), name, mass=mass, **words)


def slabs(**limits: ItemLimits) -> dict[str, Item]:
    """Two slabs that fill the floor, so that one must lie on the other, and a third."""
    masses = {"eggs": 0.6, "anvil": 3.0, "book": 0.9}
    return {
        name: solid((0.15, 0.15, 0.03 + 0.005 * k), name, kg, limits=limits.get(name, NO_LIMITS))
        for k, (name, kg) in enumerate(masses.items())
    }


def heights(plan: rp.Plan) -> dict[str, float]:
    return {p.item: float(p.corner[2]) for p in plan.placements}


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
@pytest.mark.parametrize("sequence", ["volume", "given"])
def test_nothing_lies_on_a_fragile_item(constraints: str, sequence: str) -> None:
    items = slabs(eggs=ItemLimits(fragile=True))
    order = rp.Order.of("anvil", "book", "eggs")
    plan = rp.plan(order, BOX, items, constraints=constraints, sequence=sequence)
    z = heights(plan)
    assert len(z) == 3
    assert z["eggs"] == max(z.values())
    assert rp.verify(plan, items).ok
    # First in the sequence it lies at the bottom, and what would lie on it has no place.
    first = rp.plan(
        rp.Order.of("eggs", "anvil"), BOX, items, constraints=constraints, sequence="given", restarts=0
    )
    assert [p.item for p in first.placements] == ["eggs"]
    assert first.leftovers[0].rejections.get("overload", 0) > 0
    assert "overload" in first.leftovers[0].detail


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
@pytest.mark.parametrize(("kg", "fits"), [(3.9, True), (3.0, True), (2.99, False), (0.0, False)])
def test_an_item_bears_what_it_may_and_no_more(constraints: str, kg: float, fits: bool) -> None:
    items = slabs(eggs=ItemLimits(max_load_kg=kg))
    order = rp.Order.of("eggs", "anvil")
    plan = rp.plan(order, BOX, items, constraints=constraints, sequence="given", restarts=0)
    assert plan.complete is fits
    assert rp.verify(plan, items).ok
    if fits:
        figures = plan.placements[1].details["loads" if constraints == "overlap" else "stability"]
        assert figures["loads"] == [{"step": 1, "kg": 3.0}]  # type: ignore[index]


def test_what_lies_on_what_lies_on_it_counts() -> None:
    items = slabs(eggs=ItemLimits(max_load_kg=3.5))
    plan = rp.plan(
        rp.Order.of("eggs", "anvil", "book"),
        BOX,
        items,
        constraints="stability",
        sequence="given",
        restarts=0,
    )
    assert [p.item for p in plan.placements] == ["eggs", "anvil"]


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_this_side_up(constraints: str) -> None:
    """A bottle that would rather lie: upright by its table it stands, on its head where that is asked."""
    mesh = trimesh.creation.cylinder(0.02, 0.12, sections=32)
    for axis, sign in (("z", 1.0), ("-z", -1.0)):
        items = {"bottle": Item.from_trimesh(mesh, "bottle", mass=0.3, limits=ItemLimits(upright=axis))}
        plan = rp.plan(rp.Order.of("bottle"), BOX, items, constraints=constraints)
        assert plan.placements[0].rotation[2, 2] == pytest.approx(sign, abs=1e-3)
        assert rp.verify(plan, items).ok
    free = {"bottle": Item.from_trimesh(mesh, "bottle", mass=0.3)}
    lying = rp.plan(rp.Order.of("bottle"), BOX, free, constraints=constraints)
    assert abs(lying.placements[0].rotation[2, 2]) < 0.1


def test_a_pose_that_is_seldom_landed_on_is_found_where_it_is_the_only_one() -> None:
    """Standing is the least probable pose of a tall bar of unequal sides; four are tried of others."""
    bar = trimesh.creation.box((0.03, 0.032, 0.12))
    items = {"bar": Item.from_trimesh(bar, "bar", mass=0.3, limits=ItemLimits(upright="z"))}
    plan = rp.plan(rp.Order.of("bar"), BOX, items, constraints="stability", grid=quick(n_poses=1))
    assert plan.placements[0].rotation[2, 2] == pytest.approx(1.0)


def quick(n_poses: int) -> Any:
    from packenv.config import GridConfig

    return GridConfig(n_poses=n_poses)


def test_an_item_that_cannot_stand_so_says_how_it_should() -> None:
    cone = trimesh.creation.cone(0.03, 0.08, sections=32)
    items = {"cone": Item.from_trimesh(cone, "cone", mass=0.2, limits=ItemLimits(upright="-z"))}
    (left,) = rp.plan(rp.Order.of("cone"), BOX, items, constraints="stability").leftovers
    assert left.reason == "no-usable-orientation"
    assert left.detail.startswith("cone must stand with its -z axis up, at most 5° off")
    tall = {"bar": solid((0.02, 0.02, 0.2), "bar", 0.2, limits=ItemLimits(upright="z"))}
    (left,) = rp.plan(rp.Order.of("bar"), rp.Container(0.3, 0.3, 0.1), tall).leftovers
    assert "must stand with its z axis up" in left.detail


def test_groups_that_are_kept_apart_share_no_box() -> None:
    items = slabs(eggs=ItemLimits(keep_apart="food"), anvil=ItemLimits(keep_apart="tools"))
    plan = rp.plan(
        rp.Order.of("eggs", "anvil", "book", "eggs"), BOX, items, constraints="stability", sequence="given"
    )
    assert sorted(p.item for p in plan.placements) == ["book", "eggs", "eggs"]
    (left,) = plan.leftovers
    assert (left.item, left.reason) == ("anvil", "kept-apart")
    assert left.detail == "anvil is kept apart (tools), and the box holds items of food"
    assert rp.verify(plan, items).ok


def test_limits_of_an_order_hold_beside_those_of_the_catalogue(tmp_path: Path) -> None:
    for name, item in slabs().items():
        item.to_trimesh().export(tmp_path / f"{name}.stl")
    rows = "eggs,eggs.stl,0.6,\nanvil,anvil.stl,3,\nbook,book.stl,0.9,yes\n"
    (tmp_path / "objects.csv").write_text(f"name,file,mass_kg,fragile\n{rows}")
    order = rp.Order.of("eggs", "book", "anvil", limits={"eggs": ItemLimits(max_load_kg=1.0)})
    plan = rp.plan(order, BOX, tmp_path, constraints="stability")
    z = heights(plan)
    assert z["anvil"] < z["eggs"] < z["book"]
    assert plan.meshes["eggs"].limits == ItemLimits(max_load_kg=1.0)
    assert plan.meshes["book"].limits == ItemLimits(fragile=True)
    rp.save_plan(plan, tmp_path / "plan.json")
    again = rp.load_plan(tmp_path / "plan.json")
    assert again.order == order.lines
    assert again.meshes == plan.meshes
    assert rp.verify(again).ok
    # The same catalogue, without the order's limits, has none of them.
    assert rp.load_catalogue(tmp_path).item("eggs").limits == NO_LIMITS
    with pytest.raises(OrderError, match="limits of 'mug', which the order does not ask for"):
        rp.Order.of("eggs", limits={"mug": ItemLimits(fragile=True)})


def test_a_plan_may_not_say_other_limits_than_the_catalogue(tmp_path: Path) -> None:
    for name, item in slabs().items():
        item.to_trimesh().export(tmp_path / f"{name}.stl")
    rows = "eggs,eggs.stl,0.6\nanvil,anvil.stl,3\nbook,book.stl,0.9\n"
    table = tmp_path / "objects.csv"
    table.write_text(f"name,file,mass_kg\n{rows}")
    words: dict[str, Any] = {"constraints": "stability", "sequence": "given", "restarts": 0}
    plan = rp.plan(rp.Order.of("eggs", "anvil"), BOX, tmp_path, **words)
    rp.save_plan(plan, tmp_path / "plan.json")
    assert rp.verify(rp.load_plan(tmp_path / "plan.json")).ok
    limits = "fragile,keep_apart,upright\neggs,eggs.stl,0.6,yes,food,-z\nanvil,anvil.stl,3,,tools,x\n"
    table.write_text(f"name,file,mass_kg,{limits}book,book.stl,0.9,,,\n")
    found = rp.verify(rp.load_plan(tmp_path / "plan.json"))
    assert not found.ok
    assert {(b.step, b.item, b.limit) for b in found.limits} == {
        (2, "eggs", "load"),
        (2, "anvil", "keep_apart"),
        (2, "anvil", "upright"),
        *({(1, "eggs", "upright")} if plan.placements[0].rotation[2, 2] > 0 else set()),
    }
    assert {c.where for c in found.claims} == {"meshes.eggs.limits", "meshes.anvil.limits"}
    assert json.loads(json.dumps(found.to_json()))["broken_limits"]


def test_what_lay_there_is_not_blamed_but_bears_no_more() -> None:
    items = slabs()
    words: dict[str, Any] = {"constraints": "stability", "sequence": "given", "restarts": 0}
    done = rp.plan(rp.Order.of("eggs", "anvil"), BOX, items, **words)
    limited = slabs(eggs=ItemLimits(max_load_kg=3.2))
    poses = [p.pose for p in done.placements]
    more = replace(done, leftovers=(rp.Leftover("book", 1, "given-up", "later"),))
    rest = rp.plan_rest(replace(more, order=rp.Order.of("eggs", "anvil", "book").lines), poses, limited)
    assert [left.item for left in rest.leftovers] == ["book"]
    strong = slabs(eggs=ItemLimits(max_load_kg=4.0))
    rest = rp.plan_rest(replace(more, order=rp.Order.of("eggs", "anvil", "book").lines), poses, strong)
    assert rest.complete


def test_a_centre_of_mass_is_the_users_own() -> None:
    items = {"bag": solid((0.1, 0.1, 0.1), "bag", 1.0, com=(0.03, 0.0, -0.02), friction=0.3)}
    assert items["bag"].com.tolist() == [0.03, 0.0, -0.02]
    assert items["bag"].friction == 0.3
    with pytest.raises(MeshError, match=r"\(0\.06, 0, 0\) m is 10 mm outside the item's hull"):
        solid((0.1, 0.1, 0.1), "bag", 1.0, com=(0.06, 0.0, 0.0))
    with pytest.raises(MeshError, match="give three finite numbers"):
        solid((0.1, 0.1, 0.1), "bag", 1.0, com=(np.nan, 0.0, 0.0))
    with pytest.raises(MeshError, match=r"its friction is 0\.0, give a number above 0"):
        solid((0.1, 0.1, 0.1), "bag", 1.0, friction=0.0)


def test_tables_give_centres_of_mass_and_friction(tmp_path: Path) -> None:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "a.stl")
    table = tmp_path / "objects.csv"
    table.write_text("name,file,com_x_m,com_y_m,com_z_m,friction\na,a.stl,0.01,-0.02,0,0.4\nb,a.stl,,,,\n")
    found = rp.load_catalogue(tmp_path)
    assert found.item("a").com.tolist() == [0.01, -0.02, 0.0]
    assert (found.item("a").friction, found.item("b").friction) == (0.4, None)
    assert found.item("b").com == pytest.approx(np.zeros(3), abs=1e-12)
    table.write_text("name,file,com_x_m,com_y_m,com_z_m\na,a.stl,0.01,,0\n")
    with pytest.raises(InputError, match="column 'com_y_m' is empty"):
        rp.load_catalogue(tmp_path)
