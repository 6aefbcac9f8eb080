"""One reader a mesh format, strict: a truncated or damaged file is an error, never a partial mesh.

trimesh reads binary STL, PLY and GLB and the numbers of text STL; ``by_trimesh`` calls it, and the reader
of the format is the gate before it, which refuses what trimesh (5.2) would read wrongly in silence. Tables
of polygons (``rows``: OFF, text PLY, binary PLY of mixed polygons; ``obj``) and ``threemf`` are read here,
because a gate has to take every row apart, or walk every reference, to know that trimesh reads it right.
What the formats have in common is in ``raw``; which reader takes which file is decided in
``packenv.geometry.mesh_files``.
"""
