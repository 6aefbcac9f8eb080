"""Physics: the one package that imports an engine (PyBullet or MuJoCo, :mod:`packenv.sim.engines`)."""
