"""One reader a mesh format.

They are strict where common loaders are lenient: a truncated or damaged file is an error that says
where, never an empty or partial mesh. What the formats have in common is in ``raw``; which reader
takes which file is decided in ``packenv.geometry.mesh_files``.

Why not trimesh, which the tests write their files with and compare against (version 5.2): it loads
truncated text STL and OBJ files as empty or partial meshes, cuts dented polygons outside their edge,
reads GLB data that are sparse, missing or negative as if they were sound, leaves out GLB parts that hang
on a camera or whose transform holds NaN, and in 3MF files takes every object of a referenced model for
the one that is named, passes over objects that are not there, stops part-way through nested components
and does not return from ones nested in a circle. A check of all that in front of it has to know each
format as well as a reader does.
"""
