"""How far a map is from the truth everywhere, not at its nodes alone: the truth is sampled every millimetre.

A lattice that happens to miss a step flatters a map, one that hits it damns it; between the nodes neither counts.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, DenseScore, FloatArray, IntArray, MapGrid, SurfaceMap
from surfuse.surface.resample import node_below, resampled
from surfuse.surface.step_edges import STEP_LEAST_M, STEP_WITHIN_M, step_edges
from surfuse.surface.truth import check_mesh, truth_from_mesh

SPACING_M = 0.001
"""Distance between the places at which the truth is sampled."""

MOST_PLACES = 2_000_000
"""On larger parts (1.4 m square) the places lie as much further apart as is needed."""

NEAR_M = 0.003
"""A place is right when the map is nearer to the truth than this."""


def dense_score(surface: SurfaceMap, truth: SurfaceMap) -> DenseScore:
    """Score of a map against truth on a dense raster (see `dense_grid`) in the part frame of the map.

    Without a common place the errors are nan and `places` is 0.

    Raises
    ------
    DataError : the frames differ.
    """
    height = heights_between(surface, truth.grid)
    both = truth.mask & np.isfinite(height)
    error = np.where(both, height - truth.height_m, np.nan)
    part = int(np.count_nonzero(truth.mask))
    return DenseScore(
        rmse_m=_rms(error[both]),
        off_edge_rmse_m=_rms(error[both & ~beside_steps(truth)]),
        edge_m=step_edges(height, truth).bias_m,
        within=float(np.count_nonzero(np.abs(error[both]) <= NEAR_M)) / part if part else float("nan"),
        coverage=float(np.count_nonzero(both)) / part if part else float("nan"),
        places=int(np.count_nonzero(both)),
    )


def dense_truth_of_mesh(vertices_m: FloatArray, faces: IntArray, grid: MapGrid) -> SurfaceMap:
    """Truth on the dense raster of a map with this grid, from a mesh: `vertices_m` (V, 3) in the world, `faces` (F, 3).

    Raises
    ------
    DataError : the mesh has no triangles, or vertices that are not finite.
    """
    check_mesh(vertices_m, faces)
    part = transform_points(inverse(grid.world_from_part), vertices_m[np.unique(faces)])[:, :2]
    return truth_from_mesh(vertices_m, faces, dense_grid(grid, part.min(axis=0), part.max(axis=0)))


def dense_truth_of_map(truth: SurfaceMap, grid: MapGrid) -> SurfaceMap:
    """Truth on the dense raster of a map with this grid, from another map in any frame.

    Raises
    ------
    DataError : the truth has no cell with a value.
    """
    row, column = np.nonzero(truth.mask)
    if len(row) == 0:
        raise DataError("the truth has no cell with a value", cure="check the frame of the truth")
    points = np.column_stack([truth.grid.u_m[column], truth.grid.v_m[row], truth.height_m[row, column]])
    seen = transform_points(inverse(grid.world_from_part) @ truth.grid.world_from_part, points)[:, :2]
    return resampled(truth, dense_grid(grid, seen.min(axis=0), seen.max(axis=0)))


def dense_grid(grid: MapGrid, low_uv_m: FloatArray, high_uv_m: FloatArray) -> MapGrid:
    """A raster of `SPACING_M` over the box low to high (2,) in the part frame of a map; its first node is on it.

    Raises
    ------
    DataError : the box is not finite.
    """
    low, high = np.asarray(low_uv_m, dtype=np.float64), np.asarray(high_uv_m, dtype=np.float64)
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        raise DataError(f"truth lies from {low} to {high} m", cure="check the frame of the truth")
    sides = np.maximum(high - low, SPACING_M)
    spacing = max(SPACING_M, float(np.sqrt(sides[0] * sides[1] / MOST_PLACES)))
    axes = []
    for first, nodes_low, nodes_high in zip((grid.u_m[0], grid.v_m[0]), low, high, strict=True):
        # A place within a millionth of a step of the box's edge is on it.
        before = int(np.floor((first - nodes_low) / spacing + 1e-6))
        after = int(np.floor((nodes_high - first) / spacing + 1e-6))
        axes.append(first + spacing * np.arange(-before, max(after, -before) + 1))
    return MapGrid(axes[0], axes[1], grid.world_from_part)


def heights_between(surface: SurfaceMap, grid: MapGrid) -> FloatArray:
    """Heights (R, C) in m of a map at the nodes of another grid in its part frame, as a user interpolates it.

    Bilinear where all four nodes around have a value; beside missing nodes and outside of the outermost ones the value
    of the nearest node, up to half a step away; nan where that node has none.

    Raises
    ------
    DataError : the frames differ.
    """
    if not np.allclose(grid.world_from_part, surface.grid.world_from_part, rtol=0.0, atol=1e-9):
        raise DataError("map and truth lie in different part frames", cure="take the truth in the frame of the map")
    steps = [float(np.median(np.diff(nodes))) for nodes in (surface.grid.u_m, surface.grid.v_m) if len(nodes) > 1]
    alone = max(steps, default=0.0)
    known = np.where(surface.mask, surface.height_m, np.nan)
    column, beside_u = _nearest(grid.u_m, surface.grid.u_m, alone)
    row, beside_v = _nearest(grid.v_m, surface.grid.v_m, alone)
    nearest = np.where(beside_v[:, None] & beside_u[None, :], known[np.ix_(row, column)], np.nan)
    (left, right, share_u), (low, high, share_v) = (
        _neighbours(places, nodes) for places, nodes in ((grid.u_m, surface.grid.u_m), (grid.v_m, surface.grid.v_m))
    )
    below, above = ((1.0 - share_u) * known[np.ix_(r, left)] + share_u * known[np.ix_(r, right)] for r in (low, high))
    between = (1.0 - share_v)[:, None] * below + share_v[:, None] * above
    return np.where(np.isfinite(between), between, nearest)


def beside_steps(truth: SurfaceMap) -> BoolArray:
    """Places (R, C) within a step: on a disc of 6 mm around them the truth differs by more than 8 mm."""
    u, v = truth.grid.u_m, truth.grid.v_m
    steps = [float(np.median(np.diff(nodes))) if len(nodes) > 1 else STEP_WITHIN_M for nodes in (v, u)]
    count = [max(1, round(0.5 * STEP_WITHIN_M / step)) for step in steps]
    rows, columns = (step * np.arange(-n, n + 1) for step, n in zip(steps, count, strict=True))
    radius = 0.5 * STEP_WITHIN_M * (1.0 + 1e-9) + max(0.0, max(steps) - 0.5 * STEP_WITHIN_M)
    disc = np.hypot(rows[:, None], columns[None, :]) <= radius
    highest = maximum_filter(np.where(truth.mask, truth.height_m, -np.inf), footprint=disc, mode="nearest")
    lowest = minimum_filter(np.where(truth.mask, truth.height_m, np.inf), footprint=disc, mode="nearest")
    return np.asarray(truth.mask & (highest - lowest > STEP_LEAST_M), dtype=np.bool_)


def _neighbours(places: FloatArray, nodes: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Indices (N,) of the nodes below and above each place, and the weight of the upper one; nan outside the nodes.

    On a node both are that node, so that what lies behind it does not count.
    """
    low, share = node_below(places, nodes)
    one = np.minimum(low + (share == 1.0), len(nodes) - 1)
    between = (share > 0.0) & (share < 1.0)
    return one, np.where(between, one + 1, one), np.where(np.isfinite(share), np.where(between, share, 0.0), np.nan)


def _nearest(places: FloatArray, nodes: FloatArray, alone_m: float) -> tuple[IntArray, BoolArray]:
    """Index (N,) of the nearest node, and whether it is at most half a step away; `alone_m`: step of a single node."""
    index = np.searchsorted(0.5 * (nodes[1:] + nodes[:-1]), places).astype(np.int64)
    first, last = (nodes[1] - nodes[0], nodes[-1] - nodes[-2]) if len(nodes) > 1 else (alone_m, alone_m)
    inside = (places >= nodes[0] - 0.5 * first - 1e-9) & (places <= nodes[-1] + 0.5 * last + 1e-9)
    return index, np.asarray(inside, dtype=np.bool_)


def _rms(error_m: FloatArray) -> float:
    return float(np.sqrt(np.mean(error_m**2))) if len(error_m) else float("nan")
