"""The paper's drawing of the map: a spline surface, which rounds what is steep (section 4)."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import distance_transform_edt
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull, QhullError

from surfuse.errors import DataError
from surfuse.records import BoolArray, FloatArray, IntArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.grids import refined

LARGEST_FILL = 200_000
"""Gaps of a map that are filled by a bending sheet; more take the value of the nearest node."""


def spline_surface(surface: SurfaceMap, smoothing: float = 1.0, refine: int = 1) -> SurfaceMap:
    """The map drawn as a bicubic spline surface; the method's name gets the suffix `+spline`.

    The spline is the smoothest one (least third-derivative jumps, Dierckx 1993) whose residuals at the nodes have the
    sum of squares that the map's own sigma lets expect: sum r^2 = smoothing * sum sigma^2 (Reinsch 1967). So it runs
    through a well measured plate and rounds a step, where the readings contradict each other. `smoothing` = 0
    interpolates. Inner gaps are bridged by a bending sheet before the fit.

    `refine` evaluates it on a grid so many times finer. Only nodes within the convex hull of the data get a value.
    Those between data have regime PRIOR, count 0 and confidence 0. sigma is that of the nearest measured node, with
    the spline's own residual there added in squares. A map without data stays empty.

    Raises
    ------
    DataError : `smoothing` is negative or not finite, or `refine` is below 1.
    """
    if not (np.isfinite(smoothing) and smoothing >= 0.0) or refine < 1:
        raise DataError(
            f"spline with smoothing {smoothing} and refinement {refine}", cure="give smoothing >= 0, refine >= 1"
        )
    grid = refined(surface.grid, refine)
    name = f"{surface.method}+spline"
    if not np.any(surface.mask):
        return _empty(grid, name)
    u, v = _doubled(surface.grid.u_m), _doubled(surface.grid.v_m)
    filled = _filled(surface.height_m, surface.mask)
    sheet = np.tile(filled, (1 + (len(v) != filled.shape[0]), 1 + (len(u) != filled.shape[1])))
    budget = smoothing * float(np.sum(surface.sigma_m[surface.mask] ** 2))
    spline = RectBivariateSpline(v, u, sheet, kx=min(3, len(v) - 1), ky=min(3, len(u) - 1), s=budget)
    residual = np.where(surface.mask, spline(surface.grid.v_m, surface.grid.u_m) - surface.height_m, 0.0)
    on_node = np.zeros(grid.shape, dtype=np.bool_)
    on_node[::refine, ::refine] = surface.mask
    mask = _in_hull(surface, grid, on_node)
    sigma = np.hypot(np.where(surface.mask, surface.sigma_m, 0.0), residual)
    row, column = _nearest_measured(surface, refine)
    # A fine node is as measured as the coarse cell around it.
    near = surface.mask[_cell_of(grid.shape[0], refine)[:, np.newaxis], _cell_of(grid.shape[1], refine)] & mask
    near |= on_node
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, spline(grid.v_m, grid.u_m), np.nan),
        sigma_m=np.where(mask, sigma[row, column], np.nan),
        confidence=np.where(near, surface.confidence[row, column], 0.0),
        count=np.where(near, surface.count[row, column], 0),
        mask=mask,
        regime=np.where(near, surface.regime[row, column], np.where(mask, int(Regime.PRIOR), 0)).astype(np.uint8),
        method=name,
    )


def _cell_of(n_fine: int, refine: int) -> IntArray:
    """Coarse node nearest to each fine node along one axis."""
    return np.minimum((np.arange(n_fine) + refine // 2) // refine, (n_fine - 1) // refine)


def _doubled(nodes: FloatArray) -> FloatArray:
    """An axis of one node as two, so that a single scan line is a surface that does not vary across."""
    return nodes if len(nodes) > 1 else np.array([nodes[0], nodes[0] + 1.0])


def _empty(grid: MapGrid, name: str) -> SurfaceMap:
    nothing = np.full(grid.shape, np.nan)
    zero = np.zeros(grid.shape)
    return SurfaceMap(
        grid, nothing, nothing, zero, zero.astype(np.int64), zero.astype(np.bool_), zero.astype(np.uint8), name
    )


def _nearest_measured(surface: SurfaceMap, refine: int) -> tuple[IntArray, IntArray]:
    """Row and column (fine grid) of the measured node nearest to each fine node."""
    rows, columns = distance_transform_edt(~surface.mask, return_distances=False, return_indices=True)
    at_row, at_column = (_cell_of((n - 1) * refine + 1, refine) for n in surface.grid.shape)
    place = np.ix_(at_row, at_column)
    return rows[place], columns[place]


def _in_hull(surface: SurfaceMap, grid: MapGrid, measured: BoolArray) -> BoolArray:
    """Nodes of the grid within the convex hull of the measured nodes: on a line of the grid when they span only that,
    the measured nodes alone when they lie on a slanted line.
    """
    row, column = np.nonzero(surface.mask)
    points = np.column_stack([surface.grid.u_m[column], surface.grid.v_m[row]])
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        low, high = points.min(axis=0) - 1e-9, points.max(axis=0) + 1e-9
        box = (u >= low[0]) & (u <= high[0]) & (v >= low[1]) & (v <= high[1])
        return np.asarray(box if np.any(high - low < 1e-6) else measured)
    inside = np.ones(grid.shape, dtype=np.bool_)
    for a, b, c in np.unique(hull.equations, axis=0):
        inside &= a * u + b * v + c <= 1e-9
    return inside


def _filled(height: FloatArray, mask: BoolArray) -> FloatArray:
    """The map with its gaps bridged by the sheet of least bending (second differences along u, v and across).

    Planes are continued as planes.
    """
    row, column = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    nearest = height[row, column]
    unknown = np.flatnonzero(~mask.ravel())
    if len(unknown) == 0 or len(unknown) > LARGEST_FILL:
        return np.asarray(nearest, dtype=np.float64)
    bending = _bending(*height.shape)
    energy = (bending.T @ bending).tocsr()
    pull = 1e-9 * sparse.identity(len(unknown))  # keeps the sheet determined where the data are too few
    known = np.flatnonzero(mask.ravel())
    right = -energy[unknown][:, known] @ height.ravel()[known] + 1e-9 * nearest.ravel()[unknown]
    result = nearest.ravel().copy()
    result[unknown] = spsolve((energy[unknown][:, unknown] + pull).tocsc(), right)
    return np.asarray(result.reshape(height.shape), dtype=np.float64)


def _bending(rows: int, columns: int) -> sparse.csr_matrix:
    """Second differences of a map (rows x columns), stacked: along v, along u, and twice the mixed one."""

    def difference(n: int, order: int) -> sparse.csr_matrix:
        steps = [1.0, -1.0] if order == 1 else [1.0, -2.0, 1.0]
        size = max(n - order, 0)
        return sparse.diags(steps, list(range(order + 1)), shape=(size, n), format="csr")

    along_v = sparse.kron(difference(rows, 2), sparse.identity(columns))
    along_u = sparse.kron(sparse.identity(rows), difference(columns, 2))
    twist = np.sqrt(2.0) * sparse.kron(difference(rows, 1), difference(columns, 1))
    return sparse.vstack([along_v, along_u, twist], format="csr")
