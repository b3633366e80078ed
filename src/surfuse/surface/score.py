"""How far a map is from the truth, over the surface and at an edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, FloatArray, MapGrid, Score, SurfaceMap
from surfuse.surface.grids import SAME_M, extended_grid, place_in, same_nodes
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


@dataclass(frozen=True)
class EdgeError:
    """Where a map puts a step, against truth: signed errors (K,) in m, one a true crossing of a line of the map.

    Positive: the higher side reaches out too far. nan: the map does not cross the level there.

    `level_m` is the height at which the step was looked for, in the part frame.
    """

    error_m: FloatArray
    level_m: float

    @property
    def bias_m(self) -> float:
        """Mean signed error of the crossings found; nan without any."""
        found = self.error_m[np.isfinite(self.error_m)]
        return float(np.mean(found)) if len(found) else float("nan")

    @property
    def rms_m(self) -> float:
        """Root mean square error of the crossings found; nan without any."""
        found = self.error_m[np.isfinite(self.error_m)]
        return float(np.sqrt(np.mean(found**2))) if len(found) else float("nan")

    @property
    def found(self) -> float:
        """Share of the true crossings that the map has too; nan when truth has none."""
        return float(np.mean(np.isfinite(self.error_m))) if len(self.error_m) else float("nan")


def crossings(position_m: FloatArray, height_m: FloatArray, level_m: float) -> tuple[FloatArray, FloatArray]:
    """Where a profile (N,) crosses a level between neighbouring values, and +1 where it rises there, -1 where it falls.

    Linear between neighbours; a gap (nan) is not bridged. `position_m` (N,) increasing; both results are (K,) for K
    crossings, in the order of the profile.
    """
    above = np.where(np.isfinite(height_m), (height_m > level_m).astype(np.float64), np.nan)
    change = np.diff(above)
    at = np.flatnonzero(np.isfinite(change) & (change != 0.0))
    share = (level_m - height_m[at]) / (height_m[at + 1] - height_m[at])
    return position_m[at] + share * (position_m[at + 1] - position_m[at]), change[at]


def middle_level(truth: SurfaceMap) -> float:
    """Half height between the two levels of a stepped truth: mean of the medians above and below its middle height.

    In m along w of the truth's part frame.

    Raises
    ------
    DataError : the truth has no cell with a value.
    """
    heights = truth.height_m[truth.mask]
    if len(heights) == 0:
        raise DataError("the truth has no cell with a value", cure="check the frame of the truth")
    middle = 0.5 * (float(heights.min()) + float(heights.max()))
    return 0.5 * (float(np.median(heights[heights <= middle])) + float(np.median(heights[heights >= middle])))


def edge_error(
    surface: SurfaceMap, truth: SurfaceMap, along: Literal["u", "v"] = "v", level_m: float | None = None
) -> EdgeError:
    """Signed error of the step's position along u or v: where the mid-height contour lies, line by line.

    For every line of the map along that axis and every crossing of the level (default: `middle_level` of truth) by
    the true profile on it, the map's nearest crossing in the same sense. Truth must lie in the map's part frame; its
    grid should be finer than the map's along the axis (see `refined`), for its own steps bound the accuracy. Of the
    lines across, the nearest one of truth is taken.

    Raises
    ------
    DataError : the part frames differ, or the truth has no cell with a value.
    """
    if not np.allclose(truth.grid.world_from_part, surface.grid.world_from_part, rtol=0.0, atol=SAME_M):
        raise DataError("map and truth lie in different part frames", cure="take truth on a refined grid of the map")
    level = middle_level(truth) if level_m is None else level_m
    if along == "v":
        lines, true_lines = surface.grid.u_m, truth.grid.u_m
        position, true_position = surface.grid.v_m, truth.grid.v_m
        heights, true_heights = surface.height_m.T, truth.height_m.T
    else:
        lines, true_lines = surface.grid.v_m, truth.grid.v_m
        position, true_position = surface.grid.u_m, truth.grid.u_m
        heights, true_heights = surface.height_m, truth.height_m
    errors: list[float] = []
    for k, line in enumerate(lines):
        nearest = int(np.argmin(np.abs(true_lines - line)))
        wanted, senses = crossings(true_position, true_heights[nearest], level)
        found, found_senses = crossings(position, heights[k], level)
        for at, sense in zip(wanted, senses, strict=True):
            same = found[found_senses == sense]
            offset = same[np.argmin(np.abs(same - at))] - at if len(same) else np.nan
            # Rising along the axis means that the high side lies ahead: too far back is too large.
            errors.append(float(-sense * offset))
    return EdgeError(np.array(errors, dtype=np.float64), level)
