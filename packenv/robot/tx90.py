"""The TX90 as functions, until all callers are given a robot."""

from packenv.robot.files import default_cell
from packenv.robot.protocol import MAX_STEP, Branches, PathBranches

_ROBOT = default_cell().robot
link_frames, forward, inverse = _ROBOT.link_frames, _ROBOT.forward, _ROBOT.inverse
continuous_branches, continuous_branch = _ROBOT.continuous_branches, _ROBOT.continuous_branch
limit_margin, all_turns = _ROBOT.limit_margin, _ROBOT.all_turns

__all__ = ["MAX_STEP", "Branches", "PathBranches"]
