"""What the environment shows: frames, and a window that says in one line why there is none."""

from __future__ import annotations

import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from packenv.env.window import Window
from packenv.errors import InputError
from tests.env_samples import CONFIG, ORDER, best_action, make_env


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """A window that draws to nowhere, as on a machine without a display, where that is asked for."""
    pytest.importorskip("pygame", reason="pygame is not installed")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def test_the_frame_shows_the_container_and_grows_with_the_items() -> None:
    env = make_env(mask="legal", render_mode="rgb_array")
    obs, _ = env.reset(seed=0)
    empty = env.render()
    assert empty.shape == (480, 480, 3)
    assert empty.dtype == np.uint8
    env.step(best_action(obs))
    assert (env.render() != empty).any(axis=2).mean() > 0.001
    env.reset(seed=0, options={"container": (0.1, 0.1, 0.1)})
    assert (env.render() != empty).any(axis=2).mean() > 0.05
    env.close()


def test_two_environments_draw_the_same() -> None:
    frames = []
    for _ in range(2):
        env = make_env(mask="legal", render_mode="rgb_array")
        obs, _ = env.reset(seed=3)
        env.step(best_action(obs))
        frames.append(env.render())
        env.close()
    assert np.array_equal(*frames)


@pytest.mark.usefixtures("nowhere")
def test_gymnasiums_checks_pass_with_pictures() -> None:
    """They make the environment again in each of its render modes."""
    config = {**CONFIG, "mask": "legal"}
    env = gymnasium.make("RobotPack-v0", config=config, order_generator=ORDER, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("missing", ["display", "pygame"])
def test_gymnasiums_checks_pass_where_no_window_can_open(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if missing == "pygame":
        monkeypatch.setitem(sys.modules, "pygame", None)
    elif not sys.platform.startswith("linux"):
        pytest.skip("there is always a display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    env = gymnasium.make("RobotPack-v0", config={**CONFIG, "mask": "legal"}, order_generator=ORDER)
    check_env(env.unwrapped)
    assert env.unwrapped.metadata["render_modes"] == ["rgb_array"]
    env.close()


@pytest.mark.usefixtures("nowhere")
def test_the_window_shows_the_frames() -> None:
    import pygame

    env, same = (make_env(mask="legal", render_mode=mode) for mode in ("human", "rgb_array"))
    obs, _ = env.reset(seed=0)
    same.reset(seed=0)
    for environment in (env, same):
        environment.step(best_action(obs))
    assert env.render() is None
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
    assert np.array_equal(shown, same.render())
    env.close()
    env.close()
    assert pygame.display.get_surface() is None
    same.close()


def test_a_window_without_a_display_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame", reason="pygame is not installed")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    if not sys.platform.startswith("linux"):
        pytest.skip("there is always a display")
    env = make_env(mask="legal", render_mode="human")
    with pytest.raises(InputError, match="a display, and there is none") as caught:
        env.reset(seed=0)
    assert "\n" not in str(caught.value)
    assert "rgb_array" in str(caught.value)
    monkeypatch.setenv("DISPLAY", "nowhere:7")
    with pytest.raises(InputError, match="no window opens") as caught:
        env.reset(seed=0)
    assert "\n" not in str(caught.value)
    env.close()


def test_a_window_without_pygame_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(InputError, match="pip install pygame") as caught:
        Window((480, 480), 4)
    assert "\n" not in str(caught.value)
    assert "rgb_array" in str(caught.value)
