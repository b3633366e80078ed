"""Nodes of the map: which belong to the part, which have readings near them, and how many."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surfuse.confidence import outline_view
from surfuse.fusing.survey import Survey
from surfuse.records import BoolArray, FloatArray, IntArray, MapGrid, Outline

REACH = 0.75
"""A node has a value when a reading looked within so many stops of it: the middle of a square of stops has 0.71."""


def nodes_of(grid: MapGrid) -> FloatArray:
    """The nodes (R C, 2) as u, v, row after row."""
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    return np.column_stack([u.ravel(), v.ravel()])


def half_cells(grid: MapGrid, spacing_m: float) -> tuple[float, float]:
    """Half the largest distance between neighbouring nodes along u and v; half a stop where there is one node."""
    lone = 0.5 * spacing_m if np.isfinite(spacing_m) else 0.0
    u, v = (0.5 * float(np.max(np.diff(nodes))) if len(nodes) > 1 else lone for nodes in (grid.u_m, grid.v_m))
    return u, v


def reach_of(survey: Survey, grid: MapGrid) -> float:
    """Distance (m) up to which a reading speaks for a node: three quarters of a stop, or the node's own cell."""
    stops = REACH * survey.spacing_m if np.isfinite(survey.spacing_m) else 0.0
    return max(stops, float(np.hypot(*half_cells(grid, survey.spacing_m))), 1e-9)


def covered(survey: Survey, grid: MapGrid) -> BoolArray:
    """Nodes (R, C) with an own-axis hit within three quarters of a stop, or in their own cell."""
    if len(survey) == 0:
        return np.zeros(grid.shape, dtype=np.bool_)
    nodes, hits = nodes_of(grid), survey.foot_m[:, :2]
    distance, index = cKDTree(hits).query(nodes)
    stops = REACH * survey.spacing_m if np.isfinite(survey.spacing_m) else 0.0
    offset = np.abs(hits[index] - nodes)
    # The tolerance absorbs rounding: a hit on the border belongs to both cells.
    own_cell = np.all(offset <= np.array(half_cells(grid, survey.spacing_m)) * (1.0 + 1e-9) + 1e-9, axis=1)
    return np.asarray(((distance <= stops) | own_cell).reshape(grid.shape), dtype=np.bool_)


def counted(points_m: FloatArray, grid: MapGrid, reach_m: float) -> IntArray:
    """How many points (N, 2) lie within reach of each node (R, C)."""
    if len(points_m) == 0:
        return np.zeros(grid.shape, dtype=np.int64)
    found = cKDTree(points_m).query_ball_point(nodes_of(grid), reach_m * (1.0 + 1e-9), return_length=True)
    return np.asarray(found, dtype=np.int64).reshape(grid.shape)


def excess_sigma(survey: Survey, grid: MapGrid) -> FloatArray:
    """What a log that states larger standard deviations than the sensors have adds to sigma, in quadrature (R, C).

    For methods that judge how far their readings contradict each other: were that done with the stated deviations,
    readings that are said to be worse would contradict each other less, and the map could come out surer. They are
    judged by the deviations of the sensors, and the rest, averaged over the readings of a node, is added here.
    """
    usual = float(np.median(survey.sigma_m)) / survey.excess if len(survey) else 0.0
    read = np.maximum(counted(survey.foot_m[:, :2], grid, reach_of(survey, grid)), 1)
    return np.asarray(usual * np.sqrt((survey.excess**2 - 1.0) / read), dtype=np.float64)


def nodes_on_part(grid: MapGrid, outline: Outline | None, height_m: FloatArray) -> BoolArray:
    """Nodes (R, C) on the part at their height; all of them without an outline."""
    points = np.column_stack([nodes_of(grid), np.nan_to_num(height_m).ravel()])
    if outline is None:
        return np.ones(grid.shape, dtype=np.bool_)
    return outline_view.on_part(points, grid.world_from_part, outline).reshape(grid.shape)


def feet_on_part(survey: Survey, grid: MapGrid) -> BoolArray:
    """Readings (N,) whose axis meets the part; all of them without an outline."""
    if survey.outline is None:
        return np.ones(len(survey), dtype=np.bool_)
    return outline_view.on_part(survey.foot_m, grid.world_from_part, survey.outline)
