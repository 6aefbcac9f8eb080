"""Geometry: meshes, stable poses, conservative heightmaps, collision."""
