"""First surfaces: a plane through the own-axis points, and the nearest oriented points that free space allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from surfuse.beam_model.echo.arrivals import RIM
from surfuse.beam_model.echo.detector import LEVELS
from surfuse.beam_model.heard.wavefronts import Surfels
from surfuse.beam_model.search.estimation import OFF_PART, TYPICAL, Estimation, arrivals, free_space, misfit, residuals
from surfuse.records import FloatArray, IntArray

CLEAR_ECHO = float(np.log(10.0))
AMBIGUITY_M = 0.001
NEAREST = 16
# Steps (1/m) of the search for the curvatures of a quadric, coarse to fine.
CURVATURE_STEPS = (2.5, 1.0, 0.5)
QUADRIC_TEMPER_M = 0.002
# Steps of the search for the slopes of a plane, coarse to fine, and what it is judged with.
SLOPE_STEPS = (0.22, 0.11, 0.055, 0.028)
SEARCHED_STATIONS = 250
PLANE_TEMPER_M = 0.002
PLANE_CREASE_M = 0.004


def plane(p: Estimation, points_m: FloatArray) -> FloatArray:
    """Plane (R, C) through points (M, 3) by iterated Cauchy weights; constant when they do not span a plane."""
    u, v = p.raster.nodes()
    uu, vv = np.meshgrid(u, v)
    points = points_m[p.raster.holds(points_m)]
    if len(points) == 0:
        return np.full(p.raster.shape, float(np.median(points_m[:, 2])) if len(points_m) else 0.0)
    centre = points.mean(axis=0)
    design = np.column_stack([points[:, :2] - centre[:2], np.ones(len(points))])
    # Tiny ridge on the slopes: few or collinear points give a level plane, not a wild one.
    ridge = np.diag([1e-4, 1e-4, 0.0])
    weight = np.ones(len(points))
    fit = np.array([0.0, 0.0, float(np.median(points[:, 2]))])
    for _ in range(20):
        normal = design.T @ (weight[:, None] * design) + ridge
        fit = np.linalg.solve(normal, design.T @ (weight * points[:, 2]))
        error = points[:, 2] - design @ fit
        scale = 1.4826 * float(np.median(np.abs(error))) + 1e-4
        weight = 1.0 / (1.0 + (error / scale) ** 2)
    return np.asarray(fit[0] * (uu - centre[0]) + fit[1] * (vv - centre[1]) + fit[2], dtype=np.float64)


def tilted(p: Estimation, guess: FloatArray) -> FloatArray:
    """Best of many planes (R, C) by the likelihood of all readings, starting at a guess (R, C).

    Beyond the main lobe every reading is off by an amount that depends on the tilt itself, so a plane through points
    corrected for a typical tilt may lie in the wrong valley of the likelihood. Slopes are searched coarse to fine.
    """
    u, v = p.raster.nodes()
    uu, vv = np.meshgrid(u, v)
    domain = p.raster.domain
    uc, vc = float(np.mean(uu[domain])), float(np.mean(vv[domain]))
    few = thinned(p, SEARCHED_STATIONS)
    middle = float(np.median(guess[domain]))

    def fitted(a: float, b: float, level: float) -> tuple[float, float]:
        """Cost and level of the plane with these slopes."""
        shape = a * (uu - uc) + b * (vv - vc)
        for _ in range(2):
            heard = arrivals(few, shape + level, PLANE_CREASE_M)
            error, known = residuals(few, heard)
            direct = (known > 0.0) & (heard.kind != RIM) & (few.weight > OFF_PART)
            if np.any(direct):
                level += float(np.median(error[direct] / heard.gain[direct]))
        heard = arrivals(few, shape + level, PLANE_CREASE_M)
        return float(np.sum(misfit(few, heard, PLANE_TEMPER_M))), level

    best, (lowest, level) = (0.0, 0.0), fitted(0.0, 0.0, middle)
    for step in SLOPE_STEPS:
        span = range(-3, 4) if step == SLOPE_STEPS[0] else range(-1, 2)
        centre, from_level = best, level
        for da in span:
            for db in span:
                trial = (centre[0] + da * step, centre[1] + db * step)
                if trial == centre:
                    continue
                value, found = fitted(*trial, from_level)
                if value < lowest:
                    best, lowest, level = trial, value, found
    return np.asarray(best[0] * (uu - uc) + best[1] * (vv - vc) + level, dtype=np.float64)


def thinned(p: Estimation, most: int) -> Estimation:
    """The problem with at most so many stations, evenly taken."""
    stride = -(-len(p.stations) // most)
    if stride <= 1:
        return p
    keep = np.arange(len(p.stations)) % stride == 0
    return replace(p, stations=p.stations.select(keep), level=p.level[keep], weight=p.weight[keep])


def quadric(p: Estimation, points_m: FloatArray) -> FloatArray:
    """Best of many quadrics (R, C) by the likelihood of all readings; a plane is fitted to each curvature."""
    u, v = p.raster.nodes()
    uu, vv = np.meshgrid(u, v)
    uc, vc = float(np.mean(uu[p.raster.domain])), float(np.mean(vv[p.raster.domain]))

    def bowl(a: float, b: float, c: float) -> FloatArray:
        bend = 0.5 * a * (uu - uc) ** 2 + b * (uu - uc) * (vv - vc) + 0.5 * c * (vv - vc) ** 2
        lift = (0.5 * a * (points_m[:, 0] - uc) ** 2 + b * (points_m[:, 0] - uc) * (points_m[:, 1] - vc)
                + 0.5 * c * (points_m[:, 1] - vc) ** 2)  # fmt: skip
        rest = np.column_stack([points_m[:, :2], points_m[:, 2] - lift])
        return np.asarray(plane(p, rest) + bend)

    def cost(a: float, b: float, c: float) -> float:
        height = bowl(a, b, c)
        return float(np.sum(misfit(p, arrivals(p, height, 0.004), QUADRIC_TEMPER_M)))

    best = (0.0, 0.0, 0.0)
    lowest = cost(*best)
    for step in CURVATURE_STEPS:
        span = (-2, -1, 0, 1, 2) if step == CURVATURE_STEPS[0] else (-1, 0, 1)
        centre = best
        for da in span:
            for db in (-1, 0, 1):
                for dc in span:
                    trial = (centre[0] + da * step, centre[1] + db * step, centre[2] + dc * step)
                    value = cost(*trial) if trial != centre else lowest
                    if value < lowest:
                        best, lowest = trial, value
    return bowl(*best)


def speckle_shift(p: Estimation) -> FloatArray:
    """Late arrival (M,) of speckle at a typical tilt, by amplitude where it is known."""
    shift = np.zeros(len(p.stations))
    for k, table in enumerate(p.tables):
        row = table.speckle_m[TYPICAL]
        by_level = np.interp(np.nan_to_num(p.level), LEVELS, row[:-1])
        shift = np.where(p.stations.spec == k, np.where(np.isnan(p.level), row[-1], by_level), shift)
    return shift


def trusted(p: Estimation, surfels: Surfels) -> IntArray:
    """Stations that may carve: on a wavefront with their neighbours, or with an echo too strong for speckle.

    Indices into the stations, increasing.
    """
    strong = np.nan_to_num(p.level, nan=-np.inf) > CLEAR_ECHO
    return np.flatnonzero(surfels.coherent | strong)


def nearest_allowed(p: Estimation, surfels: Surfels) -> FloatArray:
    """Each cell (R, C) takes the height of the nearest oriented point whose plane free space does not forbid there."""
    s, r = p.stations, p.raster
    bound = free_space(p, trusted(p, surfels))[r.domain]
    blurred = s.position_m + s.axis * (s.range_m - speckle_shift(p))[:, None]
    points = np.where(surfels.coherent[:, None], surfels.point_m, blurred)
    chosen = p.raster.holds(points)
    if not np.any(chosen):
        return plane(p, blurred)
    points, normal, sure = points[chosen], -surfels.towards[chosen], surfels.coherent[chosen]
    u, v = r.nodes()
    uu, vv = np.meshgrid(u, v)
    cells = np.column_stack([uu[r.domain], vv[r.domain]])
    distance, index = cKDTree(points[:, :2]).query(cells, k=min(NEAREST, len(points)))
    distance, index = distance.reshape(len(cells), -1), index.reshape(len(cells), -1)
    lean = (normal[index, 0] * (cells[:, None, 0] - points[index, 0])
            + normal[index, 1] * (cells[:, None, 1] - points[index, 1]))  # fmt: skip
    tilted = points[index, 2] - np.where(sure[index], lean / np.maximum(normal[index, 2], 0.2), 0.0)
    allowed = tilted <= bound[:, None] + AMBIGUITY_M
    # A wavefront is worth more than a nearer reading of speckle.
    rank = np.where(allowed, np.where(sure[index], 1.0, 0.02) / (distance + 0.3 * r.g_m) ** 2, 0.0)
    first = np.argmax(rank, axis=1)
    best = tilted[np.arange(len(cells)), first]
    level = float(np.median(points[:, 2]))
    lowered = np.where(np.isfinite(bound), bound, level)
    height = np.zeros(r.shape)
    height[r.domain] = np.where(rank.max(axis=1) > 0.0, best, lowered)
    return height
