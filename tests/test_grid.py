"""The four numbers of the grid can be given on the command line, in the API and in the environment alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import pytest

import packenv as rp
from packenv.cli import main
from tests.shapes import box

FLAGS = {"cell_size": "--cell-size", "grid_step": "--grid-step", "n_poses": "--poses", "n_yaws": "--yaws"}


@pytest.mark.parametrize(
    ("name", "value", "right"),
    [
        ("cell_size", 0, "a number from 0.0002 to 0.05"),
        ("cell_size", 0.06, "a number from 0.0002 to 0.05"),
        ("grid_step", 0.003, "a multiple of cell_size"),
        ("grid_step", -0.01, "a number from 0"),
        ("n_poses", 0, "a whole number"),
        ("n_poses", -1, "a whole number"),
        ("n_yaws", 0, "a whole number"),
        ("n_yaws", 2.5, "a whole number"),
    ],
)
def test_a_wrong_one_is_one_line(
    name: str, value: float, right: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words: dict[str, Any] = {name: value}
    with pytest.raises(rp.InputError, match=rf"{name} is .*{right}"):
        rp.plan(rp.Order.of("brick"), rp.Container(0.2, 0.2, 0.2), {"brick": box(0.1, 0.05, 0.03)}, **words)
    with pytest.raises(rp.InputError, match=rf"grid: {name} is .*{right}"):
        gymnasium.make("RobotPack-v0", config={"grid": words})
    order = tmp_path / "order.csv"
    order.write_text("item,qty\ntennis_ball,1\n")
    try:
        code = main(["pack", str(order), f"{FLAGS[name]}={value}"])
    except SystemExit as left:  # what is no number at all is refused with the flags
        code = int(left.code or 0)
    assert code == 2
    said = capsys.readouterr().err
    assert right in said
    assert len(said.splitlines()) == 1


def test_a_right_one_counts() -> None:
    """Of twelve yaws one is 45° as of four, and there are others at which a rod fits across."""
    rod = {"rod": box(0.42, 0.02, 0.02, "rod")}
    plans = [
        rp.plan(rp.Order.of("rod"), rp.Container(0.40, 0.30, 0.10), rod, constraints="overlap", n_yaws=n)
        for n in (4, 12)
    ]
    assert [plan.complete for plan in plans] == [True, True]
    env = gymnasium.make("RobotPack-v0", config={"grid": {"n_yaws": 12, "n_poses": 2, "cell_size": 0.005}})
    grid = env.unwrapped.config.grid  # type: ignore[attr-defined]
    assert (grid.n_yaws, grid.n_poses, grid.cell_size, grid.grid_step) == (12, 2, 0.005, 0.01)
