"""A gate before trimesh for each mesh format: a truncated or damaged file is an error, never a partial mesh.

trimesh reads the numbers; the gate counts what a file announces before anything is expanded, refuses by name
what trimesh (5.2) would read wrongly without a word, and ``read_mesh`` holds what was read against the count.
3MF has a reader of its own.
"""
