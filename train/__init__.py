"""Training of placement policies for ``RobotPack-v0``: ``python -m train --timesteps 20000 --out DIR``."""
