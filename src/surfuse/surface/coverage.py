"""Whether the stated standard deviation is honest: how often the truth lies within the intervals of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from surfuse.errors import DataError
from surfuse.records import FloatArray, Regime, SurfaceMap
from surfuse.surface.score import error_map

LEVELS = (0.50, 0.90, 0.99)
"""Probabilities of the central intervals."""


@dataclass(frozen=True)
class IntervalCoverage:
    """How often the truth lay within the intervals, over the cells of one regime (None: of all).

    `share` gives for each level the share of the cells within; `z_rms` is the root mean square of error over sigma (1
    when sigma is right), `rmse_m` that of the errors, `median_sigma_m` the median of the stated standard deviations.
    """

    regime: Regime | None
    cells: int
    share: tuple[float, ...]
    z_rms: float
    rmse_m: float
    median_sigma_m: float


def half_width(level: float) -> float:
    """Half the central interval of that probability of a normal distribution, in standard deviations.

    Raises
    ------
    DataError : not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise DataError(f"an interval of probability {level}", cure="give a probability between 0 and 1")
    return NormalDist().inv_cdf(0.5 + 0.5 * level)


def interval_coverage(
    surface: SurfaceMap, truth: SurfaceMap, levels: Sequence[float] = LEVELS
) -> tuple[IntervalCoverage, ...]:
    """Coverage of the normal intervals height +- k sigma: over all cells first, then regime by regime.

    Only cells where map and truth both have a value count; a truth on another grid is resampled to the map's.

    Raises
    ------
    DataError : no cell in common.
    """
    error = error_map(surface, truth)
    known = np.isfinite(error)
    if not np.any(known):
        raise DataError("map and truth have no cell in common", cure="check the frames and units of map and truth")
    error, sigma, regime = error[known], surface.sigma_m[known], surface.regime[known]
    found = [_over(None, error, sigma, levels)]
    for kind in Regime:
        here = regime == int(kind)
        if np.any(here):
            found.append(_over(kind, error[here], sigma[here], levels))
    return tuple(found)


def _over(regime: Regime | None, error: FloatArray, sigma: FloatArray, levels: Sequence[float]) -> IntervalCoverage:
    # A sigma of 0 states certainty: any error then lies outside of every interval.
    z = np.abs(error) / np.maximum(sigma, np.finfo(np.float64).tiny)
    return IntervalCoverage(
        regime=regime,
        cells=len(error),
        share=tuple(float(np.mean(z <= half_width(level))) for level in levels),
        z_rms=float(np.sqrt(np.mean(np.minimum(z, 1e6) ** 2))),
        rmse_m=float(np.sqrt(np.mean(error**2))),
        median_sigma_m=float(np.median(sigma)),
    )
