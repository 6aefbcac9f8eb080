"""Limits of items in the environment: no masked candidate breaks one, and what no box takes is left over."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from packenv.env.observation import HEAVIEST_ITEM, ITEM_FEATURES
from packenv.env.orders import GeneratedOrder
from packenv.env.pack_env import PackEnv
from packenv.errors import OrderError
from packenv.items.plan_items import options_of, shelf_of
from packenv.limits import ItemLimits
from packenv.types import Container
from packenv.verification.limits import broken_limits
from tests.env_samples import ITEMS, make_env, random_action, run_episode
from tests.shapes import box

UPRIGHT, FRAGILE = ItemLimits(upright=True), ItemLimits(fragile=True)


class Limited:
    """Orders of :data:`ITEMS` with limits that are drawn for each."""

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        kinds = (
            UPRIGHT,
            ItemLimits(upright="x"),
            FRAGILE,
            ItemLimits(max_load_kg=0.1),
            ItemLimits(keep_apart="food"),
            ItemLimits(keep_apart="tools"),
        )
        names = [str(name) for name in rng.permutation(ITEMS)]
        picked = rng.choice(len(kinds), 4)
        limits = {name: kinds[k] for name, k in zip(names, picked.tolist(), strict=False)}
        return GeneratedOrder(tuple(names), limits=limits)


class Always:
    """The same order every time."""

    def __init__(self, order: GeneratedOrder) -> None:
        self.order = order

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        return self.order


@pytest.mark.parametrize(("mask", "episodes"), [("legal", 12), ("stable", 8), ("robot", 4)])
def test_random_episodes_keep_every_limit(mask: str, episodes: int) -> None:
    env = make_env(mask=mask, order_generator=Limited())
    rng = np.random.default_rng(5)
    placed = 0
    for seed in range(episodes):
        for _ in run_episode(env, rng, seed=seed):
            pass
        plan = env.plan()
        shelf = shelf_of(plan)
        assert all(shelf.items[line.item].limits == line.limits for line in plan.order)
        assert broken_limits(plan, shelf.shapes, shelf.fields, options_of(plan)) == ()
        placed += len(plan.placements)
    env.close()
    assert placed > 2 * episodes


def test_without_their_limits_such_episodes_break_some() -> None:
    """So the law above can fail."""
    order = GeneratedOrder(tuple(reversed(ITEMS)))
    env = make_env(mask="legal", order_generator=Always(order), sequence="given")
    rng = np.random.default_rng(5)
    broken: set[str] = set()
    for seed in range(8):
        for _ in run_episode(env, rng, seed=seed):
            pass
        plan = env.plan()
        shelf = env._shelf.with_limits(
            {
                **dict.fromkeys(ITEMS[::2], ItemLimits(upright="x", fragile=True, keep_apart="a")),
                **dict.fromkeys(ITEMS[1::2], ItemLimits(keep_apart="b")),
            }
        )
        found = broken_limits(plan, shelf.shapes, shelf.fields, options_of(plan))
        broken |= {each.limit for each in found}
    env.close()
    assert broken == {"upright", "load", "keep_apart"}


def test_what_is_kept_apart_is_refused_and_left_over_with_its_reason() -> None:
    limits = {"tuna_can": ItemLimits(keep_apart="food"), "golf_ball": ItemLimits(keep_apart="tools")}
    order = GeneratedOrder(("tuna_can", "soap_bar", "golf_ball"), limits=limits)
    env = make_env(mask="legal", sequence="given", order_generator=Always(order))
    obs, info = env.reset(seed=0)
    refused = ITEM_FEATURES.index("refused")
    assert obs["remaining"][:, refused].tolist() == [0.0] * 8
    obs, *_ = env.step(int(np.flatnonzero(obs["action_mask"])[0]))
    assert obs["remaining"][:3, refused].tolist() == [0.0, 1.0, 0.0]
    _, _, terminated, _, info = env.step(int(np.flatnonzero(obs["action_mask"])[0]))
    assert terminated
    assert info["left_over"] == ["golf_ball"]
    (left,) = env.plan().leftovers
    assert left.reason == "kept-apart"
    assert "food" in left.detail
    env.close()


def test_a_container_takes_no_more_than_its_max_kg() -> None:
    crates = {f"crate{k}": box(0.05, 0.05, 0.02, f"crate{k}") for k in range(3)}
    mass = crates["crate0"].mass
    container = Container(0.16, 0.12, 0.10, max_kg=2.5 * mass)
    order = GeneratedOrder(tuple(crates), crates, container)
    env = make_env(mask="legal", order_generator=Always(order))
    rng = np.random.default_rng(0)
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        action = int(rng.choice(np.flatnonzero(obs["action_mask"][:-1])))
        obs, _, ended, _, info = env.step(action)
    assert info["packed_items"] == 2
    assert [left.reason for left in env.plan().leftovers] == ["box-overweight"]
    env.close()


def test_the_observation_tells_the_limits() -> None:
    limits = {
        "tuna_can": ItemLimits(upright=True, max_tilt_deg=20, max_load_kg=1.5),
        "golf_ball": FRAGILE,
    }
    order = GeneratedOrder(("tuna_can", "golf_ball", "soap_bar"), limits=limits)
    env = make_env(mask="legal", sequence="given", order_generator=Always(order))
    obs, _ = env.reset(seed=0)
    told = [dict(zip(ITEM_FEATURES, row.tolist(), strict=True)) for row in obs["remaining"]]
    assert [t["max_tilt"] for t in told[:3]] == pytest.approx([math.radians(20), math.pi, math.pi])
    assert [t["bears"] for t in told[:3]] == [1.5, 0.0, HEAVIEST_ITEM]
    assert not obs["remaining"][3:].any()
    env.close()


def test_limits_of_order_files_are_kept_and_of_the_next_file_only_its_own(tmp_path: Path) -> None:
    first, second = tmp_path / "1.csv", tmp_path / "2.csv"
    first.write_text("item,qty,fragile,keep_apart\ntuna_can,1,yes,food\nsoap_bar,1,,\n")
    second.write_text("item,qty\ntuna_can,1\nsoap_bar,1\n")
    env = make_env(mask="legal", order_generator={"kind": "file", "path": str(tmp_path)})
    seen = []
    for k in range(4):
        env.reset(seed=0 if k == 0 else None)
        plan = env.plan()
        seen.append({line.item: line.limits for line in plan.order}["tuna_can"])
        assert plan.meshes["tuna_can"].limits == seen[-1]
    env.close()
    assert seen == [ItemLimits(fragile=True, keep_apart="food"), ItemLimits()] * 2


def test_limits_of_a_catalogue_are_kept(tmp_path: Path) -> None:
    for name in ("plate", "brick"):
        box(0.06, 0.05, 0.02, name).to_trimesh().export(tmp_path / f"{name}.stl")
    table = "name,file,unit,fragile\nplate,plate.stl,m,yes\nbrick,brick.stl,m,\n"
    (tmp_path / "objects.csv").write_text(table)
    env = PackEnv(
        {
            "catalogue": str(tmp_path),
            "containers": [[0.064, 0.054, 0.045]],
            "mask": "stable",
            "sequence": "given",
            "candidates": 12,
        },
        order_generator={"kind": "list", "items": ["plate", "brick", "brick"]},
    )
    obs, _ = env.reset(seed=0)
    _, _, terminated, _, info = env.step(random_action(obs["action_mask"][:-1], np.random.default_rng(0)))
    assert terminated
    assert info["left_over"] == ["brick", "brick"]
    env.close()


def test_a_pickled_environment_keeps_the_limits_of_its_order() -> None:
    order = GeneratedOrder(("tuna_can", "soap_bar"), limits={"tuna_can": FRAGILE})
    env = make_env(mask="legal", order_generator=Always(order))
    obs, _ = env.reset(seed=0)
    env.step(random_action(obs["action_mask"][:-1], np.random.default_rng(0)))
    again = pickle.loads(pickle.dumps(env))
    assert again.plan().meshes["tuna_can"].limits == FRAGILE
    assert again.action_masks().tolist() == env.action_masks().tolist()
    env.close()
    again.close()


def test_limits_of_an_unknown_item_are_refused_in_one_line() -> None:
    order = GeneratedOrder(("tuna_can",), limits={"tuna": FRAGILE})
    env = make_env(order_generator=Always(order))
    with pytest.raises(OrderError, match="'tuna'") as caught:
        env.reset(seed=0)
    assert "\n" not in str(caught.value)
    env.close()
