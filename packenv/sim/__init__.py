"""Physics: the one package that imports pybullet."""

from packenv.quiet import engine_muted

with engine_muted():
    # PyBullet tells its build time when it is first imported.
    import pybullet  # noqa: F401
