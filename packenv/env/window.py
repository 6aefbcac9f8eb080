"""A window that shows an environment's pictures."""

from __future__ import annotations

import contextlib
import io
import os
from typing import Any

from packenv.errors import InputError
from packenv.view.painter import Image


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
        instead = "render mode 'rgb_array' needs none"
        try:
            # It greets on standard output.
            with contextlib.redirect_stdout(io.StringIO()):
                import pygame
        except ImportError:
            raise InputError(
                "render mode 'human': the window needs the package pygame, which is not installed: "
                f"pip install pygame; {instead}"
            ) from None
        self._pygame: Any = pygame
        try:
            pygame.display.init()
            # Without a display SDL draws to nowhere.
            if pygame.display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
                pygame.display.quit()
                raise InputError(f"render mode 'human': there is no display; {instead}")
            self._surface = pygame.display.set_mode(size)
        except pygame.error as problem:
            raise InputError(f"render mode 'human': no window opens ({problem}); {instead}") from None
        pygame.display.set_caption("RobotPack")
        self._clock = pygame.time.Clock()
        self._fps = fps

    def show(self, picture: Image) -> None:
        """Bring the window up to date with a picture of its size."""
        self._pygame.event.pump()
        self._surface.blit(
            self._pygame.image.frombuffer(picture.tobytes(), picture.shape[1::-1], "RGB"), (0, 0)
        )
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close it; twice is fine."""
        self._pygame.display.quit()
