"""Where the surface is sought: rasters over the part, from the outline or, without one, from what was heard."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes

from surfuse.fusion.beam_model.raster import Raster
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, FloatArray, MapGrid, Outline

LARGEST_SIDE = 4000


def raster_over(grid: MapGrid, g_m: float) -> Raster:
    """Square cells over the map's grid; nodes of an even grid fall on nodes where they can."""

    def axis(nodes: FloatArray) -> tuple[float, int]:
        extent = float(nodes[-1] - nodes[0])
        count = min(int(np.ceil(extent / g_m - 1e-6)) + 1, LARGEST_SIDE)
        return float(nodes[0]), max(count, 1)

    u0, cols = axis(grid.u_m)
    v0, rows = axis(grid.v_m)
    return Raster(u0, v0, g_m, np.ones((rows, cols), dtype=bool))


def inside_outline(raster: Raster, grid: MapGrid, outline: Outline, heights_m: FloatArray) -> BoolArray:
    """Cells (R, C) on the part at any of the heights (K,): see `inside_at`."""
    inside = np.zeros(raster.shape, dtype=bool)
    for height in heights_m:
        inside |= inside_at(raster, grid, outline, float(height))
    return inside


def inside_at(raster: Raster, grid: MapGrid, outline: Outline, height: float) -> BoolArray:
    """Cells (R, C) on the part: inside the outline before its margin, outside of its holes, seen at one height.

    The camera saw the outline from its viewpoint; a cell counts up to one standard deviation (the median one) outside.
    """
    u, v = raster.nodes()
    uu, vv = np.meshgrid(u, v)
    points = np.column_stack([uu.ravel(), vv.ravel(), np.full(uu.size, height)])
    placed = transform_points(inverse(outline.world_from_part) @ grid.world_from_part, points)
    seen = placed[:, :2]
    if outline.viewpoint_m is not None and outline.viewpoint_m[2] > 0.0:
        eye = outline.viewpoint_m
        share = eye[2] / np.maximum(eye[2] - placed[:, 2], 1e-9)
        seen = eye[:2] + share[:, None] * (seen - eye[:2])
        # The part stands on the table (v = 0): above its foot nothing can be seen below it.
        foot = float(outline.vertices_m[:, 1].min()) + outline.margin_m
        seen[:, 1] = np.where(placed[:, 1] >= -1e-9, np.maximum(seen[:, 1], foot), seen[:, 1])
    slack = float(np.median(outline.sigma_m)) + 1e-9
    inside = signed_distance(seen, outline.vertices_m) >= outline.margin_m - slack
    for hole in outline.holes_m:
        inside &= signed_distance(seen, hole) <= slack
    return np.asarray(inside.reshape(raster.shape), dtype=bool)


def heard_extent(raster: Raster, points_m: FloatArray, gap_m: float) -> BoolArray:
    """Cells (R, C) where something was heard, with gaps up to `gap_m` closed: the part when there is no outline."""
    rows, cols = raster.shape
    i = np.floor((points_m[:, 0] - raster.u0_m) / raster.g_m + 0.5).astype(np.int64)
    j = np.floor((points_m[:, 1] - raster.v0_m) / raster.g_m + 0.5).astype(np.int64)
    ok = (i >= 0) & (j >= 0) & (i < cols) & (j < rows)
    hit = np.zeros((rows, cols), dtype=bool)
    hit[j[ok], i[ok]] = True
    radius = max(1, round(0.5 * gap_m / raster.g_m))
    padded = np.pad(hit, radius + 1)
    span = np.arange(-radius, radius + 1)
    disc = span[:, None] ** 2 + span[None, :] ** 2 <= radius * radius + 0.5
    closed = binary_fill_holes(binary_closing(padded, disc))
    return np.asarray(closed[radius + 1 : -radius - 1, radius + 1 : -radius - 1], dtype=bool)
