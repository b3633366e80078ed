"""Heights that scatter about a surface which is plane piece by piece: robust fits, tile by tile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import FloatArray, IntArray

ROUNDS = 12
TUNING = 2.385
"""Cauchy weights with this multiple of sigma have 95 % efficiency on normal errors (Holland and Welsch 1977)."""
LEAST_IN_TILE = 12


@dataclass(frozen=True)
class PlaneFit:
    """Residuals and weights (N,) of points about the planes of their tiles; weight 0: too few points in the tile.

    `slope` (N, 2) is that of the tile's plane along u and v; `scale_m` the standard deviation of the good points.
    """

    residual_m: FloatArray
    slope: FloatArray
    weight: FloatArray
    scale_m: float


def tiles_of(points_m: FloatArray, tiles: int) -> IntArray:
    """Tile (N,) of each point (N, 3) when the box of their u, v (5 to 95 % quantiles) is cut into tiles x tiles."""
    low, high = np.quantile(points_m[:, :2], [0.05, 0.95], axis=0)
    share = (points_m[:, :2] - low) / np.maximum(high - low, 1e-9)
    place = np.clip((share * tiles).astype(np.int64), 0, tiles - 1)
    return np.asarray(place[:, 1] * tiles + place[:, 0], dtype=np.int64)


def fit_planes(points_m: FloatArray, tile: IntArray, scale_m: float | None = None) -> PlaneFit:
    """Fit w = a + b u + c v in every tile, by least absolute deviations first, then with Cauchy weights.

    `scale_m` is the standard deviation of the good points (None: 1.4826 times the median absolute residual).

    `points_m` (N, 3) are (u, v, w) in m, `tile` (N,) is the number of each point's tile.
    """
    design = np.column_stack([np.ones(len(points_m)), points_m[:, :2] - np.median(points_m[:, :2], axis=0)])
    enough = (np.bincount(tile, minlength=int(tile.max()) + 1) >= LEAST_IN_TILE)[tile]
    height, weight = points_m[:, 2] - float(np.median(points_m[:, 2])), enough.astype(np.float64)
    spread = 0.0
    for k in range(2 * ROUNDS):
        size = np.abs(_less_planes(design, height, weight, tile)[0])
        spread = 1.4826 * float(np.median(size[enough])) if np.any(enough) else np.nan
        width = TUNING * max(scale_m if scale_m is not None else spread, 1e-9)
        weight = enough / (np.maximum(size, 1e-3 * spread + 1e-9) if k < ROUNDS else 1.0 + (size / width) ** 2)
    residual, planes = _less_planes(design, height, weight, tile)
    return PlaneFit(residual, planes[tile, 1:], weight, scale_m if scale_m is not None else spread)


def without_planes(values: FloatArray, points_m: FloatArray, weight: FloatArray, tile: IntArray) -> FloatArray:
    """What is left of values (N,) when planes over the tiles have taken up all that they can.

    `points_m` (N, 3) in m give the places, `weight` (N,) those of the fit, `tile` (N,) the number of each point's tile.
    """
    design = np.column_stack([np.ones(len(points_m)), points_m[:, :2] - np.median(points_m[:, :2], axis=0)])
    return _less_planes(design, values, weight, tile)[0]


def _less_planes(
    design: FloatArray, values: FloatArray, weight: FloatArray, tile: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Values minus the weighted least-squares plane of their tile, and the planes (T, 3); all tiles at once."""
    n = int(tile.max()) + 1
    normal, moment = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for i in range(3):
        moment[:, i] = np.bincount(tile, weight * design[:, i] * values, minlength=n)
        for j in range(i, 3):
            normal[:, i, j] = normal[:, j, i] = np.bincount(tile, weight * design[:, i] * design[:, j], minlength=n)
    # A tile of collinear points leaves a slope open: the ridge takes the flattest plane.
    ridge = 1e-12 * (1.0 + np.trace(normal, axis1=1, axis2=2))[:, None, None] * np.eye(3)
    planes = np.linalg.solve(normal + ridge, moment[..., None])[..., 0]
    return np.asarray(values - np.sum(design * planes[tile], axis=1), dtype=np.float64), planes
