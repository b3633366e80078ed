"""The whole estimate over one raster: candidate explanations on a coarse raster, the most probable one refined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from surfuse.fusion.beam_model.plate import Stiffness
from surfuse.fusion.beam_model.problem import Problem, problem, reach
from surfuse.fusion.beam_model.raster import Raster, slopes
from surfuse.fusion.beam_model.search import Solution, find
from surfuse.fusion.beam_model.starts import nearest_allowed, plane, quadric, speckle_shift
from surfuse.fusion.beam_model.surfels import Surfels, find_surfels
from surfuse.records import FloatArray

# From plates without curvature to free forms: spectral densities of curvature and of its change.
DENSITIES = (
    (1e-5, 1e2),
    (1e-4, 1e2),
    (1e-3, 1e2),
    (1e-2, 1e2),
    (1e-1, 1e2),
    (1e-1, 1e0),
    (1e-1, 1e-2),
)
SHARP = (0.0005,) * 3 + (0.0,) * 6
BENT = (0.002,) * 4 + (0.0005,) * 3 + (0.0,) * 6
ANNEALED = (0.005,) * 4 + (0.002,) * 4 + (0.0005,) * 3 + (0.0,) * 4


@dataclass(frozen=True)
class Candidate:
    """One explanation that was tried: its start, prior and score (minus log evidence a station)."""

    start: str
    second: float
    third: float
    score: float


def surfels_of(p: Problem) -> Surfels:
    """Oriented points of all stations."""
    slopes = np.array([np.sin(np.arctan(reach(t))) for t in p.tables])[p.stations.spec]
    return find_surfels(p.stations, p.spacing_m, slopes)


def explore(p: Problem, surfels: Surfels, edge: float) -> list[Solution]:
    """Every prior from both starts, the most probable first."""
    blurred = p.stations.position_m + p.stations.axis * (p.stations.range_m - speckle_shift(p))[:, None]
    level = plane(p, blurred)
    bent = quadric(p, blurred)
    near = nearest_allowed(p, surfels)
    found = []
    for second, third in DENSITIES:
        stiffness = Stiffness(second, third, edge)
        found.append(find(p, near, "points", stiffness, SHARP))
        found.append(find(p, level, "plane", stiffness, ANNEALED))
        found.append(find(p, bent, "quadric", stiffness, BENT))
    return sorted(found, key=lambda solution: solution.score)


def finer(coarse: Problem, solution: Solution, raster: Raster) -> FloatArray:
    """The solution on a finer raster: each new cell on the facet of the old cell that contains it."""
    r = coarse.raster
    su, sv, _, _, _ = slopes(solution.height_m, r.domain, r.g_m, solution.crease_m)
    u, v = raster.nodes()
    rows, cols = r.shape
    i = np.clip(np.floor((u - r.u0_m) / r.g_m + 0.5).astype(np.int64), 0, cols - 1)
    j = np.clip(np.floor((v - r.v0_m) / r.g_m + 0.5).astype(np.int64), 0, rows - 1)
    # A cell whose parent lies off the domain continues the nearest facet of the domain.
    _, parent = distance_transform_edt(~r.domain, return_indices=True)
    jj, ii = parent[0][j[:, None], i[None, :]], parent[1][j[:, None], i[None, :]]
    du, dv = u[None, :] - (r.u0_m + ii * r.g_m), v[:, None] - (r.v0_m + jj * r.g_m)
    return np.asarray(solution.height_m[jj, ii] + su[jj, ii] * du + sv[jj, ii] * dv)


def refine(p: Problem, fine: Problem, best: list[Solution]) -> Solution:
    """The best explanations again on the finer raster; the most probable of them."""
    found = [
        find(fine, finer(p, solution, fine.raster), solution.start, solution.stiffness, (0.0,) * 8) for solution in best
    ]
    return min(found, key=lambda solution: solution.score)


def on_raster(p: Problem, raster: Raster) -> Problem:
    """The same stations over another raster."""
    return problem(p.stations, p.tables, raster, p.spacing_m)
