"""The whole estimate over one raster: candidate explanations on a coarse raster, the most probable one refined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.fusion.beam_model.plate import Stiffness
from surfuse.fusion.beam_model.problem import Problem, problem, reach
from surfuse.fusion.beam_model.raster import Raster, slopes
from surfuse.fusion.beam_model.search import Solution, find
from surfuse.fusion.beam_model.starts import nearest_allowed, plane, speckle_shift
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
    near = nearest_allowed(p, surfels)
    found = []
    for second, third in DENSITIES:
        stiffness = Stiffness(second, third, edge)
        found.append(find(p, near, "points", stiffness, SHARP))
        found.append(find(p, level, "plane", stiffness, ANNEALED))
    return sorted(found, key=lambda solution: solution.score)


def finer(coarse: Problem, solution: Solution, raster: Raster) -> FloatArray:
    """The solution on a finer raster: each new cell on the facet of the old cell that contains it."""
    su, sv, _, _, _ = slopes(solution.height_m, coarse.raster.domain, coarse.raster.g_m, solution.crease_m)
    u, v = raster.nodes()
    rows, cols = coarse.raster.shape
    i = np.clip(np.floor((u - coarse.raster.u0_m) / coarse.raster.g_m + 0.5).astype(np.int64), 0, cols - 1)
    j = np.clip(np.floor((v - coarse.raster.v0_m) / coarse.raster.g_m + 0.5).astype(np.int64), 0, rows - 1)
    du = u - (coarse.raster.u0_m + i * coarse.raster.g_m)
    dv = v - (coarse.raster.v0_m + j * coarse.raster.g_m)
    jj, ii = j[:, None], i[None, :]
    return np.asarray(solution.height_m[jj, ii] + su[jj, ii] * du[None, :] + sv[jj, ii] * dv[:, None])


def refine(p: Problem, fine: Problem, best: list[Solution]) -> Solution:
    """The best explanations again on the finer raster; the most probable of them."""
    found = [
        find(fine, finer(p, solution, fine.raster), solution.start, solution.stiffness, (0.0,) * 8) for solution in best
    ]
    return min(found, key=lambda solution: solution.score)


def on_raster(p: Problem, raster: Raster) -> Problem:
    """The same stations over another raster."""
    return problem(p.stations, p.tables, raster, p.spacing_m)
