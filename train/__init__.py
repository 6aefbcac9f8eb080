"""Training of policies for ``RobotPack-v0``: ``python -m packenv.train --timesteps 20000 --out DIR``."""
