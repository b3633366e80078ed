"""How far a map is from the truth at its nodes."""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, FloatArray, MapGrid, Score, SurfaceMap
from surfuse.surface.grids import extended_grid, place_in, same_nodes
from surfuse.surface.resample import resampled


def score(surface: SurfaceMap, truth: SurfaceMap) -> Score:
    """Errors (map - truth, along w of the map's frame) over the nodes where both have a value.

    Coverage is the share of the true part's nodes that have a value, on the grid of the map continued over the whole
    true part. Truth on any other grid or in another part frame is resampled to that grid. Without a common node the
    errors are nan and `cells` is 0.
    """
    on_grid = aligned(truth, surface.grid)
    measured, height = spread_over(surface, on_grid.grid)
    both = measured & on_grid.mask
    error = height[both] - on_grid.height_m[both]
    part = int(np.count_nonzero(on_grid.mask))
    coverage = float(np.count_nonzero(both)) / part if part else float("nan")
    if len(error) == 0:
        nan = float("nan")
        return Score(nan, nan, nan, nan, coverage, 0)
    return Score(
        rmse_m=float(np.sqrt(np.mean(error**2))),
        mae_m=float(np.mean(np.abs(error))),
        bias_m=float(np.mean(error)),
        p95_m=float(np.percentile(np.abs(error), 95.0)),
        coverage=coverage,
        cells=len(error),
    )


def share_within(surface: SurfaceMap, truth: SurfaceMap, limit_m: float) -> float:
    """Share of the true part's nodes whose height the map has right to `limit_m`; nodes without a value are wrong."""
    on_grid = aligned(truth, surface.grid)
    measured, height = spread_over(surface, on_grid.grid)
    both = measured & on_grid.mask
    near = np.abs(height[both] - on_grid.height_m[both]) <= limit_m
    part = int(np.count_nonzero(on_grid.mask))
    return float(np.count_nonzero(near)) / part if part else float("nan")


def error_map(surface: SurfaceMap, truth: SurfaceMap) -> FloatArray:
    """Map minus truth at each node of the map (R, C), nan where either has no value."""
    at_nodes = resampled(truth, surface.grid) if not same_nodes(truth.grid, surface.grid) else truth
    return np.where(surface.mask & at_nodes.mask, surface.height_m - at_nodes.height_m, np.nan)


def aligned(truth: SurfaceMap, grid: MapGrid) -> SurfaceMap:
    """Truth on the grid, continued over the whole true part; as it is when it lies on such a grid already.

    Raises
    ------
    DataError : the truth has no cell with a value, or the grid becomes too large.
    """
    if place_in(truth.grid, grid) is not None:
        return truth
    row, column = np.nonzero(truth.mask)
    if len(row) == 0:
        raise DataError("the truth has no cell with a value", cure="check the frame of the truth")
    points = np.column_stack([truth.grid.u_m[column], truth.grid.v_m[row], truth.height_m[row, column]])
    seen = transform_points(inverse(grid.world_from_part) @ truth.grid.world_from_part, points)[:, :2]
    return resampled(truth, extended_grid(grid, seen.min(axis=0), seen.max(axis=0)))


def spread_over(surface: SurfaceMap, grid: MapGrid) -> tuple[BoolArray, FloatArray]:
    """Mask and height (R, C) of a map on a grid that contains its nodes as a block.

    In m; nan and False where the map has no node.

    Raises
    ------
    DataError : the nodes of the map are not among those of the grid.
    """
    place = place_in(grid, surface.grid)
    if place is None:
        raise DataError("the grid does not contain the nodes of the map", cure="continue the map's own grid")
    mask, height = np.zeros(grid.shape, dtype=np.bool_), np.full(grid.shape, np.nan)
    rows, columns = (slice(first, first + n) for first, n in zip(place, surface.grid.shape, strict=True))
    mask[rows, columns], height[rows, columns] = surface.mask, surface.height_m
    return mask, height
