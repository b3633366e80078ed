"""Averaging that knows the physics: several pings of one trigger become one reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.records import BoolArray, Echo, FloatArray, IntArray, Status

# What a frame of the bus carries: logs hold exactly what is fused, whether a bus lies between or not.
RANGE_STEPS_PER_M = 100_000
AMPLITUDE_STEPS = 20_000
# Slips can be told from noise only when the noise is well below them.
_NOISE_LIMIT = 0.2
_WIDENINGS = 2.0 ** np.arange(7)
_WIDENING_COST = 1.0
_ANYWHERE_M = 1.0
_ROUNDS = 3
# Pings as close together as this agree whatever the other hypotheses say.
_PLAIN_SIGMAS = 2.0


@dataclass(frozen=True)
class AveragingParameters:
    """Which pings count as consistent.

    Parameters
    ----------
    sigma_m : range noise of a single ping; the width below which scatter is never called an outlier.
    outlier_sigmas : a ping further than this from the others, in standard deviations, is an outlier.
    half_wavelength_m : range error of a cycle slip; 0 when the sensor has no cycles to slip.
    most_slips : a later ping within this many whole half wavelengths is a slip, not an outlier.
    resolution_m : step in which the ranges are counted; adds to the noise of a ping.
    slip_share : how likely a ping is one period late, before it is seen; its square two periods, and so on.
    outlier_share : how likely a ping has nothing to do with the surface, before it is seen; it then lies anywhere
        within a metre.
    """

    sigma_m: float = 0.5e-3
    outlier_sigmas: float = 3.5
    half_wavelength_m: float = 0.0
    most_slips: int = 4
    resolution_m: float = 0.0
    slip_share: float = 0.1
    outlier_share: float = 0.3

    def __post_init__(self) -> None:
        if not self.sigma_m > 0.0:
            raise ConfigError(f"averaging.sigma_m = {self.sigma_m}", cure="give a standard deviation > 0 in metres")
        if not self.outlier_sigmas >= 1.0:
            raise ConfigError(f"averaging.outlier_sigmas = {self.outlier_sigmas}", cure="give 1 or more")
        for name in ("half_wavelength_m", "resolution_m"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ConfigError(f"averaging.{name} = {getattr(self, name)}", cure="give 0 to 1 m")
        if not 0 <= self.most_slips <= 100:
            raise ConfigError(f"averaging.most_slips = {self.most_slips}", cure="give 0 to 100")
        for name in ("slip_share", "outlier_share"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ConfigError(f"averaging.{name} = {getattr(self, name)}", cure="give a share between 0 and 1")

    @property
    def noise_m(self) -> float:
        """Standard deviation of one ping: its noise and, uniform within a step, the error of counting."""
        return math.hypot(self.sigma_m, self.resolution_m / math.sqrt(12.0))


@dataclass(frozen=True)
class Consistent:
    """Which of P finite pings agree: `used` (P,), by how many half wavelengths each slipped `slips` (P,).

    `range_m` and `spread_m` are mean and standard deviation of the used ones after the slips are taken out, in m.
    """

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

    Raises
    ------
    DataError : there is no ping, or not one amplitude a range.
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
    """One echo from several of the same sensor; the time is that of the first.

    Raises
    ------
    DataError : there are no echoes.
    """
    if not echoes:
        raise DataError("no echoes to average", cure="give at least one")
    ranges = np.array([echo.range_m for echo in echoes])
    return average_pings(ranges, np.array([echo.amplitude for echo in echoes]), echoes[0].t_s, parameters)


def consistent(range_m: FloatArray, parameters: AveragingParameters) -> Consistent:
    """Find the pings that agree among finite ranges (P,), P > 0.

    A detector that misses periods answers late by whole half wavelengths; a neighbour's burst or a passing draught
    answers anything. So each ping may be right, late by whole half wavelengths, or an outlier; the range and the width
    of the scatter that make the pings most likely together are taken (maximum likelihood of a mixture). In a tie the
    narrower scatter wins, then the earlier echo.
    """
    order = np.argsort(range_m, kind="stable")
    pings = np.asarray(range_m[order], dtype=np.float64)
    if pings[-1] - pings[0] <= _PLAIN_SIGMAS * parameters.noise_m:
        return Consistent(np.ones(len(pings), dtype=np.bool_), np.zeros(len(pings), dtype=np.int64), *_mean(pings))
    centre, width, most = _likeliest(pings, parameters)
    periods = np.arange(most + 1) * parameters.half_wavelength_m
    used = np.ones(len(pings), dtype=np.bool_)
    for _ in range(_ROUNDS):
        slips = np.argmin(np.abs(pings[:, None] - centre - periods), axis=1)
        folded = pings - periods[slips]
        used = np.abs(folded - centre) <= parameters.outlier_sigmas * width
        centre = float(folded[used].mean())
    back = np.argsort(order, kind="stable")
    return Consistent(used[back], np.where(used, slips, 0)[back].astype(np.int64), *_mean(folded[used]))


def _mean(kept_m: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of pings that agree; one ping has no deviation."""
    return float(kept_m.mean()), float(np.std(kept_m, ddof=1)) if len(kept_m) > 1 else math.nan


def _likeliest(pings: FloatArray, parameters: AveragingParameters) -> tuple[float, float, int]:
    """Range, standard deviation, and most slips of the hypothesis under which sorted pings (P,) are most likely.

    Every ping is tried as the true range, and every widening of the known noise as the scatter.
    """
    best = (-np.inf, float(pings[0]), parameters.noise_m, 0)
    inside, outside = 1.0 - parameters.outlier_share, parameters.outlier_share / _ANYWHERE_M
    apart = pings[None, :] - pings[:, None]
    for steps, width in enumerate((parameters.noise_m * _WIDENINGS).tolist()):
        period = parameters.half_wavelength_m
        most = parameters.most_slips if period > 0.0 and width <= _NOISE_LIMIT * period else 0
        late = np.arange(most + 1)
        off = (apart[:, :, None] - late * period) / width
        density = np.exp(-0.5 * off * off) @ parameters.slip_share**late / (math.sqrt(2.0 * math.pi) * width)
        likelihood = np.log(inside * density + outside).sum(axis=1) - _WIDENING_COST * steps
        place = int(np.argmax(likelihood))
        if likelihood[place] > best[0]:
            best = (float(likelihood[place]), float(pings[place]), width, most)
    return best[1:]


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
