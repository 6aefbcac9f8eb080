"""What a box may hold: no plan is heavier, verify adds up by itself, and the next box takes what is too much."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import packenv as rp
from packenv.errors import ContainerError, PlanError
from packenv.io.containers import read_boxes

SIDE = 0.05


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    """Five blocks of 0.1, 0.2, 0.4, 0.8 and 1.6 kg."""
    trimesh.creation.box((SIDE, SIDE, SIDE)).export(tmp_path / "block.stl")
    rows = [f"b{k},block.stl,{0.1 * 2**k}" for k in range(5)]
    (tmp_path / "objects.csv").write_text("\n".join(["name,file,mass_kg", *rows]) + "\n")
    return tmp_path


@pytest.mark.parametrize("heuristic", ["auto", "hm"])
def test_no_plan_is_heavier_than_its_box_may_be(blocks: Path, heuristic: str) -> None:
    rng = np.random.default_rng(0)
    for _ in range(12):
        order = rp.Order.of(*(f"b{k}" for k in rng.integers(0, 5, 6)))
        most = float(rng.uniform(0.3, 4.0))
        box = rp.Container(0.2, 0.2, 0.2, max_kg=most)
        plan = rp.plan(order, box, blocks, constraints="overlap", heuristic=heuristic)
        masses = [plan.meshes[p.item].mass for p in plan.placements]
        assert sum(masses) <= most + 1e-9
        assert rp.verify(plan, blocks).ok
        for left in plan.leftovers:
            assert left.reason == "box-overweight"
            assert plan.meshes[left.item].mass + sum(masses) > most
        assert len(masses) + len(plan.leftovers) == 6


def test_verify_adds_up_by_itself(blocks: Path) -> None:
    plan = rp.plan(rp.Order.of("b3", "b3", "b3"), rp.Container(0.2, 0.2, 0.2), blocks, constraints="overlap")
    claimed = replace(plan, container=replace(plan.container, max_kg=1.7))
    found = rp.verify(claimed, blocks)
    assert not found.ok
    assert found.overweight == (3,)
    assert found.to_json()["overweight_steps"] == (3,)


def test_the_limit_is_read_kept_and_refused(blocks: Path, tmp_path: Path) -> None:
    table = tmp_path / "boxes.csv"
    table.write_text("box_id,length_m,width_m,height_m,max_kg\nsmall,0.2,0.2,0.2,1\nlarge,0.3,0.3,0.2,\n")
    small, large = read_boxes(table)
    assert (small.max_kg, large.max_kg) == (1.0, None)
    # The small box could hold both by their size.
    plan = rp.plan(rp.Order.of("b3", "b2"), [small, large], blocks)
    assert plan.container.name == "large"
    alone = rp.plan(rp.Order.of("b3"), small, blocks)
    rp.save_plan(alone, tmp_path / "p.json")
    assert rp.load_plan(tmp_path / "p.json", blocks).container == small
    document = json.loads((tmp_path / "p.json").read_text())
    document["container"]["max_kg"] = -1
    (tmp_path / "p.json").write_text(json.dumps(document))
    with pytest.raises(PlanError, match="max_kg is -1, give kilograms above 0"):
        rp.load_plan(tmp_path / "p.json", blocks)
    table.write_text("box_id,length_m,width_m,height_m,max_kg\nsmall,0.2,0.2,0.2,heavy\n")
    with pytest.raises(ContainerError, match="max_kg"):
        read_boxes(table)
