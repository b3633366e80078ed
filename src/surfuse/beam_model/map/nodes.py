"""From the cells of the estimate to the nodes of the map."""

from __future__ import annotations

import numpy as np

from surfuse.beam_model.map.tiles import RasterLayers
from surfuse.records import FloatArray, IntArray, MapGrid, Regime, SurfaceMap

# Nodes a cell, along each side, of a map with edges inside of cells; nodes of the largest map that is made so fine.
NODES_AT_EDGES = 3
MOST_NODES = 200_000


def finer_grid(sheet: RasterLayers, grid: MapGrid) -> MapGrid:
    """The map's grid with nodes as close as the cells of the estimate, closer where an edge lies inside of a cell.

    Nodes of the given grid stay nodes. A third of a cell leaves no node on the border of two cells.
    """
    steps = np.concatenate([np.diff(grid.u_m), np.diff(grid.v_m)])
    if len(steps) == 0 or not np.allclose(steps, steps[0], rtol=1e-6):
        return grid
    cells = max(1, round(float(steps[0]) / sheet.raster.g_m))
    edges = bool(np.any(sheet.edge_u != 0.0) or np.any(sheet.edge_v != 0.0))
    factor = cells * (NODES_AT_EDGES if edges else 1)
    if factor == 1 or grid.shape[0] * grid.shape[1] * factor**2 > MOST_NODES:
        return grid
    return MapGrid(_between(grid.u_m, factor), _between(grid.v_m, factor), grid.world_from_part)


def _between(nodes: FloatArray, factor: int) -> FloatArray:
    """The nodes (N,), and `factor` - 1 more between each two of them."""
    index = np.arange((len(nodes) - 1) * factor + 1) / factor
    return np.asarray(np.interp(index, np.arange(len(nodes)), nodes), dtype=np.float64)


def on_grid(sheet: RasterLayers, grid: MapGrid) -> SurfaceMap:
    """Layers at the nodes of the map: each node on the facet of the cell that contains it.

    Beside an edge that lies inside of a cell, nodes beyond it are on the facet of the next cell.
    """
    r = sheet.raster
    rows, cols = r.shape
    at_u, at_v = (grid.u_m - r.u0_m) / r.g_m, (grid.v_m - r.v0_m) / r.g_m
    i, j = np.floor(at_u + 0.5).astype(np.int64), np.floor(at_v + 0.5).astype(np.int64)
    inside = ((i >= 0) & (i < cols))[None, :] & ((j >= 0) & (j < rows))[:, None]
    ii, jj = np.meshgrid(np.clip(i, 0, cols - 1), np.clip(j, 0, rows - 1))
    mask = sheet.known[jj, ii] & inside
    ii = _beside(sheet.edge_u, jj, ii, at_u[None, :] - ii, 1)
    jj = _beside(sheet.edge_v, jj, ii, at_v[:, None] - jj, 0)
    du, dv = grid.u_m[None, :] - (r.u0_m + ii * r.g_m), grid.v_m[:, None] - (r.v0_m + jj * r.g_m)
    surface = sheet.height_m[jj, ii] + sheet.slope_u[jj, ii] * du + sheet.slope_v[jj, ii] * dv
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, surface, np.nan),
        sigma_m=np.where(mask, sheet.sigma_m[jj, ii], np.nan),
        confidence=np.where(mask, sheet.confidence[jj, ii], 0.0),
        count=np.where(mask, sheet.count[jj, ii], 0),
        mask=mask,
        regime=np.where(mask, sheet.regime[jj, ii], int(Regime.EMPTY)).astype(np.uint8),
        method="beam",
        alternative_height_m=np.where(mask, sheet.second_m[jj, ii], np.nan),
        alternative_weight=np.where(mask, sheet.second_weight[jj, ii], 0.0),
    )


def _beside(edge: FloatArray, row: IntArray, column: IntArray, share: FloatArray, axis: int) -> IntArray:
    """Row or column (axis 0 or 1) of the cell on whose facet a node lies, one beside its own where an edge is between.

    `edge` (R, C) is `edge_u` or `edge_v`; `share` (in cells, from -1/2 to 1/2) is where the node lies in its cell.
    """
    own = (row, column)[axis]
    last = edge.shape[axis] - 1
    before = (row, np.maximum(column - 1, 0)) if axis else (np.maximum(row - 1, 0), column)
    ahead = (edge[row, column] < 0.0) & (share > 0.5 + edge[row, column]) & (own < last)
    behind = (edge[before] > 0.0) & (share < -0.5 + edge[before]) & (own > 0)
    return np.asarray(own + ahead.astype(np.int64) - behind.astype(np.int64))
