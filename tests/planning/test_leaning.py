"""Items that fit a container only when they lean: they are packed, and where they are not, the reason is true."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest

import packenv as rp
from packenv.env.observation import FEATURES
from packenv.env.orders import GeneratedOrder
from tests.shapes import box

LONG = {"rod": box(0.5, 0.016, 0.016, "rod"), "brick": box(0.05, 0.04, 0.03, "brick")}
BOX = (0.32, 0.32, 0.30)


def plan(order: list[str], container: tuple[float, float, float] = BOX, **words: object) -> rp.Plan:
    """The plan of an order, after its audit."""
    made = rp.plan(rp.Order.of(*order), rp.Container(*container), LONG, margins=False, **words)
    assert rp.verify(made, LONG).ok
    return made


@pytest.mark.parametrize(
    "words",
    [
        {"constraints": "overlap"},
        {"constraints": "stability"},
        {"constraints": "stability", "stability": "margin"},
        {"constraints": "stability", "search": "5d"},
    ],
)
@pytest.mark.parametrize("container", [BOX, (0.40, 0.20, 0.30)])
def test_a_rod_leans_on_the_space_diagonal(
    words: dict[str, str], container: tuple[float, float, float]
) -> None:
    assert np.linalg.norm(container[:2]) < 0.5 < np.linalg.norm(container)
    (placed,) = plan(["rod"], container, **words).placements
    assert placed.corner[2] == 0.0
    axis = placed.rotation[:, 0]
    assert 0.2 < abs(axis[2]) < 0.8  # neither lying nor upright


def test_it_leans_beside_what_stands_there() -> None:
    assert plan(["rod", "brick", "brick"], constraints="stability").complete


def test_what_no_cup_can_hold_leaning_is_not_called_too_large() -> None:
    made = plan(["rod", "brick"], constraints="robot")
    assert [left.reason for left in made.leftovers] == ["no-graspable-spot"]
    assert "larger" not in made.leftovers[0].detail
    assert [p.item for p in made.placements] == ["brick"]


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_too_large_is_what_fits_at_no_rotation(constraints: str) -> None:
    made = plan(["rod"], (0.28, 0.28, 0.29), constraints=constraints)  # a diagonal of 0.491 m
    assert [left.reason for left in made.leftovers] == ["larger-than-container"]
    assert "every orientation" in made.leftovers[0].detail


@pytest.mark.parametrize("constraints", ["overlap", "robot"])
def test_where_no_other_rotations_are_looked_at_nothing_is_said_of_them(constraints: str) -> None:
    container = (0.40, 0.26, 0.1)
    made = plan(["rod"], container, constraints=constraints, heights="map")
    assert [left.reason for left in made.leftovers] == ["no-fitting-orientation"]
    assert "every tried orientation" in made.leftovers[0].detail


class Rods:
    """Orders of one rod."""

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """The order."""
        return GeneratedOrder(("rod",), meshes=LONG)


def test_the_environment_lets_it_lean() -> None:
    config = {"mask": "stable", "heights": "mesh", "containers": [list(BOX)]}
    env = gymnasium.make("RobotPack-v0", config=config, order_generator=Rods())
    obs, info = env.reset(seed=0)
    assert env.observation_space.contains(obs)
    row = dict(zip(FEATURES, obs["candidates"][int(np.argmax(info["action_mask"]))], strict=True))
    assert (row["perturbed"], row["probability"]) == (1.0, 0.0)
    _, _, terminated, _, info = env.step(int(np.argmax(info["action_mask"])))
    assert terminated
    assert info["packed_items"] == 1
    made = env.unwrapped.plan()  # type: ignore[attr-defined]
    assert rp.verify(made, LONG).ok


@pytest.mark.parametrize("size", [(1.2, 0.8, 0.8), (0.4, 0.3, 0.4)])
def test_an_environment_out_of_reach_says_so_once_and_ends(size: tuple[float, float, float]) -> None:
    env = gymnasium.make("RobotPack-v0", config={"containers": [list(size)]}, order_generator=Rods())
    with pytest.warns(UserWarning, match=r"nothing can be packed.*links are never all higher than 0\.375 m"):
        _, info = env.reset(seed=0)
    assert info["left_over"] == ["rod"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, info = env.reset(seed=1)
    assert info["action_mask"].sum() == 1
    _, _, terminated, truncated, _ = env.step(int(np.argmax(info["action_mask"])))
    assert (terminated, truncated) == (True, False)
    left = env.unwrapped.plan().leftovers  # type: ignore[attr-defined]
    assert [row.reason for row in left] == ["unreachable-container"]
