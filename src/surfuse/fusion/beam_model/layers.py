"""What the cells of the solution rest on: how uncertain, how many readings, what kind of evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.ndimage import maximum_filter, uniform_filter

from surfuse.fusion.beam_model.arrivals import MIRROR, NONE, RIM, SPECKLE
from surfuse.fusion.beam_model.plate import factor
from surfuse.fusion.beam_model.problem import Problem, pulls
from surfuse.fusion.beam_model.search import LOOSE_M, Solution
from surfuse.records import ByteArray, FloatArray, IntArray, Regime

SAMPLES = 64
# Share of a sensor's own sigma that neither averaging nor neighbours remove (temperature, offset).
COMMON = 0.3
FLOOR_M = 0.00005


@dataclass(frozen=True)
class Layers:
    """Sigma (m), number of readings, regime (`Regime`) and share of believed readings, each (R, C)."""

    sigma_m: FloatArray
    count: IntArray
    regime: ByteArray
    confidence: FloatArray


def posterior_sigma(p: Problem, solution: Solution) -> FloatArray:
    """Standard deviation (R, C) from samples of the linearised posterior (perturbation with the Cholesky factor)."""
    data, _ = pulls(p, solution.heard, solution.height_m, 0.0)
    band = p.plate.precision(solution.height_m, solution.stiffness, LOOSE_M**-2)
    band[0] += p.plate.vector(data)
    lower = factor(band)
    width, size = lower.shape[0] - 1, lower.shape[1]
    upper = np.zeros_like(lower)
    for k in range(width + 1):
        upper[width - k, k:] = lower[k, : size - k]
    noise = np.random.default_rng(7).normal(size=(size, SAMPLES))
    samples = solve_banded((0, width), upper, noise, check_finite=False)
    return p.plate.field(np.mean(samples**2, axis=1)) ** 0.5


def support(p: Problem, solution: Solution, kind: int) -> FloatArray:
    """Readings (R, C) that hear each cell in one way."""
    heard, rows_cols = solution.heard, p.raster.shape
    rows = heard.kind == kind
    flat = heard.row[rows] * rows_cols[1] + heard.column[rows]
    return np.bincount(flat, weights=p.stations.count[rows], minlength=rows_cols[0] * rows_cols[1]).reshape(rows_cols)


def layers(p: Problem, solution: Solution) -> Layers:
    """All layers of a solution."""
    near = 2 * max(1, round(0.75 * p.spacing_m / p.raster.g_m)) + 1 if np.isfinite(p.spacing_m) else 3
    share = near * near
    mirror = uniform_filter(support(p, solution, MIRROR), near, mode="constant") * share
    speckle = uniform_filter(support(p, solution, SPECKLE), near, mode="constant") * share
    rim = maximum_filter(support(p, solution, RIM), 3, mode="constant")
    count = np.rint(mirror + speckle + np.where(mirror + speckle < 0.5, rim, 0.0)).astype(np.int64)
    regime = np.where(mirror > 0.5, int(Regime.MIRROR), int(Regime.PRIOR))
    regime = np.where(speckle > np.maximum(mirror, 0.5), int(Regime.SPECKLE), regime)
    regime = np.where((regime == int(Regime.PRIOR)) & (rim > 0.5), int(Regime.EDGE), regime)
    common = COMMON * float(np.median(p.stations.sigma_m * np.sqrt(p.stations.count)))
    sigma = np.sqrt(posterior_sigma(p, solution) ** 2 + common**2 + FLOOR_M**2)
    believed = (solution.heard.kind != NONE).astype(np.float64)
    e = np.where(believed > 0.0, p.stations.range_m - np.where(believed > 0.0, solution.heard.range_m, 0.0), 0.0)
    spread = np.maximum(solution.heard.scatter_m, 2.0 * p.stations.sigma_m + 0.0005)
    weight = np.where(believed > 0.0, 1.0 / (1.0 + (e / (2.0 * spread)) ** 2), 0.0)
    rows, cols = p.raster.shape
    flat = np.where(believed > 0.0, solution.heard.row * cols + solution.heard.column, 0)
    good = np.bincount(flat, weights=weight * believed, minlength=rows * cols).reshape(rows, cols)
    seen = np.bincount(flat, weights=believed, minlength=rows * cols).reshape(rows, cols)
    total = uniform_filter(seen, near, mode="constant")
    confidence = np.where(total > 1e-9, uniform_filter(good, near, mode="constant") / np.maximum(total, 1e-9), 0.0)
    return Layers(sigma, count, regime.astype(np.uint8), np.clip(confidence, 0.0, 1.0))
