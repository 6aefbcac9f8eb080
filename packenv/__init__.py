"""RobotPack: plan, check, execute and learn the packing of real, non-convex items with a robot arm."""

__version__ = "0.1.0"
