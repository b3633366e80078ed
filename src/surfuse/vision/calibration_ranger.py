"""Where the shoulder ranger sits, from its ranges to one fixed board while joint 1 turns."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from surfuse.errors import DataError
from surfuse.records import BoolArray, FloatArray

_COMMON_SHARE = 0.005
_AGREE_M = 0.005
_PAIR_TURN_MIN_RAD = math.radians(2.0)


@dataclass(frozen=True)
class ShoulderRanger:
    """Place of the ranger in the shoulder frame: x and y (2,) with standard deviations (2,), and the fit's rms, m.

    `forward_left_m` and `sigma_m` (2,) along the shoulder's x and y; `rms_m` is over all `ranges`.
    """

    forward_left_m: FloatArray
    sigma_m: FloatArray
    rms_m: float
    ranges: int


def calibrate_shoulder_ranger(
    world_from_target: FloatArray, joint1_rad: FloatArray, range_m: FloatArray, height_m: float
) -> ShoulderRanger:
    """Place of an ultrasonic ranger from its ranges (N,) to the target's plane at joint angles (N,).

    A wide beam hears a plane at its perpendicular distance, so each range is linear in the ranger's place. Its height
    hardly matters to an upright plane and must be given. Ranges that are not finite are left out, and those that
    contradict most others (an echo of something else), too. The standard deviations count what all ranges have in
    common, which their scatter cannot show: half a percent of the range, as of air that is 3 K warmer than believed.

    Raises
    ------
    DataError : fewer than 4 usable ranges, or no turn between them.
    """
    heard = np.isfinite(range_m)
    normal = world_from_target[:3, 2]
    # z of the target points into the board, away from the ranger.
    ahead = float(normal @ world_from_target[:3, 3])
    cosine, sine = np.cos(joint1_rad), np.sin(joint1_rad)
    rows = -np.column_stack([normal[0] * cosine + normal[1] * sine, normal[1] * cosine - normal[0] * sine])
    wanted = range_m - ahead + normal[2] * height_m
    if np.count_nonzero(heard) < 4 or np.ptp(joint1_rad[heard]) < math.radians(5.0):
        raise DataError(
            f"{np.count_nonzero(heard)} usable ranges to the target: too few, or from too small a turn",
            cure="range the target, facing it, from at least 4 joint angles over 5 degrees or more",
        )
    heard &= _agreeing(rows, wanted, heard)
    place, _, _, _ = np.linalg.lstsq(rows[heard], wanted[heard], rcond=None)
    miss = wanted - rows @ place
    used = miss[heard]
    variance = float(used @ used) / max(len(used) - 2, 1)
    scatter = variance * np.diag(np.linalg.inv(rows[heard].T @ rows[heard]))
    common, _, _, _ = np.linalg.lstsq(rows[heard], _COMMON_SHARE * range_m[heard], rcond=None)
    sigma = np.sqrt(scatter + common**2)
    return ShoulderRanger(np.asarray(place), sigma, float(np.sqrt(np.mean(used**2))), len(used))


def _agreeing(rows: FloatArray, wanted: FloatArray, heard: BoolArray) -> BoolArray:
    """The ranges (N,) near the place that most agree on: of those that two ranges give, with the least median miss.

    P. J. Rousseeuw, Least median of squares regression, Journal of the American Statistical Association 79, 1984.
    """
    best, median = np.full(len(wanted), np.nan), math.inf
    for pair in itertools.combinations(np.flatnonzero(heard).tolist(), 2):
        chosen = list(pair)
        if abs(np.linalg.det(rows[chosen])) > math.sin(_PAIR_TURN_MIN_RAD):
            miss = np.abs(wanted - rows @ np.linalg.solve(rows[chosen], wanted[chosen]))
            if float(np.median(miss[heard])) < median:
                best, median = miss, float(np.median(miss[heard]))
    with np.errstate(invalid="ignore"):
        return np.asarray(best <= max(4.0 * 1.4826 * median, _AGREE_M))
