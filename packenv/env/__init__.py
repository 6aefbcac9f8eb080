"""The Gymnasium environment RobotPack-v0: :class:`packenv.PackEnv`, its configuration, episodes and orders.

May import view, execution, items, planning and sim; the agents, and whoever trains them, import it.
"""
