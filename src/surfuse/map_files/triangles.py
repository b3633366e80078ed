"""A map as a triangle mesh: two triangles for every square of four nodes with a value, in the part frame.

Normals point out of the part (+w). Nodes that belong to no such square are left out of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.records import BoolArray, FloatArray, IntArray, SurfaceMap


@dataclass(frozen=True)
class MapMesh:
    """Vertices (N, 3) m in the part frame, triangles (T, 3), and the layers at the vertices (N,).

    `measured` (N,) is false where only the prior gives the vertex its height.

    `confidence` in [0, 1] and `sigma_m` in m are the layers.
    """

    vertices_m: FloatArray
    triangles: IntArray
    confidence: FloatArray
    sigma_m: FloatArray
    measured: BoolArray


def mesh_of(surface: SurfaceMap, with_prior: bool = False) -> MapMesh:
    """Triangulate the measured cells of a map; with those that only the prior fills, for formats that can mark them.

    Raises
    ------
    DataError : no four measured nodes form a square, so there is no triangle to write.
    """
    full = surface.mask if with_prior else surface.measured
    square = full[:-1, :-1] & full[:-1, 1:] & full[1:, :-1] & full[1:, 1:]
    r, c = np.nonzero(square)
    if len(r) == 0:
        raise DataError(
            f"the map has {int(full.sum())} measured nodes, but no four of them form a cell: there is no surface",
            cure="export to .csv or .nc instead",
        )
    columns = full.shape[1]
    a = r * columns + c
    b, d, e = a + 1, a + columns, a + columns + 1
    corner = np.concatenate([np.column_stack([a, b, e]), np.column_stack([a, e, d])])
    used, triangles = np.unique(corner, return_inverse=True)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    points = np.column_stack([u.ravel(), v.ravel(), surface.height_m.ravel()])
    return MapMesh(
        vertices_m=points[used],
        triangles=triangles.reshape(-1, 3),
        confidence=surface.confidence.ravel()[used],
        sigma_m=surface.sigma_m.ravel()[used],
        measured=surface.measured.ravel()[used],
    )
