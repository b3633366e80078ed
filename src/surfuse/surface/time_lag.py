"""The time lag between ranges and poses: the shift of the poses under which the readings agree on one surface.

A range of time t belongs to the pose at t + lag. While the sensor moves, a wrong lag puts every hit point beside the
surface by speed times lag; the lag is where the scatter about the surface is least (maximum likelihood with Cauchy
errors). Its standard deviation is the cluster-robust one (Liang and Zeger, Biometrika 73 (1986) 13-22) over blocks of
time, so that errors that last longer than a reading do not make it too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import stdtrit

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.records import BoolArray, FloatArray, IntArray, Readings, Status
from surfuse.surface.casting import RayCaster
from surfuse.surface.local_planes import TUNING, fit_planes, tiles_of, without_planes

TILES = (1, 2, 4, 8)
BLOCKS = 20
LEAST_ECHOES = 30
STILL_M = 1e-6
DERIVATIVE_S = 1e-3
STEPS = 24
"""Intervals of the coarse search."""


@dataclass(frozen=True)
class Lag:
    """Lag in s with its 95 % interval, the scatter of the residuals before (lag 0) and after, and what it rests on.

    `surface` says what the residuals were taken against.

    `low_s` and `high_s` bound the interval of `lag_s`; `before_m` and `after_m` are robust standard deviations,
    `echoes` says on how many the lag rests.
    """

    lag_s: float
    low_s: float
    high_s: float
    before_m: float
    after_m: float
    echoes: int
    surface: str


@dataclass(frozen=True, eq=False)
class _Track:
    """Echoes whose time stays inside of the log under every lag tried, and the track of every sensor."""

    readings: Readings
    rows: BoolArray
    part_from_world: FloatArray

    @lru_cache(maxsize=64)  # noqa: B019 (a track lives as long as its search)
    def at(self, lag_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, axis and hit point (K, 3) of the echoes in the part frame, with the poses of t + lag."""
        place, axis = moved_poses(self.readings, lag_s)
        place, axis = place[self.rows], axis[self.rows]
        place, axis = transform_points(self.part_from_world, place), rotate_vectors(self.part_from_world, axis)
        return place, axis, place + self.readings.range_m[self.rows, None] * axis


def moved_poses(readings: Readings, lag_s: float) -> tuple[FloatArray, FloatArray]:
    """Positions and unit axes (N, 3) that the sensors had at t + lag: linear between their own poses in the log."""
    place, axis = readings.position_m.copy(), readings.axis.copy()
    for sensor in np.unique(readings.sensor):
        own = np.flatnonzero(readings.sensor == sensor)
        own = own[np.argsort(readings.t_s[own], kind="stable")]
        t_s = readings.t_s[own]
        for i in range(3):
            place[own, i] = np.interp(t_s + lag_s, t_s, readings.position_m[own, i])
            axis[own, i] = np.interp(t_s + lag_s, t_s, readings.axis[own, i])
    return place, axis / np.linalg.norm(axis, axis=1, keepdims=True)


def estimate_lag(
    readings: Readings,
    world_from_part: FloatArray,
    max_lag_s: float = 0.5,
    truth: tuple[FloatArray, IntArray] | None = None,
) -> Lag:
    """Lag of the poses against the ranges, from readings of moving sensors.

    The surface is the truth mesh (vertices (V, 3) in the world frame, faces (F, 3)) when it is given, else planes over
    1, 4, 16 or 64 tiles of the part frame, whichever number explains the readings best (Bayesian criterion).

    Raises
    ------
    DataError : the readings cannot determine the lag; the message says why.
    """
    _refuse_standing(readings)
    track = _track(readings, inverse(world_from_part), max_lag_s)
    if truth is not None:
        caster = RayCaster(transform_points(inverse(world_from_part), truth[0]), truth[1])
        return _searched(track, max_lag_s, _Mesh(track, caster), "the given mesh")
    found: list[tuple[float, int, Lag]] = []
    for tiles in TILES:
        surface = _Planes(track, tiles)
        if not surface.usable:
            break
        try:
            lag = _searched(track, max_lag_s, surface, "a plane" if tiles == 1 else f"{tiles * tiles} planes")
        except DataError:
            # A surface that is too simple, or takes up everything, may leave the lag open; another may not.
            continue
        penalty = 3.0 * tiles * tiles * float(np.log(lag.echoes))
        found.append((2.0 * lag.echoes * float(np.log(lag.after_m)) + penalty, tiles, lag))
    if not found:
        return _searched(track, max_lag_s, _Planes(track, 1), "a plane")
    return min(found)[2]


def _refuse_standing(readings: Readings) -> None:
    """Refuse sensors that stand still while they read: then no pose belongs to another time."""
    own = np.lexsort((readings.t_s, readings.sensor))
    same = np.diff(readings.sensor[own]) == 0
    moved = np.linalg.norm(np.diff(readings.position_m[own], axis=0), axis=1)
    moved += np.linalg.norm(np.diff(readings.axis[own], axis=0), axis=1)
    later = np.diff(readings.t_s[own]) > 0.0
    steps = moved[same & later]
    cure = "record ranges and poses while the sensor moves"
    if len(steps) == 0 or float(np.mean(steps < STILL_M)) > 0.5:
        raise DataError("the sensors stand still in most readings, so the log holds no time lag", cure=cure)
    # Sensors that fire one after the other from exactly one grip pose: the arm stopped for the sweep.
    first, last = readings.start[:-1], readings.start[1:] - 1
    staggered = np.flatnonzero(readings.t_s[last] > readings.t_s[first])
    if len(staggered) < 3:
        return
    grip_from_world = inverse(readings.world_from_grip[staggered])
    offset = (
        np.einsum("mij,mj->mi", grip_from_world[:, :3, :3], readings.position_m[last[staggered]])
        + grip_from_world[:, :3, 3]
    )
    names = readings.sensor[last[staggered]]
    spread = max(float(np.ptp(offset[names == name], axis=0).max()) for name in np.unique(names))
    if spread < STILL_M:
        raise DataError("the arm stood still for every sweep (start and stop), so the log holds no time lag", cure=cure)


def _track(readings: Readings, part_from_world: FloatArray, max_lag_s: float) -> _Track:
    low, high = np.full(len(readings.specs), np.inf), np.full(len(readings.specs), -np.inf)
    np.minimum.at(low, readings.sensor, readings.t_s)
    np.maximum.at(high, readings.sensor, readings.t_s)
    inside = (readings.t_s - max_lag_s >= low[readings.sensor]) & (readings.t_s + max_lag_s <= high[readings.sensor])
    rows = inside & (readings.status == int(Status.OK)) & np.isfinite(readings.range_m)
    if int(np.sum(rows)) < LEAST_ECHOES:
        raise DataError(
            f"{int(np.sum(rows))} echoes are more than {max_lag_s:g} s away from both ends of the log, "
            f"at least {LEAST_ECHOES} are needed",
            cure="record for longer, or search a smaller lag",
        )
    return _Track(readings, rows, part_from_world)


class _Surface(Protocol):
    """What the hit points are compared with."""

    def residual(self, lag_s: float, scale_m: float | None) -> tuple[FloatArray, FloatArray, float]:
        """Residuals and Cauchy weights (K,), and the standard deviation of the good ones."""

    def sensitivity(self, lag_s: float, weight: FloatArray) -> FloatArray:
        """Change of the residuals (K,) with the lag, m/s, less what a free surface would follow."""


class _Planes:
    """Residuals against planes that are fitted anew for every lag."""

    def __init__(self, track: _Track, tiles: int) -> None:
        self._track = track
        self._tile = tiles_of(track.at(0.0)[2], tiles)
        counts = np.bincount(self._tile)
        self.usable = int(counts[counts > 0].min()) >= LEAST_ECHOES or tiles == 1

    def residual(self, lag_s: float, scale_m: float | None) -> tuple[FloatArray, FloatArray, float]:
        """See `_Surface`."""
        fit = fit_planes(self._track.at(lag_s)[2], self._tile, scale_m)
        return fit.residual_m, fit.weight, fit.scale_m

    def sensitivity(self, lag_s: float, weight: FloatArray) -> FloatArray:
        """See `_Surface`."""
        ahead, behind = (self._track.at(lag_s + step)[2] for step in (DERIVATIVE_S, -DERIVATIVE_S))
        middle = self._track.at(lag_s)[2]
        slope = fit_planes(middle, self._tile).slope
        moved = (ahead - behind) / (2.0 * DERIVATIVE_S)
        # Moving along the surface changes nothing, and what the planes can follow is no sign of a lag.
        return without_planes(moved[:, 2] - np.sum(slope * moved[:, :2], axis=1), middle, weight, self._tile)


class _Mesh:
    """Residuals of ranges against a given mesh, less one offset that all ranges share."""

    def __init__(self, track: _Track, caster: RayCaster) -> None:
        self._track, self._caster = track, caster

    def residual(self, lag_s: float, scale_m: float | None) -> tuple[FloatArray, FloatArray, float]:
        """See `_Surface`."""
        error = self._error(lag_s)
        known = np.isfinite(error)
        if int(known.sum()) < LEAST_ECHOES:
            raise DataError(f"{int(known.sum())} echoes point at the mesh", cure="check the frame of the mesh")
        error = error - float(np.median(error[known]))
        spread = 1.4826 * float(np.median(np.abs(error[known]))) if scale_m is None else scale_m
        width = TUNING * max(spread, 1e-9)
        weight = np.where(known, 1.0 / (1.0 + (error / width) ** 2), 0.0)
        # An echo that points past the mesh says nothing at this lag; it must not pay for going there either.
        return np.where(known, error, 3.0 * width), weight, width / TUNING

    def sensitivity(self, lag_s: float, weight: FloatArray) -> FloatArray:
        """See `_Surface`."""
        rate = (self._error(lag_s + DERIVATIVE_S) - self._error(lag_s - DERIVATIVE_S)) / (2.0 * DERIVATIVE_S)
        rate = np.where(np.isfinite(rate), rate, 0.0)
        return rate - float(np.sum(weight * rate) / max(float(np.sum(weight)), 1e-300))

    def _error(self, lag_s: float) -> FloatArray:
        place, axis, _ = self._track.at(lag_s)
        predicted = self._caster.ranges(place, axis)
        with np.errstate(invalid="ignore"):
            error = self._track.readings.range_m[self._track.rows] - predicted
        return np.where(np.isfinite(error), error, np.nan)


def _searched(track: _Track, max_lag_s: float, surface: _Surface, name: str) -> Lag:
    """The lag of least scatter, with its interval.

    Raises
    ------
    DataError : no minimum inside of the search, or an interval as wide as the search.
    """
    lags = np.linspace(-max_lag_s, max_lag_s, STEPS + 1)
    scales = [surface.residual(float(lag), None)[2] for lag in lags]
    best = int(np.argmin(scales))
    cure = "record faster and more varied motion, or search with another --max-lag"
    if best in (0, STEPS):
        raise DataError(f"the scatter is least at the end of the search, {1e3 * lags[best]:+.0f} ms", cure=cure)
    scale = scales[best]

    def cost(lag_s: float) -> float:
        residual = surface.residual(lag_s, scale)[0]
        return float(np.sum(np.log1p((residual / (TUNING * max(scale, 1e-9))) ** 2)))

    found = minimize_scalar(cost, bounds=(lags[best - 1], lags[best + 1]), method="bounded", options={"xatol": 1e-5})
    lag = float(found.x)
    half = _half_interval(track, surface, lag, scale)
    if not half < 0.5 * max_lag_s:
        raise DataError(
            f"the lag is {1e3 * lag:+.0f} ms with a 95 % interval of +-{1e3 * half:.0f} ms: the motion says too little",
            cure=cure,
        )
    before, after = (surface.residual(at, None)[2] for at in (0.0, lag))
    return Lag(lag, lag - half, lag + half, before, after, int(np.sum(track.rows)), name)


def _half_interval(track: _Track, surface: _Surface, lag_s: float, scale_m: float) -> float:
    """Half the 95 % interval: cluster-robust over blocks of time, Student's t with one less degree than blocks."""
    residual, weight, _ = surface.residual(lag_s, scale_m)
    slope = surface.sensitivity(lag_s, weight)
    time = track.readings.t_s[track.rows]
    block = np.minimum((BLOCKS * (time - time.min()) / max(float(np.ptp(time)), 1e-9)).astype(np.int64), BLOCKS - 1)
    information = float(np.sum(weight * slope**2))
    if not information > 0.0:
        return float("inf")
    score = np.bincount(block, weights=weight * slope * residual, minlength=BLOCKS)
    used = int(np.count_nonzero(np.bincount(block, minlength=BLOCKS)))
    if used < 3:
        return float("inf")
    variance = float(np.sum(score**2)) / information**2 * used / (used - 1)
    return float(stdtrit(used - 1, 0.975)) * float(np.sqrt(variance))
