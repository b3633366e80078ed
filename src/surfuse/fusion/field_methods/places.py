"""Nodes of the map: which belong to the part, which have readings near them, and how many."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surfuse.fusion.field_methods.survey import Survey
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import inverse, transform_points
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


def on_part(grid: MapGrid, outline: Outline | None, height_m: FloatArray) -> BoolArray:
    """Nodes (R, C) on the part at their height; all of them without an outline."""
    points = np.column_stack([nodes_of(grid), np.nan_to_num(height_m).ravel()])
    return inside(points, grid, outline).reshape(grid.shape)


def feet_on_part(survey: Survey, grid: MapGrid) -> BoolArray:
    """Readings (N,) whose axis meets the part; all of them without an outline."""
    return inside(survey.foot_m, grid, survey.outline)


def inside(points_m: FloatArray, grid: MapGrid, outline: Outline | None) -> BoolArray:
    """Points (N, 3) in the frame of the grid that lie inside the outline before its margin, and outside of its holes.

    A point is seen from the outline's viewpoint, or along w where that is unknown; it belongs to the part up to the
    median standard deviation of the outline outside of it.
    """
    if outline is None:
        return np.ones(len(points_m), dtype=np.bool_)
    points = transform_points(inverse(outline.world_from_part) @ grid.world_from_part, points_m)
    seen = points[:, :2]
    if outline.viewpoint_m is not None:
        eye = outline.viewpoint_m[2]
        ahead = eye - points[:, 2]
        # A point at or behind the camera is placed far outside.
        share = np.where(ahead > 0.0, eye / np.where(ahead > 0.0, ahead, 1.0), 1e6)
        seen = outline.viewpoint_m[:2] + share[:, None] * (seen - outline.viewpoint_m[:2])
    slack = float(np.median(outline.sigma_m)) + 1e-9
    result = signed_distance(seen, outline.vertices_m) >= outline.margin_m - slack
    for hole in outline.holes_m:
        result &= signed_distance(seen, hole) <= slack
    return np.asarray(result, dtype=np.bool_)
