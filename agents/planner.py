"""The paper's planner as an agent."""

from __future__ import annotations

from packenv.env.observation import HEURISTIC_COLUMNS
from packenv.errors import InputError
from packenv.planning.packing_pass import MAX_CHECKED

from .heuristics import RankAgent


class PlannerAgent(RankAgent):
    """The sequential planner with fallback (paper Alg. 3 and 4), one action at a time.

    It takes the first valid candidate in the order of the heuristic if that is among the first
    ``max_checked`` legal ones, else it defers. *Defer* is Alg. 4's way into U; when the item comes back, the
    environment offers its stable poses on the pile of now, then the perturbed ones group by group. So with
    physics off it places exactly as :meth:`packenv.planning.planner.Planner.pack` does without restarts, by
    the rule of stability of the environment.
    """

    def __init__(self, heuristic: str = "hm", max_checked: int = MAX_CHECKED) -> None:
        """Choose the planner.

        Args:
            heuristic: one of :data:`packenv.env.observation.HEURISTIC_COLUMNS`.
            max_checked: the paper's N; beyond that of the environment's configuration it only asks for what
                happens to be among the candidates.

        Raises:
            InputError: an unknown heuristic, or ``max_checked`` below 1.
        """
        if heuristic not in HEURISTIC_COLUMNS:
            raise InputError(
                f"planner: heuristic is {heuristic!r}, give one of {', '.join(HEURISTIC_COLUMNS)}"
            )
        if max_checked < 1:
            raise InputError(f"planner: max_checked is {max_checked}, give at least 1")
        super().__init__(heuristic, below=max_checked)
