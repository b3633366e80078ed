"""From fused points to a map: which grid the stops lie on, and which point belongs to which node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from surfuse.confidence.outline_view import on_part
from surfuse.errors import DataError
from surfuse.records import (
    BoolArray,
    FloatArray,
    FusedPoints,
    Gap,
    Gate,
    IntArray,
    MapGrid,
    Outline,
    Regime,
    SurfaceMap,
)

LARGEST_GRID = 4_000_000
"""Nodes of the largest grid that is made without being asked for it."""

CLUSTER = 1.0 / 3.0
"""Coordinates closer than this share of the spacing belong to one line of a raster (pose noise)."""


def lattice(uv_m: FloatArray, world_from_part: FloatArray, step_m: float | None = None) -> MapGrid:
    """The node-registered grid of scattered stops (N, 2) in the part frame.

    A raster, also one with pose noise up to a sixth of its step and with missing stops, gets back its own lines as
    axes. An axis without such lines (scan lines that start anywhere, free scans) gets equal steps of the median
    distance between neighbouring stops, or of `step_m` (m), which then holds for both axes.

    Raises
    ------
    DataError : no finite stop, step_m not positive, or more than `LARGEST_GRID` nodes.
    """
    points = np.asarray(uv_m, dtype=np.float64).reshape(-1, 2)
    points = points[np.all(np.isfinite(points), axis=1)]
    if len(points) == 0:
        raise DataError(
            "there is no stop with a finite position to make a grid from", cure="check the poses of the log"
        )
    if step_m is not None:
        if not (np.isfinite(step_m) and step_m > 0.0):
            raise DataError(f"the step of the map is {step_m} m", cure="give a step > 0 in metres")
        axes = [_equal_steps(column, step_m) for column in points.T]
    else:
        spacing = _spacing(points)
        axes = [_raster_axis(column, spacing) for column in points.T]
    return MapGrid(axes[0], axes[1], world_from_part)


def _spacing(points: FloatArray) -> float:
    """Median distance to the nearest other stop; repeated stops count once. 0 with a single place."""
    unique = np.unique(points, axis=0)
    if len(unique) < 2:
        return 0.0
    distance, _ = cKDTree(unique).query(unique, k=2)
    return float(np.median(distance[:, 1]))


def _raster_axis(values: FloatArray, spacing: float) -> FloatArray:
    """Lines of a raster along one axis, or equal steps where there are none."""
    ordered = np.sort(values)
    extent = float(ordered[-1] - ordered[0])
    if extent <= CLUSTER * spacing or extent == 0.0:
        return np.array([float(np.mean(ordered))])
    breaks = np.flatnonzero(np.diff(ordered) > CLUSTER * spacing) + 1
    lines = np.split(ordered, breaks)
    means = np.array([line.mean() for line in lines])
    widest = max(float(line[-1] - line[0]) for line in lines)
    if len(means) < 2 or widest > CLUSTER * spacing:
        return _equal_steps(values, spacing)
    return _fitted(means, np.array([len(line) for line in lines], dtype=np.float64))


def _fitted(means: FloatArray, weights: FloatArray) -> FloatArray:
    """Equally spaced nodes through the lines of a raster, missing lines filled in; the lines themselves if unequal."""
    gaps = np.diff(means)
    step = float(np.median(gaps))
    whole = np.round(gaps / step)
    if np.max(np.abs(gaps / step - whole)) > CLUSTER or np.min(whole) < 1.0:
        return means
    places = np.concatenate([[0.0], np.cumsum(whole)])
    _refuse_huge(float(places[-1]))
    slope, origin = np.polyfit(places, means, 1, w=np.sqrt(weights))
    return np.asarray(origin + slope * np.arange(int(places[-1]) + 1), dtype=np.float64)


def _equal_steps(values: FloatArray, step_m: float) -> FloatArray:
    """Nodes at equal steps that cover the values, the remainder shared by both ends."""
    low, high = float(np.min(values)), float(np.max(values))
    intervals = (high - low) / step_m
    _refuse_huge(intervals)
    count = max(int(np.ceil(intervals - 1e-6)), 0)
    return np.asarray((low + high) / 2.0 + (np.arange(count + 1) - count / 2.0) * step_m, dtype=np.float64)


def _refuse_huge(intervals: float) -> None:
    if intervals > LARGEST_GRID:
        raise DataError(f"the map would have {intervals:.3g} nodes along one axis", cure="give the map a larger step")


def cells_inside(grid: MapGrid, outline: Outline, height_m: FloatArray | None = None) -> BoolArray:
    """Nodes (R, C) on the part: inside the outline (before its margin) and outside of its holes.

    The node stands at height w, 0 where that is unknown; see `on_part`.
    """
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    w = np.zeros(grid.shape) if height_m is None else np.nan_to_num(height_m)
    nodes = np.stack([u, v, w], axis=-1).reshape(-1, 3)
    return on_part(nodes, grid.world_from_part, outline).reshape(grid.shape)


def _nearest(values: FloatArray, nodes: FloatArray, lone_reach: float) -> tuple[IntArray, BoolArray]:
    """Index of the nearest node and whether the value belongs to it: within half a step, or within the reach of a
    lone node.
    """
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    index = np.searchsorted(middle, values).astype(np.int64)
    if len(nodes) == 1:
        return index, np.asarray(np.abs(values - nodes[0]) <= lone_reach)
    step = np.diff(nodes)
    # A stop half a step outside still belongs to the edge node; the tolerance absorbs rounding.
    low, high = nodes[0] - 0.5 * step[0] * (1 + 1e-9), nodes[-1] + 0.5 * step[-1] * (1 + 1e-9)
    return index, (values >= low) & (values <= high)


def grid_points(points: FusedPoints, grid: MapGrid, method: str, outline: Outline | None = None) -> SurfaceMap:
    """Give each node the fused points that belong to it: those nearer to it than to any other, within half a step.

    Several points in one node are averaged by inverse variance; its sigma is the larger of 1 / sqrt(sum 1/sigma^2) and
    the scatter of the points (internal and external error). Confidence is the mean dc of the readings of its stops,
    refused readings counting 0; count is the number of readings that took part. Nothing is interpolated or
    extrapolated: a node without a point stays masked. With an outline, nodes off the part stay masked too.

    `points.point_m` are in the part frame of the grid.
    """
    binned = _binned(points, grid, method)
    valid, cell, w, weight = binned.point, binned.cell, binned.height_m, binned.weight
    nodes = grid.shape[0] * grid.shape[1]

    def summed(values: FloatArray) -> FloatArray:
        return np.bincount(cell, weights=values, minlength=nodes).astype(np.float64, copy=False)

    number = np.bincount(cell, minlength=nodes).astype(np.float64)
    total = summed(weight)
    mask = number > 0
    height = _ratio(summed(weight * w), total)
    scatter = _ratio(summed(weight * (w - height[cell]) ** 2), number - 1.0)
    spread = np.sqrt(_ratio(np.maximum(1.0, np.nan_to_num(scatter)), total))
    confidence = _ratio(summed(_mean_confidence(points)[valid]), number)
    count = summed(_readings_used(points)[valid])
    if outline is not None:
        mask = mask & cells_inside(grid, outline, height.reshape(grid.shape)).ravel()

    def shaped(values: FloatArray, off: float) -> FloatArray:
        return np.asarray(np.where(mask, values, off).reshape(grid.shape), dtype=np.float64)

    return SurfaceMap(
        grid=grid,
        height_m=shaped(height, np.nan),
        sigma_m=shaped(spread, np.nan),
        confidence=shaped(confidence, 0.0),
        count=shaped(count, 0.0).astype(np.int64),
        mask=mask.reshape(grid.shape),
        regime=shaped(np.full(len(mask), float(Regime.MEASURED)), float(Regime.EMPTY)).astype(np.uint8),
        method=method,
    )


class _Binned(NamedTuple):
    """The K fused points that belong to a node: numbers of point and node (K,), height, weight 1 / sigma^2."""

    point: IntArray
    cell: IntArray
    height_m: FloatArray
    weight: FloatArray


def _binned(points: FusedPoints, grid: MapGrid, method: str) -> _Binned:
    # A sum of three is finite when all of them are; three columns are quicker than rows of three.
    place = points.point_m.T
    valid = np.flatnonzero((points.gap == Gap.NONE) & np.isfinite(place[0] + place[1] + place[2]))
    u, v, w = (column[valid] for column in place)
    sigma = points.sigma_m[valid]
    if not np.all(sigma > 0.0):
        raise DataError(f"method '{method}' gave a fused value the standard deviation {float(np.min(sigma))}")
    steps = [np.diff(nodes) for nodes in (grid.u_m, grid.v_m) if len(nodes) > 1]
    reach = 0.5 * float(np.min(np.concatenate(steps))) if steps else np.inf
    column, fits_u = _nearest(u, grid.u_m, reach)
    row, fits_v = _nearest(v, grid.v_m, reach)
    used = fits_u & fits_v
    cell = (row * grid.shape[1] + column)[used]
    return _Binned(valid[used], cell, w[used], 1.0 / sigma[used] ** 2)


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Elementwise quotient, nan where the denominator is not positive."""
    result = np.full(len(numerator), np.nan)
    np.divide(numerator, denominator, out=result, where=denominator > 0.0)
    return result


def _per_stop(points: FusedPoints, values: FloatArray) -> FloatArray:
    """Sum of a reading column over each stop (M,)."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(sums[points.start[1:]] - sums[points.start[:-1]], dtype=np.float64)


def _mean_confidence(points: FusedPoints) -> FloatArray:
    sizes = np.maximum(np.diff(points.start), 1)
    return np.asarray(np.clip(_per_stop(points, points.dc) / sizes, 0.0, 1.0), dtype=np.float64)


def _readings_used(points: FusedPoints) -> FloatArray:
    return _per_stop(points, ((points.gate == Gate.PASSED) & (points.dc > 0.0)).astype(np.float64))
