"""Averaging that knows the physics: several pings of one trigger become one reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.records import BoolArray, Echo, FloatArray, IntArray, Status

# What a frame of the bus carries: logs hold exactly what is fused, whether a bus lies between or not.
RANGE_STEPS_PER_M = 100_000
AMPLITUDE_STEPS = 20_000
_MAD_TO_SIGMA = 1.4826
_SMALLEST_CLUSTER = 2


@dataclass(frozen=True)
class AveragingParameters:
    """Which pings count as consistent.

    Parameters
    ----------
    sigma_m : range noise of a single ping; the width below which scatter is never called an outlier.
    outlier_sigmas : a ping further than this from the median, in robust standard deviations, is an outlier.
    half_wavelength_m : range error of a cycle slip; 0 when the sensor has no cycles to slip.
    most_slips : a later ping within this many whole half wavelengths is a slip, not an outlier.
    """

    sigma_m: float = 0.5e-3
    outlier_sigmas: float = 3.5
    half_wavelength_m: float = 0.0
    most_slips: int = 4

    def __post_init__(self) -> None:
        if not self.sigma_m > 0.0:
            raise ConfigError(f"averaging.sigma_m = {self.sigma_m}", cure="give a standard deviation > 0 in metres")
        if not self.outlier_sigmas >= 1.0:
            raise ConfigError(f"averaging.outlier_sigmas = {self.outlier_sigmas}", cure="give 1 or more")
        if not 0.0 <= self.half_wavelength_m < 1.0:
            raise ConfigError(f"averaging.half_wavelength_m = {self.half_wavelength_m}", cure="give 0 to 1 m")
        if not 0 <= self.most_slips <= 100:
            raise ConfigError(f"averaging.most_slips = {self.most_slips}", cure="give 0 to 100")


@dataclass(frozen=True)
class Consistent:
    """Which of P finite pings agree: `used` (P,), by how many half wavelengths each slipped `slips` (P,)."""

    used: BoolArray
    slips: IntArray
    range_m: float
    spread_m: float


def average_pings(
    range_m: FloatArray, amplitude: FloatArray, t_s: float, parameters: AveragingParameters | None = None
) -> Echo:
    """One echo from the ranges (P,) and amplitudes (P,) of one trigger, ranges after REP-117.

    The most frequent answer decides: number, no echo, too close or fault; in a tie the number loses. A number is the
    mean of the consistent pings, its spread their standard deviation (nan for one ping), its count how many they are.
    Rounded to what the bus carries: 0.01 mm, and 1/20000 of the amplitude.
    """
    ranges = np.asarray(range_m, dtype=np.float64)
    strength = np.asarray(amplitude, dtype=np.float64)
    if ranges.ndim != 1 or len(ranges) == 0 or ranges.shape != strength.shape:
        raise DataError(
            f"{ranges.shape} ranges and {strength.shape} amplitudes", cure="give one amplitude a ping, and a ping"
        )
    status = _majority(ranges)
    if status is not Status.OK:
        number = {Status.NO_ECHO: np.inf, Status.TOO_CLOSE: -np.inf, Status.FAULT: np.nan}[status]
        return Echo(float(number), status, t_s, count=int(np.sum(_kinds(ranges) == int(status))))
    finite = np.isfinite(ranges)
    found = consistent(ranges[finite], parameters or AveragingParameters())
    heard = strength[finite][found.used]
    known = heard[np.isfinite(heard)]
    return Echo(
        range_m=_rounded(found.range_m, RANGE_STEPS_PER_M),
        status=Status.OK,
        t_s=t_s,
        amplitude=_rounded(float(known.mean()), AMPLITUDE_STEPS) if len(known) else float("nan"),
        spread_m=_rounded(found.spread_m, RANGE_STEPS_PER_M),
        count=int(found.used.sum()),
    )


def average_echoes(echoes: Sequence[Echo], parameters: AveragingParameters | None = None) -> Echo:
    """One echo from several of the same sensor; the time is that of the first."""
    if not echoes:
        raise DataError("no echoes to average", cure="give at least one")
    ranges = np.array([echo.range_m for echo in echoes])
    return average_pings(ranges, np.array([echo.amplitude for echo in echoes]), echoes[0].t_s, parameters)


def consistent(range_m: FloatArray, parameters: AveragingParameters) -> Consistent:
    """Find the pings that agree among finite ranges (P,), P > 0.

    A detector that misses periods answers late by whole half wavelengths. So pings which lie whole half wavelengths
    after the earliest group of at least two are taken back by that much. The rest are compared with the median, in
    units of the median absolute deviation (Hampel's rule).
    """
    slips = _slips(range_m, parameters)
    folded = range_m - slips * parameters.half_wavelength_m
    centre = float(np.median(folded))
    width = max(_MAD_TO_SIGMA * float(np.median(np.abs(folded - centre))), parameters.sigma_m)
    used = np.abs(folded - centre) <= parameters.outlier_sigmas * width
    kept = folded[used]
    spread = float(np.std(kept, ddof=1)) if len(kept) > 1 else float("nan")
    return Consistent(used, slips, float(kept.mean()), spread)


def _slips(range_m: FloatArray, parameters: AveragingParameters) -> IntArray:
    """Whole half wavelengths (P,) by which pings are late on the earliest group; 0 where that does not explain them."""
    none = np.zeros(len(range_m), dtype=np.int64)
    period = parameters.half_wavelength_m
    # Slips can only be told from noise when the noise is well below them.
    if period <= 0.0 or parameters.most_slips == 0 or parameters.sigma_m > 0.25 * period:
        return none
    order = np.sort(range_m)
    groups = np.split(order, np.flatnonzero(np.diff(order) > 0.5 * period) + 1)
    large = [group for group in groups if len(group) >= _SMALLEST_CLUSTER]
    if len(groups) == 1 or not large or np.ptp(large[0]) > period:
        return none
    late = (range_m - float(np.mean(large[0]))) / period
    whole = np.rint(late)
    explained = np.abs(late - whole) * period <= max(0.25 * period, parameters.sigma_m)
    slipped = explained & (whole > 0) & (whole <= parameters.most_slips)
    return np.where(slipped, whole, 0).astype(np.int64)


def _kinds(range_m: FloatArray) -> IntArray:
    """The `Status` (P,) that each range stands for."""
    kinds = np.full(len(range_m), int(Status.OK), dtype=np.int64)
    kinds[range_m == np.inf] = int(Status.NO_ECHO)
    kinds[range_m == -np.inf] = int(Status.TOO_CLOSE)
    kinds[np.isnan(range_m)] = int(Status.FAULT)
    return kinds


def _majority(range_m: FloatArray) -> Status:
    votes = np.bincount(_kinds(range_m), minlength=len(Status))
    others = votes[1:]
    return Status.OK if votes[0] > others.max() else Status(int(np.argmax(others)) + 1)


def _rounded(value: float, steps: int) -> float:
    return round(value * steps) / steps if np.isfinite(value) else value
