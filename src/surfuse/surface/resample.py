"""The same surface on another grid, also in another part frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, IntArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.grids import SAME_M
from surfuse.surface.truth import truth_from_mesh

PARALLEL = 1e-9
"""Largest sine between the w axes of two frames that count as parallel."""


def resampled(surface: SurfaceMap, grid: MapGrid) -> SurfaceMap:
    """The map at the nodes of another grid: bilinear where the w axes are parallel, else by rays on its triangles.

    A node has a value where every node of the map that it leans on has one. sigma is interpolated like the height
    (neighbouring errors are taken as fully correlated); count is the smallest and regime the nearest one's. By rays
    these are lost: sigma is 0, as for truth, and the method's name says so.
    """
    surface_from_grid = inverse(surface.grid.world_from_part) @ grid.world_from_part
    if np.all(np.abs(surface_from_grid[:2, 2]) <= PARALLEL) and surface_from_grid[2, 2] > 0.0:
        return _bilinear(surface, grid, surface_from_grid)
    vertices, faces = triangles(surface)
    cast_map = truth_from_mesh(vertices, faces, grid)
    return SurfaceMap(
        grid, cast_map.height_m, cast_map.sigma_m, cast_map.confidence, cast_map.count, cast_map.mask,
        cast_map.regime, f"{surface.method} (seen from another side)",
    )  # fmt: skip


def thinned(surface: SurfaceMap, grid: MapGrid) -> SurfaceMap:
    """The map at the nodes of a grid that are nodes of it, with all its layers; a map on that grid as it is.

    Raises
    ------
    DataError : a node of the grid is none of the map.
    """
    if surface.grid.shape == grid.shape:
        return surface
    places = []
    for fine, coarse in ((surface.grid.v_m, grid.v_m), (surface.grid.u_m, grid.u_m)):
        place = np.clip(np.searchsorted(fine, coarse - SAME_M), 0, len(fine) - 1)
        if np.max(np.abs(fine[place] - coarse)) > SAME_M:
            raise DataError("a node of the grid is no node of the map", cure="resample the map")
        places.append(place)
    at = np.ix_(*places)
    second, weight = surface.alternative_height_m, surface.alternative_weight
    return replace(
        surface,
        grid=grid,
        height_m=surface.height_m[at],
        sigma_m=surface.sigma_m[at],
        confidence=surface.confidence[at],
        count=surface.count[at],
        mask=surface.mask[at],
        regime=surface.regime[at],
        alternative_height_m=None if second is None else second[at],
        alternative_weight=None if weight is None else weight[at],
    )


def triangles(surface: SurfaceMap) -> tuple[FloatArray, IntArray]:
    """The map as a mesh in the world frame: vertices (V, 3), triangles (F, 3), counter-clockwise seen along -w.

    Raises
    ------
    DataError : no three neighbouring nodes have a value.
    """
    rows, columns = surface.grid.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    known = surface.mask.ravel()
    full = known[a] & known[b] & known[c] & known[d]
    faces = [np.stack(corners, axis=-1)[full] for corners in ((a, b, c), (a, c, d))]
    # Where one corner is missing, the triangle that is left.
    for corners in ((a, b, c), (a, c, d), (a, b, d), (b, c, d)):
        triangle = np.stack(corners, axis=-1)
        faces.append(triangle[known[triangle].all(axis=-1) & ~full])
    kept = np.concatenate(faces)
    if len(kept) == 0:
        raise DataError(
            f"the map of '{surface.method}' has no three neighbouring cells with a value", cure="scan more of the part"
        )
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    used, renumbered = np.unique(kept, return_inverse=True)
    points = np.column_stack([u.ravel(), v.ravel(), surface.height_m.ravel()])[used]
    return transform_points(surface.grid.world_from_part, points), renumbered.reshape(-1, 3).astype(np.int64)


def node_below(values: FloatArray, nodes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Index of the node below each value and the weight of the node above; nan where outside of the nodes."""
    if len(nodes) == 1:
        return np.zeros(len(values), dtype=np.int64), np.where(np.abs(values - nodes[0]) <= 1e-9, 0.0, np.nan)
    low = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, len(nodes) - 2)
    weight = (values - nodes[low]) / (nodes[low + 1] - nodes[low])
    # On a node (within a billionth of a step) only this node counts, so that equal grids give equal values.
    weight = np.where(np.abs(weight) < 1e-9, 0.0, np.where(np.abs(weight - 1.0) < 1e-9, 1.0, weight))
    return low, np.where((weight >= 0.0) & (weight <= 1.0), weight, np.nan)


def _bilinear(surface: SurfaceMap, grid: MapGrid, surface_from_grid: FloatArray) -> SurfaceMap:
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    seen = transform_points(surface_from_grid, np.stack([u, v, np.zeros(grid.shape)], axis=-1).reshape(-1, 3))
    (column, right), (row, up) = node_below(seen[:, 0], surface.grid.u_m), node_below(seen[:, 1], surface.grid.v_m)
    last_row, last_column = surface.grid.shape[0] - 1, surface.grid.shape[1] - 1
    leans = [
        (np.minimum(row + dr, last_row), np.minimum(column + dc, last_column), share_v * share_u)
        for dr, share_v in ((0, 1.0 - up), (1, up))
        for dc, share_u in ((0, 1.0 - right), (1, right))
    ]
    mask = np.isfinite(right) & np.isfinite(up)
    for r, c, weight in leans:
        mask &= surface.mask[r, c] | (weight == 0.0)

    def mixed(layer: FloatArray) -> FloatArray:
        parts = [np.where(weight > 0.0, layer[r, c], 0.0) * np.nan_to_num(weight) for r, c, weight in leans]
        return np.where(mask, np.sum(parts, axis=0), np.nan)

    count = np.min(
        [np.where(weight > 0.0, surface.count[r, c], np.iinfo(np.int64).max) for r, c, weight in leans], axis=0
    )
    heaviest = np.argmax([np.nan_to_num(weight) for _, _, weight in leans], axis=0)
    regimes = np.stack([surface.regime[r, c] for r, c, _ in leans])[heaviest, np.arange(len(heaviest))]
    height = mixed(surface.height_m) - surface_from_grid[2, 3]
    return SurfaceMap(
        grid=grid,
        height_m=height.reshape(grid.shape),
        sigma_m=mixed(surface.sigma_m).reshape(grid.shape),
        confidence=np.where(mask, mixed(surface.confidence), 0.0).reshape(grid.shape),
        count=np.where(mask, count, 0).reshape(grid.shape),
        mask=mask.reshape(grid.shape),
        regime=np.where(mask, regimes, int(Regime.EMPTY)).astype(np.uint8).reshape(grid.shape),
        method=surface.method,
    )
