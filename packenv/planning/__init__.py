"""From items and a container to placements: the planner, its options, and the three questions it asks.

``search`` finds and scores the places, ``stability`` and ``manipulation`` are the constraints on them. May import
geometry and robot; knows nothing of physics, files or catalogues.
"""
