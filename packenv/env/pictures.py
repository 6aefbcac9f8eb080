"""What an environment shows: pictures of the cell, and a window for them."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packenv.errors import InputError
from packenv.robot.cell import Cell
from packenv.types import FloatArray, Item, Pose
from packenv.view.stage import Stage

SIZE = (480, 480)
"""Width and height, px."""
_PARKED = 0.06
"""How far above the rim the cup waits at home, m."""


class Artist:
    """Draws packings in a cell, the robot where it is or at home."""

    def __init__(self, cell: Cell) -> None:
        """Prepare what stays.

        Args:
            cell: robot and container.
        """
        self.cell = cell
        self._stage = Stage(cell, SIZE)
        self._home = _home(cell)

    def draw(
        self, placed: Sequence[tuple[Item, Pose]], joints: FloatArray | None = None
    ) -> NDArray[np.uint8]:
        """One moment.

        Args:
            placed: what is in the container, in packing sequence.
            joints: (6,) of the robot, rad; None puts the cup above the middle of the rim.

        Returns:
            (480, 480, 3) sRGB.
        """
        return self._stage.draw(placed, self._home if joints is None else joints)


def _home(cell: Cell) -> FloatArray | None:
    """Joints with the cup above the middle of the rim; None where the arm does not get there."""
    length, width, height = cell.container.size
    found = cell.clear_branches(cell.top_down_path(np.array([length / 2, width / 2, height + _PARKED]), 0.0))
    return found.q[0, 0] if len(found.q) else None


class Window:
    """Shows pictures by pygame, as Gymnasium's own environments do."""

    def __init__(self, fps: int) -> None:
        """Open it.

        Args:
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
            self._surface = pygame.display.set_mode(SIZE)
        except pygame.error as problem:
            raise InputError(f"render mode 'human': no window opens ({problem}); {instead}") from None
        pygame.display.set_caption("RobotPack")
        self._clock = pygame.time.Clock()
        self._fps = fps

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Bring the window up to date with a (480, 480, 3) picture."""
        self._pygame.event.pump()
        self._surface.blit(self._pygame.image.frombuffer(picture.tobytes(), SIZE, "RGB"), (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close it; twice is fine."""
        self._pygame.display.quit()
