"""The whole estimate over one raster: candidate explanations on a coarse raster, the most probable one refined."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates, maximum_filter

from surfuse.beam_model.heard.wavefronts import Surfels
from surfuse.beam_model.judge.plain_surfaces import simple_surfaces
from surfuse.beam_model.prior.raster import Raster, slopes
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.descent import Solution, descend, evidence, find
from surfuse.beam_model.search.edges import settle
from surfuse.beam_model.search.estimation import Estimation, arrivals
from surfuse.beam_model.search.first_surfaces import nearest_allowed, plane, quadric, speckle_shift, tilted
from surfuse.beam_model.search.terraces import terraces
from surfuse.beam_model.search.unheld_pieces import reattached
from surfuse.records import BoolArray, FloatArray

# From plates without curvature to free forms: spectral densities of curvature and of its change.
FLAT, STIFF, PLAIN, SOFT, FREE, WAVY, ROUND = (
    (1e-5, 1e2), (1e-4, 1e2), (1e-3, 1e2), (1e-2, 1e2), (1e-1, 1e2), (1e-1, 1e0), (1e-1, 1e-2),
)  # fmt: skip
DENSITIES = (FLAT, STIFF, PLAIN, SOFT, FREE, WAVY, ROUND)
SHARP = (0.0005,) * 2 + (0.0,) * 5
REFINED = (0.0005,) * 2 + (0.0,) * 6
MOSTLY = 0.6
STIFFER = (FLAT, PLAIN)
BENT = (0.002,) * 3 + (0.0005,) * 2 + (0.0,) * 5
ANNEALED = (0.005,) * 4 + (0.002,) * 3 + (0.0005,) * 2 + (0.0,) * 4


def surfels_of(p: Estimation) -> Surfels:
    """Oriented points of all stations."""
    return p.surfels


@dataclass(frozen=True)
class Effort:
    """Which explanations are tried: priors from each start, how many get their edges moved, other priors at the end.

    `points`, `plane`, `quadric`, `tilt` are pairs of densities (second, third; see `Stiffness`) that are tried from a
    start of that name; from the end of the free space those of `points`, from parallel levels those of `plane`. The
    edges of the `settled` best explanations are moved; `again` are pairs tried from the best one. `fine` says whether a
    raster of half the cell size follows.
    """

    points: tuple[tuple[float, float], ...] = DENSITIES
    plane: tuple[tuple[float, float], ...] = (FLAT, PLAIN, SOFT, FREE)
    quadric: tuple[tuple[float, float], ...] = (SOFT, FREE, WAVY, ROUND)
    tilt: tuple[tuple[float, float], ...] = (FLAT, PLAIN, SOFT, FREE)
    settled: int = 3
    again: tuple[tuple[float, float], ...] = DENSITIES
    fine: bool = True


FULL = Effort()
# For parts of many tiles: the same ideas with fewer priors.
LEAN = Effort((FLAT, PLAIN, FREE), (FLAT,), (WAVY,), (FLAT,), 1, (), False)


def explore(p: Estimation, edge: float, effort: Effort = FULL) -> list[Solution]:
    """Every prior from its starts, the most probable first; the edges of the best are moved.

    `edge` is the price of a broken difference in units of log likelihood. The result is sorted by score, the best
    first; it has one entry for each prior and start that was tried.
    """
    blurred = p.stations.position_m + p.stations.axis * (p.stations.range_m - speckle_shift(p))[:, None]
    near = nearest_allowed(p, p.surfels)
    level = plane(p, blurred)
    found = [find(p, near, "points", Stiffness(*pair, edge), SHARP) for pair in effort.points]
    found += [find(p, level, "plane", Stiffness(*pair, edge), ANNEALED) for pair in effort.plane]
    carved = simple_surfaces(p)["carving"]
    found += [find(p, carved, "carving", Stiffness(*pair, edge), SHARP) for pair in effort.points]
    if np.mean(p.surfels.coherent) < MOSTLY:
        lean = tilted(p, level)
        found += [find(p, lean, "tilt", Stiffness(*pair, edge), BENT) for pair in effort.tilt]
    # Where most neighbours share a wavefront, the oriented points have the curvature already.
    if effort.fine or np.mean(p.surfels.coherent) < MOSTLY:
        bent = quadric(p, blurred)
        found += [find(p, bent, "quadric", Stiffness(*pair, edge), BENT) for pair in effort.quadric]
    for stepped in terraces(p, carved):
        found += [find(p, stepped, "terraces", Stiffness(*pair, edge), SHARP) for pair in effort.plane]
    found = sorted(found, key=lambda solution: solution.score)
    moved = [with_settled_edges(p, solution) for solution in found[: effort.settled]]
    found = sorted(moved + found[effort.settled :], key=lambda solution: solution.score)
    best = found[0]
    others = [pair for pair in effort.again if pair != (best.stiffness.second, best.stiffness.third)]
    if not others:
        return found
    again = [find(p, best.height_m, best.start, Stiffness(*pair, edge), SHARP) for pair in others]
    found = sorted(found + again, key=lambda solution: solution.score)
    return [with_settled_edges(p, found[0]), *found[1:]]


def with_settled_edges(p: Estimation, solution: Solution) -> Solution:
    """The same explanation after its edges have moved to where the readings want them."""
    height, heard = settle(p, solution.height_m, solution.heard, solution.stiffness, solution.crease_m)
    if height is solution.height_m:
        return solution
    score = evidence(p, height, heard, solution.stiffness)
    return replace(solution, height_m=height, heard=heard, score=score) if score < solution.score else solution


def completed(p: Estimation, best: Solution, effort: Effort) -> Solution:
    """The explanation settled on all stations of its raster, those that were held out of the search among them."""
    height, heard = descend(p, best.height_m, best.stiffness, best.crease_m, (0.0,) * 2)
    whole = replace(best, height_m=height, heard=heard, score=evidence(p, height, heard, best.stiffness))
    return with_settled_edges(p, whole) if effort.settled else whole


def finer(coarse: Estimation, solution: Solution, raster: Raster) -> FloatArray:
    """The solution on a finer raster: each new cell on the facet of the old cell that contains it.

    Heights (R', C') in m over `raster`. Away from edges a cubic spline is taken instead of the facets.
    """
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
    facets = solution.height_m[jj, ii] + su[jj, ii] * du + sv[jj, ii] * dv
    # Where no edge is near, a spline has no kinks that the prior would take for edges.
    j0, i0 = np.indices(r.shape)
    whole = solution.height_m[parent[0], parent[1]] + r.g_m * (
        su[parent[0], parent[1]] * (i0 - parent[1]) + sv[parent[0], parent[1]] * (j0 - parent[0])
    )
    at = np.meshgrid((v - r.v0_m) / r.g_m, (u - r.u0_m) / r.g_m, indexing="ij")
    spline = map_coordinates(whole, at, order=3, mode="nearest")
    broken = maximum_filter(breaks(whole, solution.crease_m), 5)
    j, i = np.clip(np.rint(at[0]).astype(int), 0, rows - 1), np.clip(np.rint(at[1]).astype(int), 0, cols - 1)
    return np.asarray(np.where(broken[j, i], facets, spline))


def breaks(height: FloatArray, crease_m: float) -> BoolArray:
    """Cells (R, C) whose bend along u or v is that of an edge.

    `height` (R, C) in m; a bend is a second difference, an edge one above `crease_m`.
    """
    bent = np.zeros(height.shape, dtype=bool)
    bent[:, 1:-1] |= np.abs(np.diff(height, 2, axis=1)) > crease_m
    bent[1:-1, :] |= np.abs(np.diff(height, 2, axis=0)) > crease_m
    return bent


def refine(coarse: Estimation, fine: Estimation, best: Solution) -> Solution:
    """The best explanation on the finer raster; an edge of the same length breaks twice as many differences there.

    In speckle a soft prior that won on the coarse raster may follow the grain on the finer one: stiffer ones compete.
    """
    start = finer(coarse, best, fine.raster)
    own = (best.stiffness.second, best.stiffness.third)
    rivals = [pair for pair in STIFFER if pair[0] < own[0]] if np.mean(fine.surfels.coherent) < MOSTLY else []
    trials = [
        find(fine, start, best.start, Stiffness(*pair, 0.5 * best.stiffness.edge), REFINED) for pair in (own, *rivals)
    ]
    # Treads of a few cells only exist on the finer raster.
    for steps in terraces(fine, simple_surfaces(fine)["carving"]):
        half = 0.5 * best.stiffness.edge
        trials += [find(fine, steps, "terraces", Stiffness(*pair, half), SHARP) for pair in STIFFER]
    found = min(trials, key=lambda solution: solution.score)
    whole = reattached(fine, found.height_m, found.heard, found.crease_m)
    found = replace(found, height_m=whole, heard=arrivals(fine, whole, found.crease_m))
    height, heard = settle(fine, found.height_m, found.heard, found.stiffness, found.crease_m, steps=(1,))
    return replace(found, height_m=height, heard=heard)
