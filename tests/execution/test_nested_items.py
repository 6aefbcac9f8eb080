"""What nests by plan stays nested in physics: bowls, and cups as close as their walls allow."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

import packenv as rp
from benchmarks.shells import Shell, cup, polygon

MM = 1e-3
SIDES = 16
CUP = cup(
    foot=25 * MM,
    height=100 * MM,
    half_angle=math.atan(0.15),
    wall=2.24 * MM,
    floor=2 * MM,
    ring=partial(polygon, sides=SIDES),
)


@pytest.fixture(scope="module")
def cups(tmp_path_factory: pytest.TempPathFactory) -> rp.Catalogue:
    """A folder with the cup, and the convex parts that it is made of: its floor, and its wall facet by facet."""
    folder = tmp_path_factory.mktemp("cups")
    CUP.item("cup").to_trimesh().export(folder / "cup.ply")
    (folder / "cup.parts.obj").write_text(parts_obj(CUP))
    (folder / "objects.csv").write_text("name,file,parts_file,mass_kg\ncup,cup.ply,cup.parts.obj,0.043\n")
    return rp.load_catalogue(folder)


def parts_obj(shell: Shell) -> str:
    """The convex parts of a cup as an OBJ."""
    outline = [*shell.outside, *reversed(shell.inside)]
    rings = [np.column_stack([shell.ring(size), np.full(SIDES, z)]) for size, z in outline]
    parts = [np.vstack([rings[0], rings[-1]])]
    parts += [np.vstack([ring[[k, (k + 1) % SIDES]] for ring in rings]) for k in range(SIDES)]
    lines = []
    for k, part in enumerate(parts):
        lines += [f"o part_{k}", *("v {:.12f} {:.12f} {:.12f}".format(*vertex) for vertex in part)]
    return "\n".join([*lines, ""])


def executed(plan: rp.Plan, catalogue: rp.Catalogue | str) -> np.ndarray:
    """How far each item ends from its plan, sideways and up, m, after a success."""
    report = rp.verify(plan, catalogue)
    assert plan.complete
    assert report.ok
    assert not report.recheck.unstable_steps
    done = rp.execute(plan, catalogue)
    assert done.success, done.verdict
    moved = np.array(
        [after.position - p.position for after, p in zip(done.measured, plan.placements, strict=True)]
    )
    return np.column_stack([np.hypot(moved[:, 0], moved[:, 1]), moved[:, 2]])


@pytest.mark.parametrize("constraints", ["stability", "robot"])
def test_three_nested_bowls_stay_where_they_were_planned(constraints: str) -> None:
    plan = rp.plan(rp.Order.of(*["bowl"] * 3), rp.Container(0.17, 0.17, 0.12), constraints=constraints)
    moved = executed(plan, "builtin")
    assert np.abs(moved).max() < 2 * MM


@pytest.mark.parametrize("size", [(0.09, 0.09, 0.2), (0.08, 0.08, 0.2)], ids=["with room", "none"])
def test_six_nested_cups_stay_where_they_were_planned(cups: rp.Catalogue, size: tuple[float, ...]) -> None:
    """The engine keeps 0.2 mm between walls, a millimetre and a half straight up where they are this steep."""
    plan = rp.plan(rp.Order.of(*["cup"] * 6), rp.Container(*size), cups)
    bottoms = np.array([p.corner[2] for p in plan.placements])
    assert np.diff(bottoms) == pytest.approx(CUP.pitch, abs=1e-5)
    moved = executed(plan, cups)
    assert moved[:, 0].max() < 2 * MM
    risen = np.diff(moved[:, 1])
    assert np.all((risen > -0.1 * MM) & (risen < 2 * MM))
