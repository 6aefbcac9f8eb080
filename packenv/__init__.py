"""RobotPack: plan, check, execute and learn the packing of real, non-convex items with a robot arm.

Importing this package registers the Gymnasium environment ``RobotPack-v0``.
"""

from gymnasium.envs.registration import register as _register

__version__ = "0.1.0"

_register("RobotPack-v0", entry_point="packenv.env:PackEnv")
