"""What an agent sees: the observation space of ``RobotPack-v0``, and how its arrays are filled.

All lengths are in metres, volumes in m³, masses in kg, angles in rad. Every array is float32 and inside the
bounds that its space declares.
"""

from __future__ import annotations

HEURISTIC_COLUMNS = ("hm", "dblf", "mta", "minz", "first-fit")
"""Heuristics whose scores and ranks the candidates tell, by name of :data:`packenv.planning.scores.HEURISTICS`."""

FEATURES: tuple[str, ...] = (
    "present",
    "x",
    "y",
    "z",
    "length",
    "width",
    "height",
    "yaw",
    "pose",
    "probability",
    "perturbed",
    "com_height",
    "support_margin",
    *(f"score_{name}" for name in HEURISTIC_COLUMNS),
    *(f"rank_{name}" for name in HEURISTIC_COLUMNS),
)
"""Columns of ``candidates``."""

ITEM_FEATURES: tuple[str, ...] = (
    "present",
    "length",
    "width",
    "height",
    "volume",
    "mass",
    "share_filled",
    "deferred",
)
"""Columns of ``items``."""

STATE_FEATURES: tuple[str, ...] = (
    "length",
    "width",
    "height",
    "utilization",
    "packed_share",
    "left_share",
    "stage",
)
"""Entries of ``state``; ``left_share`` is of the items still to come, the current one included."""
