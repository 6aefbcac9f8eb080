"""Damaged plans: one line, or a plan that can be verified, whatever the verdict."""

from __future__ import annotations

import os
from pathlib import Path
from random import Random

import pytest

import packenv as rp
from packenv.planning.options import PlanOptions
from packenv.verification.report import Verification
from tests.fuzz.mutations import damaged
from tests.fuzz.runner import MakeOne, Reads, check, fuzz
from tests.mesh_samples import write_three

QUICK = {"heuristic": "hm", "restarts": 0, "cell_size": 0.004, "grid_step": 0.012, "n_poses": 1, "n_yaws": 2}
WAYS = ({}, {"constraints": "stability"}, {"constraints": "overlap", "geometry": "parts"})


TABLE = """name,file,mass_kg,upright,max_load_kg,fragile,keep_apart,friction
brick,brick.ply,0.4,,3,,tools,
book,book.ply,,z,,,,0.4
can,can.ply,0.2,,,yes,tools,
"""
ORDER = "item,qty,max_load_kg\nbrick,1,2\nbook,1,\ncan,2,\n"


def one_plan(folder: Path) -> MakeOne:
    """How a damaged plan is made, read and verified: plans for a robot, without one, and on convex parts."""
    os.environ["ROBOTPACK_CACHE"] = str(folder / "cache")
    shelf = folder / "shelf"
    shelf.mkdir()
    write_three(shelf)
    (shelf / "objects.csv").write_text(TABLE)
    (folder / "order.csv").write_text(ORDER)
    order = rp.load_order(folder / "order.csv", str(shelf))
    sound = []
    for k, way in enumerate(WAYS):
        options = PlanOptions.from_mapping({**QUICK, **way})
        made = rp.plan(order, rp.Container(0.13, 0.10, 0.08, max_kg=9.0), shelf, options)
        assert made.placements
        assert made.leftovers
        path = folder / f"sound{k}.json"
        rp.save_plan(made, path)
        assert _verified(path).ok
        sound.append(path.read_bytes())

    def one(rng: Random) -> tuple[str, Reads]:
        k = rng.randrange(len(sound))
        target = folder / "damaged.json"
        target.write_bytes(damaged(".json", sound[k], rng))
        return f"plan {k}", lambda: _verified(target)

    return one


def _verified(path: Path) -> Verification:
    return rp.verify(rp.load_plan(path))


@pytest.mark.parametrize("count", [100, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_damaged_plan_is_verified_or_one_line(count: int) -> None:
    check(fuzz(one_plan, count, count), count, least_read=0.05)
