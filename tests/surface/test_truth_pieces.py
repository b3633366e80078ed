"""Pieces of a mesh under an outline."""

from __future__ import annotations

import numpy as np
import trimesh

from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.records import Outline
from surfuse.surface.truth_pieces import pieces_of_part

PART = pose(rotation_about([0, 0, 1], 0.4), [1.0, 0.2, 1.0])
OUTLINE = Outline([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], PART)


def boxes(*places):
    meshes = [trimesh.creation.box((0.1, 0.1, 0.02)).apply_translation(place) for place in places]
    mesh = trimesh.util.concatenate(meshes)
    return transform_points(PART, np.array(mesh.vertices)), np.array(mesh.faces)


def test_one_piece_stays_as_it_is():
    vertices, faces = boxes((5.0, 5.0, 0.0))
    found = pieces_of_part(vertices, faces, OUTLINE)
    assert found[0] is vertices
    assert found[1] is faces


def test_pieces_elsewhere_go_and_all_of_the_part_stays():
    vertices, faces = boxes((0.0, 0.1, 0.0), (0.5, 0.1, 0.0), (0.14, 0.1, 0.05))
    found, triangles = pieces_of_part(vertices, faces, OUTLINE)
    assert (len(found), len(triangles)) == (16, 24)
    seen = transform_points(np.linalg.inv(PART), found)
    assert seen[:, 0].max() < 0.2


def test_without_any_overlap_all_stay():
    vertices, faces = boxes((0.5, 0.1, 0.0), (0.9, 0.1, 0.0))
    assert len(pieces_of_part(vertices, faces, OUTLINE)[1]) == 24
