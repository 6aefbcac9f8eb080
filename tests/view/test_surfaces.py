"""Surfaces as pictures need them: smooth where they are round, sharp at their edges."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from packenv.types import Container, Pose
from packenv.view.surfaces import box_surfaces, item_surface, surface_of
from tests.shapes import ball, box, cylinder


def test_flat_sides_are_sharp_and_lie_where_the_mesh_has_them() -> None:
    item = box(0.1, 0.2, 0.3)
    surface = item_surface(item)
    corners = surface.vertices[surface.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    for k in range(3):
        assert surface.normals[surface.faces[:, k]] == pytest.approx(outward, abs=1e-9)
    assert len(np.unique(surface.parts)) == 6
    expected, found = (np.sort(c.reshape(len(c), 9), axis=0) for c in (item.vertices[item.faces], corners))
    assert found == pytest.approx(expected)


def test_a_solid_whose_every_edge_is_sharp_is_flat_on_every_side() -> None:
    mesh = trimesh.creation.icosahedron().convex_hull
    for solid, sides in ((trimesh.Trimesh(np.vstack([np.zeros(3), np.eye(3)])).convex_hull, 4), (mesh, 20)):
        surface = surface_of(solid)
        assert len(np.unique(surface.parts)) == sides
        a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
        for k in range(3):
            across = np.einsum("ij,ij->i", surface.normals[surface.faces[:, k]], [b - a, c - b, a - c][k])
            assert across == pytest.approx(0.0, abs=1e-9)


def test_faces_without_area_and_open_meshes_are_drawn_too() -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    for faces in (np.vstack([mesh.faces, [[0, 0, 1], [2, 2, 2]]]), mesh.faces[:3], mesh.faces[:1]):
        surface = surface_of(trimesh.Trimesh(mesh.vertices, faces, process=False))
        assert len(surface.faces) == len(surface.parts) == len(faces)
        assert len(surface.normals) == len(surface.vertices)
        assert np.isfinite(surface.normals).all()


def test_a_ball_is_one_smooth_part() -> None:
    surface = item_surface(ball(0.05))
    radial = surface.vertices / np.linalg.norm(surface.vertices, axis=1)[:, None]
    assert (surface.normals * radial).sum(axis=1).min() > 0.999
    assert len(np.unique(surface.parts)) == 1


def test_a_cylinder_has_a_round_part_and_two_flat_ones() -> None:
    surface = item_surface(cylinder(0.04, 0.12))
    assert len(np.unique(surface.parts)) == 3
    assert np.unique(np.round(np.abs(surface.normals[:, 2]), 6)).tolist() == [0.0, 1.0]


def test_a_surface_is_kept_and_moved_by_copies() -> None:
    item = ball(0.05)
    surface = item_surface(item)
    assert item_surface(item) is surface
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = surface.at(Pose(turn, np.array([1.0, 2.0, 3.0])), (1, 2, 3))
    assert moved.colour == (1, 2, 3)
    assert moved.vertices == pytest.approx(surface.vertices @ turn.T + [1.0, 2.0, 3.0])
    assert moved.normals == pytest.approx(surface.normals @ turn.T)
    assert item_surface(item) is surface


def test_the_box_is_open_above_and_seen_from_inside() -> None:
    container = Container(0.3, 0.2, 0.1)
    floor, walls = box_surfaces(container)
    for surface, area in ((floor, 0.06), (walls, 0.1)):
        mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
        assert mesh.area == pytest.approx(area)
        assert (mesh.triangles_center[:, 2] == 0.0).all() == (surface is floor)
        assert (mesh.triangles_center[:, 2] < 0.09).all()
        middle = surface.vertices[surface.faces].mean(axis=1)
        inward = np.array(container.size) / 2 - middle
        assert (np.einsum("ij,ij->i", surface.normals[surface.faces[:, 0]], inward) > 0).all()
        a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), inward) > 0).all()
        assert not surface.shadow
