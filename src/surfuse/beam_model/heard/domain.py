"""Where the surface is sought: rasters over the part, from the outline or, without one, from what was heard."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes

from surfuse.beam_model.prior.raster import Raster
from surfuse.confidence.outline_view import on_part
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
    """Cells (R, C) on the part when the surface is at one height; see `on_part`."""
    u, v = raster.nodes()
    uu, vv = np.meshgrid(u, v)
    points = np.column_stack([uu.ravel(), vv.ravel(), np.full(uu.size, height)])
    return on_part(points, grid.world_from_part, outline).reshape(raster.shape)


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
