"""A window that shows an environment's pictures."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from packenv.errors import InputError

if TYPE_CHECKING:
    from packenv.view.painter import Image

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")


def _display() -> bool:
    return sys.platform != "linux" or any(os.environ.get(name) for name in _DISPLAYS)


class Window:
    """Shows pictures by pygame, as Gymnasium's own environments do."""

    def __init__(self, size: tuple[int, int], fps: int) -> None:
        """Open it.

        Args:
            size: (width, height), px.
            fps: most pictures a second; :meth:`show` waits for as long as that takes.

        Raises:
            InputError: pygame is not installed, or there is no display.
        """
        needs, instead = "render mode 'human' needs", "'rgb_array' needs neither"
        try:
            # It greets on standard output.
            with contextlib.redirect_stdout(io.StringIO()):
                import pygame
        except ImportError:
            raise InputError(
                f"{needs} the package pygame, which is not installed, and a display: "
                f"pip install pygame; {instead}"
            ) from None
        self._pygame: Any = pygame
        # Without a display SDL complains at length, and then draws to nowhere.
        if not _display():
            raise InputError(f"{needs} a display, and there is none ({_DISPLAYS[0]} is not set); {instead}")
        try:
            pygame.display.init()
            if pygame.display.get_driver() == "offscreen" != os.environ.get("SDL_VIDEODRIVER"):
                pygame.display.quit()
                raise pygame.error("SDL finds none")
            self._surface = pygame.display.set_mode(size)
        except pygame.error as problem:
            raise InputError(f"{needs} a display, and no window opens ({problem}); {instead}") from None
        pygame.display.set_caption("RobotPack")
        self._clock = pygame.time.Clock()
        self._fps = fps

    @staticmethod
    def possible() -> bool:
        """Whether there are a display and pygame, as far as can be told without opening a window."""
        return _display() and find_spec("pygame") is not None

    def show(self, picture: Image) -> None:
        """Bring the window up to date with a picture of its size."""
        self._pygame.event.pump()
        drawn = self._pygame.image.frombuffer(picture.tobytes(), picture.shape[1::-1], "RGB")
        self._surface.blit(drawn, (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close it; twice is fine."""
        self._pygame.display.quit()
