"""Readings gathered at the places that several sensors looked at, and heights between those places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from surfuse.fusing.places import nodes_of
from surfuse.records import BoolArray, FloatArray, IntArray, MapGrid

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation of a normal distribution, as a factor to its standard deviation."""

INSIDE = 1e-6
"""A node that lies outside of a triangle by this share of it lies on its rim."""


SNAP_M = 1e-6
"""Places are told apart to a micrometre where triangles are made of them."""

SAME_DISTANCE = 1e-3
"""Sites whose distances differ by a thousandth are equally near."""

NEIGHBOURS = 9
"""Sites of a small plane: a square of three by three."""


@dataclass(frozen=True)
class Sites:
    """K places: `uv_m` (K, 2), `height_m`, `sigma_m`, `count` (K,)."""

    uv_m: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray
    count: IntArray

    def __len__(self) -> int:
        return len(self.height_m)


def groups(uv_m: FloatArray, pitch_m: float) -> IntArray:
    """Number (N,) of the square cell of side `pitch_m` that each point (N, 2) lies in; nan or 0: one cell a place.

    The cells are centred where most points lie within a cell (circular mean of their phase), so that the points of a
    lattice, and their scatter, fall into the middle of cells.
    """
    pitch = pitch_m if np.isfinite(pitch_m) and pitch_m > 0.0 else 1e-6
    phase = np.angle(np.mean(np.exp(2j * np.pi * uv_m / pitch), axis=0)) * pitch / (2.0 * np.pi)
    cell = np.round((uv_m - phase) / pitch).astype(np.int64)
    _, number = np.unique(cell, axis=0, return_inverse=True)
    return np.asarray(number, dtype=np.int64).ravel()


def summed(values: FloatArray, group: IntArray, n: int) -> FloatArray:
    """Sum of values (N,) over each of n groups.

    The result is (n,); `group` (N,) holds the number of each value's group, 0 to n - 1. Empty groups are 0.
    """
    return np.bincount(group, weights=values, minlength=n).astype(np.float64, copy=False)


def medians(values: FloatArray, group: IntArray, n: int) -> FloatArray:
    """Median of values (N,) over each of n groups, none of them empty.

    The result is (n,); `group` (N,) holds the number of each value's group, 0 to n - 1. Of an even number it is the
    mean of the middle two.
    """
    ordered = values[np.lexsort((values, group))]
    size = np.bincount(group, minlength=n)
    first = np.cumsum(size) - size
    return np.asarray(0.5 * (ordered[first + (size - 1) // 2] + ordered[first + size // 2]), dtype=np.float64)


def median_sites(points_m: FloatArray, sigma_m: FloatArray, pitch_m: float) -> Sites:
    """Median height of the points (N, 3) of each cell.

    Its sigma is the larger of the readings' own and of their scatter (median absolute deviation), taken to the median
    by pi / 2 in variance (its large-sample efficiency) once there are three.
    """
    group = groups(points_m[:, :2], pitch_m)
    n = int(group.max(initial=-1)) + 1
    count = np.bincount(group, minlength=n)
    height = medians(points_m[:, 2], group, n)
    scatter = MAD_TO_SIGMA * medians(np.abs(points_m[:, 2] - height[group]), group, n)
    own = np.sqrt(summed(sigma_m**2, group, n) / count)
    inflation = np.where(count >= 3, np.pi / 2.0, 1.0)
    sigma = np.maximum(own, scatter) * np.sqrt(inflation / count)
    return Sites(_centres(points_m, group, count), height, sigma, count)


def mean_sites(points_m: FloatArray, sigma_m: FloatArray, pitch_m: float, believed: bool = False) -> Sites:
    """Inverse-variance mean height of the points (N, 3) of each cell.

    Sigma is the larger of internal and external error (Birge, Phys. Rev. 40 (1932) 207); the internal one when the
    readings' own sigma are believed.
    """
    group = groups(points_m[:, :2], pitch_m)
    n = int(group.max(initial=-1)) + 1
    count, weight = np.bincount(group, minlength=n), 1.0 / sigma_m**2
    total = summed(weight, group, n)
    height = summed(weight * points_m[:, 2], group, n) / total
    misfit = summed(weight * (points_m[:, 2] - height[group]) ** 2, group, n) / np.maximum(count - 1, 1)
    inflation = np.ones(n) if believed else np.maximum(misfit, 1.0)
    return Sites(_centres(points_m, group, count), height, np.sqrt(inflation / total), count)


def _centres(points_m: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    n = len(count)
    return np.column_stack([summed(points_m[:, k], group, n) / count for k in (0, 1)])


def between(sites: Sites, grid: MapGrid, wanted: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Height and sigma (R, C) at the wanted nodes: linear in the Delaunay triangle of sites around each node.

    A wanted node outside of all triangles (the rim, a single line of sites) takes its nearest site, or the mean of
    those at the same distance. Other nodes are nan. A plane is met inside the triangles, to its slope times a
    micrometre. The caller decides which nodes are near enough to a site.
    """
    height, sigma = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    if len(sites) == 0 or not np.any(wanted):
        return height, sigma
    nodes = nodes_of(grid)[wanted.ravel()]
    corner, weight = _corners(sites.uv_m, nodes)
    height[wanted] = np.sum(weight * sites.height_m[corner], axis=1)
    sigma[wanted] = np.sqrt(np.sum((weight * sites.sigma_m[corner]) ** 2, axis=1))
    return height, sigma


def _corners(uv: FloatArray, nodes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Three sites and their weights (Q, 3) for each node (Q, 2)."""
    distance, nearest = cKDTree(uv).query(nodes, k=[1, 2, 3])
    same = distance <= distance[:, :1] * (1.0 + SAME_DISTANCE) + SNAP_M
    corner = np.where(same, nearest, nearest[:, :1]).astype(np.int64)
    weight = same / same.sum(axis=1, keepdims=True)
    if len(uv) < 3:
        return corner, weight
    # On a lattice either diagonal of a square will do: whole micrometres keep the choice free of rounding.
    centre = np.round(uv.mean(axis=0), 3)
    try:
        mesh = Delaunay(np.round((uv - centre) / SNAP_M) * SNAP_M)
    except QhullError:
        # Sites on one line span no triangle.
        return corner, weight
    at = nodes - centre
    triangle = mesh.find_simplex(at, tol=INSIDE)
    frame = mesh.transform[triangle]
    share = np.einsum("qij,qj->qi", frame[:, :2], at - frame[:, 2])
    inside = (triangle >= 0) & np.all(np.isfinite(share), axis=1)
    corner[inside] = mesh.simplices[triangle[inside]]
    weight[inside] = np.column_stack([share, 1.0 - share.sum(axis=1)])[inside]
    return corner, weight


def at_least_scatter(sites: Sites) -> Sites:
    """The sites with sigma no smaller than their scatter about the small plane of their nearest neighbours.

    Sensors that hear the same speckle from the same place agree with each other and are wrong together; their
    neighbours show it. The scatter is the root mean square residual of the plane through nine sites, six of them free.
    """
    if len(sites) < NEIGHBOURS:
        return sites
    _, index = cKDTree(sites.uv_m).query(sites.uv_m, k=NEIGHBOURS)
    offset = sites.uv_m[index] - sites.uv_m[:, None]
    scale = np.max(np.abs(offset), axis=(1, 2)) + 1e-12
    design = np.concatenate([np.ones((*index.shape, 1)), offset / scale[:, None, None]], axis=2)
    rise = sites.height_m[index] - sites.height_m[:, None]
    # Sites on one line leave a slope open: a faint pull to the level keeps the equations solvable.
    normal = np.swapaxes(design, 1, 2) @ design + 1e-9 * np.eye(3)
    plane = np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ rise[:, :, None])
    residual = rise - (design @ plane)[:, :, 0]
    scatter = np.sqrt(np.sum(residual**2, axis=1) / (NEIGHBOURS - 3))
    return Sites(sites.uv_m, sites.height_m, np.maximum(sites.sigma_m, scatter), sites.count)
