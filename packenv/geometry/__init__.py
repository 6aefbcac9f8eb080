"""Surfaces of solid items: mesh files and their repair, stable poses, heightmaps, distances, convex parts, collision.

May import nothing of packenv but its records, configuration and errors.
"""
