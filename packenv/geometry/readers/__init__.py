"""One reader a mesh format.

They are strict where common loaders are lenient: a truncated or damaged file is an error that says
where, never an empty or partial mesh. What the formats have in common is in ``raw``; which reader
takes which file is decided in ``packenv.geometry.mesh_files``.
"""
