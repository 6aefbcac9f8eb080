"""Generators of orders of a user's own: by object, and by name."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import packenv  # noqa: F401
from packenv.env.orders import GeneratedOrder, ListedOrder, RandomOrders, make_generator
from packenv.errors import InputError
from tests.env_samples import CONFIG, ITEMS, Drawn, make_env, run_episode

OWN = """
from packenv.env.orders import GeneratedOrder

class Pair:
    def __init__(self, name="soap_bar"):
        self.name = name
    def generate(self, rng):
        return GeneratedOrder((self.name, "golf_ball"))

class Greedy(Pair):
    def __init__(self, names):
        self.names = names

class Callable(Pair):
    def __call__(self):
        raise AssertionError

class Makers:
    make = staticmethod(lambda: Pair("foam_brick"))

def make():
    return Pair("tuna_can")

def fail():
    raise ValueError("out of\\norders")

def forget():
    Pair()

def names(rng):
    return ["soap_bar"]

class Names:
    generate = staticmethod(names)

a_pair, called = Pair("foam_brick"), Callable()
NUMBER = 3
"""


@pytest.fixture
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of a module in the current folder."""
    (tmp_path / "own_orders_of_mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    yield "own_orders_of_mine"
    sys.modules.pop("own_orders_of_mine", None)


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("Pair", "soap_bar"),
        ("make", "tuna_can"),
        ("Makers.make", "foam_brick"),
        ("a_pair", "foam_brick"),
        ("called", "soap_bar"),
    ],
)
def test_a_name_is_a_class_a_function_or_a_generator(own_module: str, name: str, first: str) -> None:
    generator = make_generator(f"{own_module}:{name}", ITEMS)
    assert generator.generate(np.random.default_rng(0)).items == (first, "golf_ball")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Pear", "did you mean 'Pair'"),
        ("Greedy", "cannot be made without arguments: TypeError"),
        ("fail", "cannot be made without arguments: ValueError: out of orders"),
        ("forget", "is None, give an object with generate"),
        ("NUMBER", "is 3, give an object with generate"),
    ],
)
def test_a_wrong_name_is_told_in_one_line(own_module: str, name: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        make_env(order_generator=f"{own_module}:{name}")
    assert str(caught.value).startswith(f"order_generator {own_module}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("choice", [3, [], ["soap_bar"], Drawn])
def test_what_is_no_generator_is_told_in_one_line(choice: Any) -> None:
    with pytest.raises(
        InputError, match=r"order_generator is .*, give a specification, an object with"
    ) as caught:
        make_env(order_generator=choice)
    assert "\n" not in str(caught.value)


def test_an_order_that_is_none_is_told_in_one_line(own_module: str) -> None:
    env = make_env(order_generator=f"{own_module}:Names")
    with pytest.raises(InputError, match=r"generate returned \['soap_bar'\], give a .*GeneratedOrder"):
        env.reset(seed=0)


def test_a_specification_an_object_and_nothing_are_as_they_were() -> None:
    own = Drawn()
    assert make_generator(own, ITEMS) is own
    assert make_generator({"kind": "list", "items": ["soap_bar"]}, ITEMS) == ListedOrder(("soap_bar",))
    for nothing in (None, {}):
        assert make_generator(nothing, ITEMS) == RandomOrders(ITEMS, (10, 10))


def test_names_go_through_gymnasium_and_json() -> None:
    env = gymnasium.make(
        "RobotPack-v0",
        config={**CONFIG, "mask": "legal"},
        order_generator="tests.env_samples:Drawn",
        reward_fn="tests.env_samples:volume_alone",
    )
    assert env.spec is not None
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    again = gymnasium.make(spec)
    obs, info = env.reset(seed=3)
    same, info_again = again.reset(seed=3)
    for key, seen in obs.items():
        np.testing.assert_array_equal(seen, same[key])
    assert info["items_left"] + len(info["left_over"]) == 3
    assert "reward_custom" in info
    assert info_again["item"] == info["item"]
    env.close()
    again.close()


def test_an_environment_with_a_named_generator_pickles_in_the_midst_of_an_episode() -> None:
    env = make_env(mask="legal", order_generator="tests.env_samples:Drawn")
    steps = run_episode(env, np.random.default_rng(0), seed=0)
    next(steps)
    copy = pickle.loads(pickle.dumps(env))
    rng = np.random.default_rng(1)
    for one, other in zip(run_episode(env, rng), run_episode(copy, np.random.default_rng(1)), strict=True):
        assert one[0] == other[0]
        assert one[2] == other[2]
        assert one[5]["item"] == other[5]["item"]


def test_an_order_of_ones_own_is_what_comes() -> None:
    class Mine:
        def generate(self, rng: np.random.Generator) -> GeneratedOrder:
            return GeneratedOrder(("golf_ball",))

    _, info = make_env(mask="legal", order_generator=Mine()).reset(seed=0)
    assert (info["item"], info["items_left"]) == ("golf_ball", 1)
