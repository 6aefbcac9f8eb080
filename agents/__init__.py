"""Agents for ``RobotPack-v0``: the paper's heuristics and planner, a random one, and a learned one."""

from .protocol import Agent
from .registry import NAMES, make

__all__ = ["NAMES", "Agent", "make"]
