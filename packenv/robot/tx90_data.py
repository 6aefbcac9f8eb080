"""The TX90's limits, until all callers are given a robot."""

from packenv.robot.files import default_cell

_ROBOT = default_cell().robot
LOWER, UPPER, VELOCITY = _ROBOT.lower, _ROBOT.upper, _ROBOT.velocity
LINK_MASSES = _ROBOT.link_masses  # type: ignore[attr-defined]
