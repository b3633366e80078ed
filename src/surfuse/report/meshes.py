"""Triangles for the 3-D scene: a map as a surface seen from both sides, a link of the arm as a rod."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.poses import transform_points
from surfuse.records import FloatArray, IntArray, SurfaceMap
from surfuse.report.packing import stride_for, thinned


def map_mesh(
    surface: SurfaceMap, most_nodes: int, layer: FloatArray | None = None
) -> tuple[FloatArray, IntArray, FloatArray]:
    """A map in the world frame: vertices (N, 3), triangles (F, 3), heights (N,); cells with a missing corner are holes.

    With a layer (R, C) its values come in place of the heights. The value of a vertex that only the prior gives is
    nan, so that its colour is that of no value. At most about `most_nodes` nodes are used.
    """
    stride = stride_for(surface.height_m.size, most_nodes, 2)
    rows, columns = (thinned(n, stride) for n in surface.grid.shape)
    height = np.where(surface.mask, surface.height_m, np.nan)[np.ix_(rows, columns)]
    u, v = np.meshgrid(surface.grid.u_m[columns], surface.grid.v_m[rows])
    known = np.isfinite(height)
    number = np.full(height.shape, -1, dtype=np.int64)
    number[known] = np.arange(int(known.sum()))
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    whole = np.all([corner >= 0 for corner in corners], axis=0)
    a, b, c, d = (corner[whole] for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices = transform_points(surface.grid.world_from_part, np.stack([u, v, height], axis=-1)[known])
    held = surface.measured[np.ix_(rows, columns)]
    values = height if layer is None else layer[np.ix_(rows, columns)]
    return vertices, faces, np.where(held, values, np.nan)[known]


def both_windings(vertices_m: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh twice, the second time turned inside out: single-sided viewers then show it from behind too.

    Vertices (2 V, 3) in m and triangles (2 F, 3), of (V, 3) and (F, 3).
    """
    return np.concatenate([vertices_m, vertices_m]), np.concatenate([faces, faces[:, ::-1] + len(vertices_m)])


def rod(length_m: float, radius_m: float, sides: int = 14) -> tuple[FloatArray, IntArray]:
    """A closed rod along z from 0 to `length_m`: vertices (2 * sides + 2, 3), triangles.

    In m; triangles (4 * sides, 3), wound counter-clockwise from outside.
    """
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    top = np.array([0.0, 0.0, length_m])
    vertices = np.concatenate([ring, ring + top, [[0.0, 0.0, 0.0]], [top]])
    k = np.arange(sides)
    after = (k + 1) % sides
    foot, head = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    faces = [
        (k, after, after + sides),
        (k, after + sides, k + sides),
        (after, k, foot),
        (k + sides, after + sides, head),
    ]
    return vertices, np.concatenate([np.stack(face, axis=1) for face in faces])


def quaternion_to(direction: FloatArray) -> FloatArray:
    """Shortest turn (w, x, y, z) of the z axis to a unit direction (3,)."""
    x, y, z = (float(part) for part in direction)
    if z < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + z, -y, x, 0.0])
    result: FloatArray = quaternion / np.linalg.norm(quaternion)
    return result
