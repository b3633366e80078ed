"""What readings of known surfaces tell about their sensors: offset, scale, sigma, capture angle, late bias by tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.records import BoolArray, FloatArray, IntArray
from surfuse.surface.beam_fan import RINGS_DEG, BeamView

FACING_RAD = float(np.radians(3.0))
STEP_FACING_RAD = float(np.radians(7.0))
LEAST = 20
LEAST_STEP_M = 0.02
SCALE_SIGMA = 0.003
"""A scale with a larger standard deviation is no calibration: 1.3 mm at 43 cm."""
BAND_DEG = 5.0
GROSS_M = 0.05


@dataclass(frozen=True)
class Facing:
    """Range = offset + scale x distance: offsets (S,) in m (nan: that sensor has too few), scale, sigma.

    `scale_sigma` is the standard deviation of the scale; `scale` is nan when the distances do not determine it.

    `offset_sigma_m` (S,) are the standard deviations of the offsets, `sigma_m` is that of one echo, `echoes` the number
    of those that count.
    """

    offset_m: FloatArray
    offset_sigma_m: FloatArray
    scale: float
    scale_sigma: float
    sigma_m: float
    echoes: int


@dataclass(frozen=True)
class Late:
    """Corrected ranges minus axis ranges by tilt: middle of each band (K,) in rad, bias and scatter in m, echoes.

    The bias is their location under the heavy-tailed errors that the beam-aware fusion reckons with.

    All (K,): `bias_m` and `scatter_m` in m, `echoes` in each band.
    """

    tilt_rad: FloatArray
    bias_m: FloatArray
    scatter_m: FloatArray
    echoes: IntArray


@dataclass(frozen=True)
class Capture:
    """Half the angle within which a nearer surface is heard, its interval (rad), and the readings that say so.

    `low_rad` and `high_rad` bound the interval of `angle_rad`; `echoes` are readings beside a step.
    """

    angle_rad: float
    low_rad: float
    high_rad: float
    echoes: int


def fit_facing(seen: BeamView, range_m: FloatArray, sensor: IntArray, sensors: int) -> Facing:
    """Offset of each sensor, common scale and sigma, from echoes of flat surfaces within 3 degrees of facing.

    `range_m` and `sensor` (N,) go with the N beams of `seen`; there are S sensors.

    Raises
    ------
    DataError : fewer than 20 such echoes.
    """
    use = seen.flat & (seen.incidence_rad <= FACING_RAD) & np.isfinite(range_m)
    # To a facing plane the echo takes the perpendicular, not the axis.
    distance = seen.axis_range_m * np.cos(seen.incidence_rad)
    use &= np.abs(np.where(use, range_m - distance, np.inf)) < GROSS_M
    if int(use.sum()) < LEAST:
        raise DataError(
            f"{int(use.sum())} echoes of a facing plate (at least {LEAST} are needed), so offset and sigma stay open",
            cure="add a log of a plate that faces the sensors, with its mesh",
        )
    d, r, s = distance[use], range_m[use], sensor[use]
    centre = float(np.mean(d))
    design = np.column_stack([s == k for k in range(sensors)] + [d - centre]).astype(np.float64)
    solution, weight, sigma = _robust(design, r - d)
    known = np.linalg.pinv(design.T @ (weight[:, None] * design))
    slope_sigma = sigma * float(np.sqrt(known[-1, -1])) if np.ptp(d) > 1e-6 else float("inf")
    free = slope_sigma <= SCALE_SIGMA
    if not free:
        solution, weight, sigma = _robust(design[:, :-1], r - d)
        known = np.linalg.pinv(design[:, :-1].T @ (weight[:, None] * design[:, :-1]))
    scale = 1.0 + float(solution[-1]) if free else float("nan")
    counts = np.bincount(s, minlength=sensors)
    at_zero = solution[:sensors] - (scale - 1.0) * centre if free else solution[:sensors]
    return Facing(
        offset_m=np.where(counts >= LEAST, at_zero, np.nan),
        offset_sigma_m=sigma * np.sqrt(np.diag(known)[:sensors]),
        scale=scale,
        scale_sigma=slope_sigma,
        sigma_m=sigma,
        echoes=len(d),
    )


def fit_late(seen: BeamView, corrected_m: FloatArray) -> Late:
    """Bias and scatter of ranges about the axis range of flat surfaces, in bands of 5 degrees of tilt.

    `corrected_m` (N,) are ranges in m without offset and scale, one for each beam of `seen`.

    Raises
    ------
    DataError : no band beyond the facing one has 20 echoes.
    """
    use = seen.flat & np.isfinite(corrected_m)
    error = corrected_m - seen.axis_range_m
    # Bands lie around 0, 5, 10, ... degrees, so that a plate at such a tilt falls into one of them.
    band = np.floor(np.degrees(np.where(use, seen.incidence_rad, 0.0)) / BAND_DEG + 0.5).astype(np.int64)
    tilt, bias, scatter, echoes = [], [], [], []
    for k in range(int(90.0 / BAND_DEG)):
        rows = use & (band == k) & (np.abs(np.where(use, error, np.inf)) < GROSS_M)
        here = error[rows]
        if len(here) >= LEAST:
            middle, spread = _location(here)
            tilt.append(float(np.median(seen.incidence_rad[use & (band == k)])))
            bias.append(middle)
            scatter.append(spread)
            echoes.append(len(here))
    if not any(angle > np.radians(BAND_DEG) for angle in tilt):
        raise DataError(
            f"no {LEAST} echoes of a plate tilted by over {BAND_DEG:g} degrees, so late bias and scatter stay open",
            cure="add a log of a tilted plate, with its mesh",
        )
    return Late(np.array(tilt), np.array(bias), np.array(scatter), np.array(echoes, dtype=np.int64))


def fit_capture(seen: BeamView, corrected_m: FloatArray) -> Capture:
    """The angle off the axis within which a nearer surface is heard instead of the one on the axis.

    Every reading beside a step knows the angle under which the nearer surface begins, and heard it or did not: the
    angle that contradicts the fewest readings. The interval holds all angles that contradict at most two more.

    `corrected_m` (N,) are ranges in m without offset and scale, one for each beam of `seen`.

    Raises
    ------
    DataError : fewer than 20 readings beside a step, or they all heard the same side.
    """
    beside = np.isfinite(corrected_m) & np.isfinite(seen.axis_range_m) & (seen.incidence_rad <= STEP_FACING_RAD)
    far = np.where(beside, seen.axis_range_m, 0.0)
    drop = far[:, None] - np.where(beside[:, None], seen.nearest_m, 0.0)
    deepest = drop.max(axis=1)
    rows = np.flatnonzero(deepest > LEAST_STEP_M)
    # The wall of a step lies between its two surfaces; the nearer one begins where most of the drop is done.
    begins = np.radians(RINGS_DEG[np.argmax(drop[rows] > 0.75 * deepest[rows, None], axis=1)])
    short = far[rows] - corrected_m[rows]
    heard_near = short > 0.5 * deepest[rows]
    fits = (np.abs(short) < LEAST_STEP_M) | (heard_near & (short < deepest[rows] + LEAST_STEP_M))
    return _threshold(begins[fits], heard_near[fits])


def _threshold(begins_rad: FloatArray, heard: BoolArray) -> Capture:
    if len(heard) < LEAST or not (np.any(heard) and np.any(~heard)):
        why = f"{len(heard)} readings beside a step" + (", all of which heard the same side" if len(heard) else "")
        raise DataError(
            f"{why} (at least {LEAST} of both sides are needed), so the capture angle stays open",
            cure="add a log of a facing step of more than 2 cm, with its mesh",
        )
    angles = np.radians(np.concatenate([[0.0], RINGS_DEG]) + 0.25)
    wrong = np.array([np.sum(heard != (begins_rad <= angle)) for angle in angles])
    good = angles[wrong <= wrong.min() + 2]
    return Capture(float(np.mean(angles[wrong == wrong.min()])), float(good[0]), float(good[-1]), len(heard))


def _location(values: FloatArray) -> tuple[float, float]:
    """Location under Student's t with four degrees of freedom, and scatter (from the median absolute deviation)."""
    centre = float(np.median(values))
    scatter = max(1.4826 * float(np.median(np.abs(values - centre))), 1e-9)
    for _ in range(20):
        weight = 1.0 / (1.0 + ((values - centre) / (1.5 * scatter)) ** 2 / 4.0)
        centre = float(np.sum(weight * values) / np.sum(weight))
    return centre, scatter


def _robust(design: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Solution, Tukey weights (tuning 4.685 sigma) and sigma of a linear fit with outliers."""
    weight: FloatArray = np.ones(len(values))
    sigma = 0.0
    solution: FloatArray = np.zeros(design.shape[1])
    for k in range(20):
        residual = values - design @ solution if k else values - np.median(values)
        sigma = max(1.4826 * float(np.median(np.abs(residual - np.median(residual)))), 1e-9)
        weight = np.clip(1.0 - (residual / (4.685 * sigma)) ** 2, 0.0, None) ** 2 if k else weight
        root = np.sqrt(weight)
        solution = np.asarray(np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0], dtype=np.float64)
    return solution, weight, sigma
