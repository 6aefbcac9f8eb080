"""The paper's tables and figures, and ours: ``robotpack bench``. Rows that are never lost, on any number of workers.

An :class:`~packenv.experiments.experiment.Experiment` says which jobs it wants, what a job does and what its rows
say; :mod:`packenv.experiments.runner` does the jobs that have no row yet, on one of :mod:`packenv.backends`.
"""
