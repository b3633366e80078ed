"""A Kalman filter at every node of the map, fed with the planes that the sweeps see.

After Amersdorfer and Meurer, Iterative Surface Mapping Using Local Geometry Approximation with Sparse Measurements
During Robotic Tooling Tasks (2021, arXiv:2011.06375): the points of one sweep determine a plane; each node near them is
given the height of the plane there as a measurement, with a variance that grows with its distance from the measured
points (a radial basis function); a linear Kalman filter a node fuses what the sweeps say. The constants, the weak
prior on the slope (for fewer than three points, or points on one line) and the inflation by the misfit of the plane are
this project's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered, excess_sigma, half_cells
from surfuse.fusing.survey import Survey
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, IntArray, MapGrid

SUMMARY = "Kalman filter at every node, fed with the local planes of the sweeps (Amersdorfer, Meurer 2021)"

LEAST = 3
"""Points that a plane needs; missing ones are borrowed from the stops before on the same line."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the planes.

    reach_m : a plane speaks for nodes up to this distance from its nearest point. Default 15 mm: with an array of 5 cm
        most of its inside, and little around it. Unit m.
    falloff_m : distance at which the doubt about the plane has grown to 0.39 of its square (1 - exp(-d^2 / (2 f^2))).
        Default 10 mm.
    doubt_m : standard deviation of the plane against the surface far from its points. Default 5 mm: what a radius of
        30 cm departs from its chord of 10 cm.
    slope_sigma : prior standard deviation of the slope. Default 0.47, the tangent of the largest usable incidence.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    reach_m: float = 0.015
    falloff_m: float = 0.010
    doubt_m: float = 0.005
    slope_sigma: float = 0.47

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("reach_m", "falloff_m", "slope_sigma"):
            check_within("kalman_plane", name, getattr(self, name), 0.0, float("inf"), above=True)
        check_within("kalman_plane", "doubt_m", self.doubt_m, 0.0, float("inf"))


@compiled
def fit_plane(
    points: FloatArray, variance: FloatArray, rows: IntArray, slope_sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Weighted least-squares plane (h, a, b) about the mean of some rows of points (N, 3), and its covariance (3, 3).

    The covariance is inflated by the misfit per free point where that is above 1.
    """
    n = rows.shape[0]
    cu, cv, cw = 0.0, 0.0, 0.0
    for i in rows:
        cu, cv, cw = cu + points[i, 0] / n, cv + points[i, 1] / n, cw + points[i, 2] / n
    normal, right = np.zeros((3, 3)), np.zeros(3)
    normal[1, 1] = normal[2, 2] = 1.0 / slope_sigma**2
    for i in rows:
        h = np.array([1.0, points[i, 0] - cu, points[i, 1] - cv])
        normal += np.outer(h, h) / variance[i]
        right += h * ((points[i, 2] - cw) / variance[i])
    covariance = np.linalg.inv(normal)
    plane = covariance @ right
    misfit = 0.0
    for i in rows:
        error = points[i, 2] - cw - plane[0] - plane[1] * (points[i, 0] - cu) - plane[2] * (points[i, 1] - cv)
        misfit += error * error / variance[i]
    plane[0] += cw
    return plane, covariance * max(1.0, misfit / max(n - LEAST, 1))


@compiled
def _borrowed(row: IntArray, first: int, last: int) -> int:
    """First of the readings that make a plane with those of a sweep: enough of them, on the same line."""
    begin = first
    while last - begin < LEAST and begin > 0 and row[begin - 1] == row[first]:
        begin -= 1
    return begin


@compiled
def _nearest(points: FloatArray, rows: IntArray, u: float, v: float) -> float:
    """Squared distance from (u, v) to the nearest of some points."""
    best = np.inf
    for i in rows:
        best = min(best, (points[i, 0] - u) ** 2 + (points[i, 1] - v) ** 2)
    return best


class Points(NamedTuple):
    """What the planes are laid through: own-axis points (N, 3) in m, their variances (N,) in m^2, sweep and row (N,).

    In the order in which they were taken: those of one sweep follow each other.
    """

    at_m: FloatArray
    variance_m2: FloatArray
    sweep: IntArray
    row: IntArray


class Trust(NamedTuple):
    """How far a plane speaks: `Parameters` of the same names, in m, and the slope without a unit."""

    reach: float
    falloff: float
    doubt: float
    slope_sigma: float


@compiled
def node_filters(points_of: Points, u: FloatArray, v: FloatArray, trust: Trust) -> tuple[FloatArray, FloatArray]:
    """Height (m) and variance (m^2) (R, C) of all nodes `u` (C,), `v` (R,) in m after all sweeps.

    Where no plane spoke the height is nan and the variance inf.

    Static state, z the plane's height at the node with variance r: K = P / (P + r), h += K (z - h), P -= K P. At the
    end P is inflated by the mean of (z - h)^2 / (P + r) where that is above 1: filters that the planes contradict.
    """
    points, variance, sweep, row = points_of
    reach, falloff, doubt, slope_sigma = trust
    height, p = np.full((len(v), len(u)), np.nan), np.full((len(v), len(u)), np.inf)
    squares, number = np.zeros((len(v), len(u))), np.zeros((len(v), len(u)))
    first, n = 0, points.shape[0]
    while first < n:
        last = first + 1
        while last < n and sweep[last] == sweep[first]:
            last += 1
        own = np.arange(first, last)
        rows = np.arange(_borrowed(row, first, last), last)
        plane, covariance = fit_plane(points, variance, rows, slope_sigma)
        cu, cv = points[rows, 0].mean(), points[rows, 1].mean()
        c0 = np.searchsorted(u, points[own, 0].min() - reach)
        c1 = np.searchsorted(u, points[own, 0].max() + reach, side="right")
        r0 = np.searchsorted(v, points[own, 1].min() - reach)
        r1 = np.searchsorted(v, points[own, 1].max() + reach, side="right")
        for k in range(r0, r1):
            for c in range(c0, c1):
                d2 = _nearest(points, own, u[c], v[k])
                if d2 > reach * reach:
                    continue
                h = np.array([1.0, u[c] - cu, v[k] - cv])
                z = h @ plane
                r = h @ (covariance @ h) + doubt * doubt * (1.0 - np.exp(-0.5 * d2 / falloff**2))
                if np.isinf(p[k, c]):
                    height[k, c], p[k, c] = z, r
                    continue
                squares[k, c] += (z - height[k, c]) ** 2 / (p[k, c] + r)
                number[k, c] += 1.0
                gain = p[k, c] / (p[k, c] + r)
                height[k, c] += gain * (z - height[k, c])
                p[k, c] -= gain * p[k, c]
        first = last
    for k in range(len(v)):
        for c in range(len(u)):
            if number[k, c] > 0.0:
                p[k, c] *= max(1.0, squares[k, c] / number[k, c])
    return height, p


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid)
        kept = heard.select(used)
        # A coarse map must not lose readings between its nodes.
        reach = max(parameters.reach_m, *half_cells(grid, kept.spacing_m))
        points = Points(kept.foot_m, (kept.sigma_m / kept.excess) ** 2, kept.sweep, kept.row)
        trust = Trust(reach, parameters.falloff_m, parameters.doubt_m, parameters.slope_sigma)
        u, v = np.ascontiguousarray(grid.u_m), np.ascontiguousarray(grid.v_m)
        height, variance = node_filters(points, u, v, trust)
        wanted = covered(kept, grid) & np.isfinite(height)
        sigma = np.hypot(np.sqrt(np.where(wanted, variance, np.nan)), excess_sigma(kept, grid))
        return Estimate(np.where(wanted, height, np.nan), sigma, used)

    return mapwise("kalman_plane", parameters, estimate)
