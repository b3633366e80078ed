"""What the cells of the solution rest on: how uncertain, how many readings, what kind of evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, maximum_filter, uniform_filter

from surfuse.beam_model.echo.arrivals import MIRROR, RIM, SPECKLE
from surfuse.beam_model.prior.band_matrix import colour, factor
from surfuse.beam_model.search.descent import LOOSE_M, Solution
from surfuse.beam_model.search.estimation import Estimation, deviation, pulls, residuals
from surfuse.records import ByteArray, FloatArray, IntArray, Regime

SAMPLES = 64
# Share of a sensor's own sigma that neither averaging nor neighbours remove (its offset).
COMMON = 0.2
# Share of the model's scatter that neighbours have in common, by kind of arrival.
SHARED = {MIRROR: 0.8, SPECKLE: 0.12, RIM: 0.3}
# Slope that an unmeasured strip may hide, so that its uncertainty grows with the distance from what is measured.
HIDDEN_SLOPE = 0.12
# Where the readings around a cell miss their predictions by more than they should, sigma grows with it: neighbourhood,
# and the most that a single reading counts (square of its miss over its standard deviation).
AROUND_M = 0.025
LARGEST_RATIO = 16.0
FLOOR_M = 0.00003


@dataclass(frozen=True)
class Layers:
    """What is known of the heights of a map, each (R, C).

    `sigma_m` is their standard deviation in m, `count` the number of readings that a cell rests on, `regime` says
    whether it is measured or only the prior's (`Regime`), `confidence` is the share of its readings that the surface
    explains, in [0, 1].
    """

    sigma_m: FloatArray
    count: IntArray
    regime: ByteArray
    confidence: FloatArray


def posterior_sigma(p: Estimation, solution: Solution) -> FloatArray:
    """Standard deviation (R, C) from samples of the linearised posterior, drawn with its Cholesky factor."""
    data, _ = pulls(p, solution.heard, solution.height_m, 0.0)
    band = p.plate.precision(solution.height_m, solution.stiffness, LOOSE_M**-2)
    band[:, 0] += p.plate.vector(data)
    noise = np.random.default_rng(7).normal(size=(p.plate.size, SAMPLES))
    samples = colour(factor(band), noise)
    return np.asarray(p.plate.field(np.mean(samples**2, axis=1)) ** 0.5)


def by_cell(p: Estimation, solution: Solution, values: FloatArray, kind: int) -> FloatArray:
    """Sum (R, C) of a station column over the cells that the stations hear in one way."""
    heard, shape = solution.heard, p.raster.shape
    rows = heard.kind == kind
    flat = heard.row[rows] * shape[1] + heard.column[rows]
    sums = np.bincount(flat, weights=values[rows], minlength=shape[0] * shape[1])
    return np.asarray(sums.reshape(shape), dtype=np.float64)


def around(layer: FloatArray, width: int) -> FloatArray:
    """Sum (R, C) over a square neighbourhood."""
    return np.asarray(uniform_filter(layer, width, mode="constant") * width * width)


def common_sigma(p: Estimation, solution: Solution, width: int) -> FloatArray:
    """Part (R, C) of the uncertainty that neighbours share and smoothing does not remove."""
    one = np.ones(len(p.stations))
    total, number = np.zeros(p.raster.shape), np.zeros(p.raster.shape)
    for kind, share in SHARED.items():
        total += around(by_cell(p, solution, share * solution.heard.scatter_m, kind), width)
        number += around(by_cell(p, solution, one, kind), width)
    known = number > 0.5
    model = np.where(known, total / np.maximum(number, 0.5), 0.0)
    if np.any(known):
        _, nearest = distance_transform_edt(~known, return_indices=True)
        model = model[nearest[0], nearest[1]]
    sensor = COMMON * float(np.median(p.stations.sigma_m * np.sqrt(p.stations.count)))
    return np.asarray(np.sqrt(model**2 + sensor**2 + FLOOR_M**2))


def external(p: Estimation, solution: Solution) -> FloatArray:
    """Ratio (R, C), at least 1, of the external to the internal variance of the readings around each cell.

    External: how far they are from what the surface predicts (Birge, Phys. Rev. 40 (1932) 207).
    """
    error, known = residuals(p, solution.heard)
    square = known * np.minimum((error / deviation(p, solution.heard, 0.0)) ** 2, LARGEST_RATIO)
    width = 2 * max(1, round(AROUND_M / p.raster.g_m)) + 1
    total, number = np.zeros(p.raster.shape), np.zeros(p.raster.shape)
    for kind in SHARED:
        total += around(by_cell(p, solution, square, kind), width)
        number += around(by_cell(p, solution, known, kind), width)
    return np.asarray(np.maximum(total / np.maximum(number, 0.5), 1.0))


def speed_sigma(p: Estimation, solution: Solution) -> float:
    """Error of the height (m) from the speed of sound, which all readings share: a share of the range, seen along w."""
    heard = solution.heard
    known = (heard.kind == MIRROR) | (heard.kind == SPECKLE)
    if not np.any(known):
        return 0.0
    share = np.array([table.speed_share for table in p.tables])[p.stations.spec]
    return float(np.median((share * p.stations.range_m / np.maximum(np.abs(heard.gain), 0.2))[known]))


def layers(p: Estimation, solution: Solution, doubt_m: FloatArray | None = None) -> Layers:
    """All layers of a solution; `doubt_m` (R, C) says how far other explanations of the same readings are from it."""
    width = 2 * max(1, round(0.75 * p.spacing_m / p.raster.g_m)) + 1 if np.isfinite(p.spacing_m) else 3
    number = p.stations.count.astype(np.float64)
    mirror = around(by_cell(p, solution, number, MIRROR), width)
    speckle = around(by_cell(p, solution, number, SPECKLE), width)
    rim = maximum_filter(by_cell(p, solution, number, RIM), 3, mode="constant")
    direct = mirror + speckle
    regime = np.where(mirror > 0.5, int(Regime.MIRROR), int(Regime.PRIOR))
    regime = np.where(speckle > np.maximum(mirror, 0.5), int(Regime.SPECKLE), regime)
    regime = np.where((regime == int(Regime.PRIOR)) & (rim > 0.5), int(Regime.EDGE), regime)
    away = distance_transform_edt(direct < 0.5) * p.raster.g_m if np.any(direct >= 0.5) else np.full(direct.shape, 1.0)
    sigma = np.sqrt(
        (posterior_sigma(p, solution) ** 2 + common_sigma(p, solution, width) ** 2) * external(p, solution)
        + speed_sigma(p, solution) ** 2
        + (HIDDEN_SLOPE * away) ** 2
        + (0.0 if doubt_m is None else doubt_m**2)
    )
    e, known = residuals(p, solution.heard)
    spread = np.maximum(solution.heard.scatter_m, 2.0 * p.stations.sigma_m + 0.0005)
    believed = known / (1.0 + (e / (2.0 * spread)) ** 2)
    good, seen = np.zeros(p.raster.shape), np.zeros(p.raster.shape)
    for kind in SHARED:
        good += around(by_cell(p, solution, believed, kind), width)
        seen += around(by_cell(p, solution, known, kind), width)
    confidence = np.where(seen > 1e-6, good / np.maximum(seen, 1e-6), 0.0)
    count = np.rint(np.where(direct < 0.5, rim, direct)).astype(np.int64)
    return Layers(sigma, count, regime.astype(np.uint8), np.clip(confidence, 0.0, 1.0))
