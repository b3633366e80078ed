"""Guard: readings that the estimate was not shown judge it against simple surfaces, region by region.

A fifth of the stations is held out of the search. Over the surface that was found and over simple ones, the forward
model predicts what the held-out stations should have heard. Where a simple surface predicts clearly better, and not
from within space that was heard to be free, it is taken. Source: cross-validation with paired differences (Stone, J. R.
Stat. Soc. B 36 (1974) 111-147).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.judge.plain_surfaces import simple_surfaces
from surfuse.beam_model.map.tiles import RasterLayers, Tile
from surfuse.beam_model.prior.raster import Raster, slopes
from surfuse.beam_model.search.descent import Solution
from surfuse.beam_model.search.estimation import Estimation, arrivals, free_space, problem, residuals
from surfuse.beam_model.search.first_surfaces import trusted
from surfuse.records import BoolArray, FloatArray, GuardReason, IntArray, Regime, RegionDecision

OWN = "beam"
ONE_IN = 5
# Fewer stations than this are all needed for the estimate; fewer held-out ones than this judge no region.
LEAST_STATIONS = 100
LEAST_JUDGES = 6
REGION_M = 0.10
LINE_M = 0.0019
# A miss counts no more than this: an outlier judges nobody.
LARGEST_MISS_M = 0.02
# What is clearly better: by this share of the miss, by this much, and by so many standard errors of the difference.
CLEARLY, AT_LEAST_M, STANDARD_ERRORS = 0.25, 0.0005, 2.5
FREE_SLACK_M, MORE_VIOLATION = 0.002, 0.05
ABSOLUTE_TO_SIGMA = 1.2533


@dataclass(frozen=True)
class HeldOutVerdict:
    """The decisions on the regions of one raster: `region` (R, C) numbers the cells, and indexes `decisions`."""

    region: IntArray
    decisions: tuple[RegionDecision, ...]

    @property
    def replaced(self) -> bool:
        """Whether any region was taken from another surface."""
        return any(one.chosen != OWN for one in self.decisions)


def held_out(stations: Stations) -> BoolArray:
    """One station in five (M,), evenly over the part; none where there are too few."""
    count = len(stations)
    if count < LEAST_STATIONS:
        return np.zeros(count, dtype=np.bool_)
    # Lines of a raster in whole or half millimetres never lie on the border of two such lines.
    place = np.round(stations.foot_m[:, :2] / LINE_M)
    order = np.lexsort((place[:, 0], place[:, 1]))
    chosen = np.zeros(count, dtype=np.bool_)
    chosen[order[ONE_IN // 2 :: ONE_IN]] = True
    return chosen


def regions(raster: Raster) -> IntArray:
    """Number (R, C) of the square region of each cell."""
    side = max(1, round(REGION_M / raster.g_m))

    def blocks(length: int) -> IntArray:
        count = max(1, round(length / side))
        return np.asarray(np.arange(length) * count // length, dtype=np.int64)

    rows, cols = raster.shape
    down, across = blocks(rows), blocks(cols)
    return np.asarray(down[:, None] * (int(across[-1]) + 1) + across[None, :], dtype=np.int64)


def misses(judges: Estimation, height: FloatArray, crease_m: float) -> FloatArray:
    """How far (M,) the held-out ranges are from the prediction over a surface; nothing predicted is a full miss."""
    error, known = residuals(judges, arrivals(judges, height, crease_m))
    return np.where(known > 0.0, np.minimum(np.abs(error), LARGEST_MISS_M), LARGEST_MISS_M)


def judged(p: Estimation, solution: Solution, judges: Stations, tile: Tile | None = None) -> HeldOutVerdict:
    """Decide region by region; `p` holds the stations that the solution was made of, `judges` the others.

    Of a tile, only the regions of the cells that are kept.
    """
    r = p.raster
    kept = r.domain.copy()
    if tile is not None:
        kept[:] = False
        kept[tile.rows, tile.cols] = r.domain[tile.rows, tile.cols]
    region = np.where(kept, regions(r), -1)
    names, number = np.unique(region, return_inverse=True)
    region = np.asarray(number.reshape(r.shape) - int(names[0] < 0), dtype=np.int64)
    surfaces = {OWN: solution.height_m, **simple_surfaces(p)}
    over = r.holds(judges.foot_m)
    court = problem(judges.select(over), p.tables, r, p.spacing_m)
    foot = court.stations.foot_m
    i = np.floor((foot[:, 0] - r.u0_m) / r.g_m + 0.5).astype(np.int64)
    j = np.floor((foot[:, 1] - r.v0_m) / r.g_m + 0.5).astype(np.int64)
    own = region[j, i]
    miss = np.column_stack([misses(court, height, solution.crease_m) for height in surfaces.values()])
    bound = free_space(p, trusted(p, p.surfels)) + FREE_SLACK_M
    above = np.stack([height > bound for height in surfaces.values()])
    decisions = tuple(
        _decided(r, region == k, tuple(surfaces), miss[own == k], above[:, region == k].mean(axis=1))
        for k in range(int(region.max()) + 1)
    )
    return HeldOutVerdict(region, decisions)


def _decided(
    raster: Raster, cells: BoolArray, names: tuple[str, ...], miss: FloatArray, violation: FloatArray
) -> RegionDecision:
    """The decision on one region from the misses (n, K) of its judges and the violations (K,) of free space."""
    mean = miss.mean(axis=0) if len(miss) else np.full(len(names), np.nan)
    chosen, reason = 0, GuardReason.TOO_FEW
    if len(miss) >= LEAST_JUDGES:
        gain = miss[:, :1] - miss
        error = gain.std(axis=0, ddof=1) / np.sqrt(len(miss)) + 1e-9
        better = (gain.mean(axis=0) > np.maximum(CLEARLY * mean[0], AT_LEAST_M)) & (
            gain.mean(axis=0) > STANDARD_ERRORS * error
        )
        free = violation <= violation[0] + MORE_VIOLATION
        reason = GuardReason.BEST
        if np.any(better & free):
            chosen, reason = int(np.argmin(np.where(better & free, mean, np.inf))), GuardReason.BEATEN
        elif np.any(better):
            reason = GuardReason.FREE_SPACE
    jj, ii = np.nonzero(cells)
    half = 0.5 * raster.g_m
    return RegionDecision(
        low_uv_m=(raster.u0_m + raster.g_m * ii.min() - half, raster.v0_m + raster.g_m * jj.min() - half),
        high_uv_m=(raster.u0_m + raster.g_m * ii.max() + half, raster.v0_m + raster.g_m * jj.max() + half),
        cells=len(jj), held_out=len(miss), candidates=names, chosen=names[chosen], reason=reason,
        miss_m=tuple(float(x) for x in mean), above_free_space=tuple(float(x) for x in violation),
    )  # fmt: skip


def fallen_back(sheet: RasterLayers, p: Estimation, verdict: HeldOutVerdict, raster: Raster) -> RasterLayers:
    """The sheet with the surface of every lost region replaced by the one that won it.

    `raster` is that of the verdict. Sigma there is what the held-out readings missed the winner by; the regime says
    that readings, and no model of the echo, hold the cells.
    """
    if not verdict.replaced:
        return sheet
    surfaces = simple_surfaces(p)
    u, v = p.raster.nodes()
    rows, cols = raster.shape
    i = np.clip(np.floor((u - raster.u0_m) / raster.g_m + 0.5).astype(np.int64), 0, cols - 1)
    j = np.clip(np.floor((v - raster.v0_m) / raster.g_m + 0.5).astype(np.int64), 0, rows - 1)
    region = verdict.region[j[:, None], i[None, :]]
    height, sigma, regime = sheet.height_m.copy(), sheet.sigma_m.copy(), sheet.regime.copy()
    second, weight = sheet.second_m.copy(), sheet.second_weight.copy()
    for k, one in enumerate(verdict.decisions):
        if one.chosen == OWN:
            continue
        cells = (region == k) & sheet.known
        height[cells] = surfaces[one.chosen][cells]
        sigma[cells] = ABSOLUTE_TO_SIGMA * one.miss_m[one.candidates.index(one.chosen)]
        regime[cells & (regime != int(Regime.PRIOR))] = int(Regime.MEASURED)
        second[cells], weight[cells] = np.nan, 0.0
    su, sv, _, _, _ = slopes(height, p.raster.domain, p.raster.g_m, FREE_SLACK_M)
    return replace(
        sheet, height_m=height, slope_u=su, slope_v=sv, sigma_m=sigma, regime=regime, second_m=second,
        second_weight=weight,
    )  # fmt: skip
