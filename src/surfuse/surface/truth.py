"""True heights from a mesh: what a perfect profiler would see from the side of the sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from surfuse.errors import DataError
from surfuse.geometry import mesh_files
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, IntArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.grids import extended_grid

RIM_M = 2e-6
"""How far beside a node the surface is looked for when the ray through the node itself just misses its rim."""

WALL = 0.03
"""Cosine between w and the normal of a triangle below which it is a wall: 1.7 degrees from upright.

Where on a wall a ray ends is a matter of micrometres of the part frame, not of the surface: a node on a wall has the
height of its upper edge.
"""


def read_truth_mesh(path: Path) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3) in the file's frame and unit, and triangles (F, 3), of a mesh file.

    Raises
    ------
    DataError : unreadable, not a mesh, no triangles, too many, or vertices that are not finite.
    """
    soup = mesh_files.read_mesh(path)
    return soup.vertices_m, soup.triangles


def check_mesh(vertices_m: FloatArray, faces: IntArray, where: str = "truth") -> None:
    """Refuse a mesh that no ray can meet.

    `vertices_m` (V, 3) in m, `faces` (F, 3); `where` names the file in the message.

    Raises
    ------
    DataError : there are no triangles, or one has a vertex that is not finite.
    """
    if len(faces) == 0 or len(vertices_m) == 0:
        raise DataError("the mesh has no triangles", cure="give a surface mesh", where=where)
    if not np.all(np.isfinite(vertices_m[np.unique(faces)])):
        raise DataError("the mesh has vertices that are not finite", cure="repair the mesh", where=where)


def truth_from_mesh(vertices_m: FloatArray, faces: IntArray, grid: MapGrid) -> SurfaceMap:
    """Height of the outermost surface over each node: rays along -w from outside, first hit.

    The mesh is in the world frame of the readings. Nodes that no ray meets are masked; a node on the rim of the mesh
    belongs to it. Heights are computed in double precision on the triangle that was hit. sigma is 0: truth.

    `vertices_m` (V, 3) in m, `faces` (F, 3).
    """
    check_mesh(vertices_m, faces)
    part = transform_points(inverse(grid.world_from_part), vertices_m)
    corners = part[faces]
    # Embree works in single precision: near the origin it loses least.
    centre = 0.5 * (part[np.unique(faces)].min(axis=0) + part[np.unique(faces)].max(axis=0))
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(corners - centre, dtype=np.float32))
    top = float(np.max(corners[..., 2])) - centre[2] + 0.01
    u, v = (axis.ravel() for axis in np.meshgrid(grid.u_m, grid.v_m))
    height = np.full(len(u), np.nan)
    for du, dv in ((0.0, 0.0), (1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        open_nodes = np.flatnonzero(np.isnan(height))
        if len(open_nodes):
            nodes = np.column_stack([u[open_nodes], v[open_nodes]])
            height[open_nodes] = _first_hits(scene, corners, nodes, RIM_M * np.array([du, dv]), centre, top)
    return _truth_map(height.reshape(grid.shape), grid)


def _first_hits(
    scene: EmbreeScene, corners: FloatArray, uv: FloatArray, beside: FloatArray, centre: FloatArray, top: float
) -> FloatArray:
    """Heights (N,) at nodes uv (N, 2) of the triangles that rays along -w, shifted by `beside` (2,), meet first; nan
    where they meet none.
    """
    origins = np.column_stack([uv + beside - centre[:2], np.full(len(uv), top)]).astype(np.float32)
    directions = np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(uv), 1))
    hit = np.asarray(scene.run(origins, directions), dtype=np.int64)
    height = np.full(len(uv), np.nan)
    met = np.flatnonzero(hit >= 0)
    a, b, c = np.moveaxis(corners[hit[met]], 1, 0)
    normal = np.cross(b - a, c - a)
    steep = np.abs(normal[:, 2]) <= WALL * np.linalg.norm(normal, axis=1)
    offset = np.sum(normal[:, :2] * (uv[met] - a[:, :2]), axis=1)
    on_plane = a[:, 2] - offset / np.where(steep, 1.0, normal[:, 2])
    # A ray that meets a wall has met its upper edge; elsewhere the plane is exact up to the rim's offset.
    lowest, highest = np.minimum(np.minimum(a, b), c)[:, 2], np.maximum(np.maximum(a, b), c)[:, 2]
    height[met] = np.where(steep, highest, np.clip(on_plane, lowest, highest))
    return height


def _truth_map(height: FloatArray, grid: MapGrid) -> SurfaceMap:
    mask = np.isfinite(height)
    return SurfaceMap(
        grid=grid,
        height_m=height,
        sigma_m=np.where(mask, 0.0, np.nan),
        confidence=mask.astype(np.float64),
        count=mask.astype(np.int64),
        mask=mask,
        regime=np.where(mask, int(Regime.MEASURED), int(Regime.EMPTY)).astype(np.uint8),
        method="truth",
    )


def truth_around(vertices_m: FloatArray, faces: IntArray, grid: MapGrid) -> SurfaceMap:
    """Truth on the grid of a map, continued over the whole true part: what a map is scored against.

    `vertices_m` (V, 3) in m, `faces` (F, 3), both in the world frame. The nodes of the map are nodes of the truth.
    """
    check_mesh(vertices_m, faces)
    part = transform_points(inverse(grid.world_from_part), vertices_m[np.unique(faces)])[:, :2]
    return truth_from_mesh(vertices_m, faces, extended_grid(grid, part.min(axis=0), part.max(axis=0)))
