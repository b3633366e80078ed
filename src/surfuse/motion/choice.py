"""Choosing among inverse solutions: the nearest one, and the nearest turn of every joint."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray


@compiled
def nearest_turn(angle: float, current: float, lower: float, upper: float) -> float:
    """The angle plus whole turns that lies within its limits and nearest to the current one; nan if none does."""
    turn = 2.0 * math.pi
    first = math.ceil((lower - angle) / turn - 1e-12)
    last = math.floor((upper - angle) / turn + 1e-12)
    if not first <= last:
        return math.nan
    wanted = math.floor((current - angle) / turn + 0.5)
    return angle + turn * min(max(wanted, first), last)


@compiled
def _nearest(
    solutions: FloatArray,
    valid: BoolArray,
    current: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    weights: FloatArray,
) -> tuple[FloatArray, IntArray]:
    n, count, joints = solutions.shape
    chosen = np.full((n, joints), np.nan)
    index = np.full(n, -1, dtype=np.int64)
    candidate = np.empty(joints)
    for i in range(n):
        best = np.inf
        for k in range(count):
            if not valid[i, k]:
                continue
            cost = 0.0
            for j in range(joints):
                candidate[j] = nearest_turn(solutions[i, k, j], current[i, j], lower[j], upper[j])
                cost += (weights[j] * (candidate[j] - current[i, j])) ** 2
            if cost < best:
                best = cost
                index[i] = k
                chosen[i] = candidate
    return chosen, index


def nearest_configuration(
    solutions_rad: FloatArray,
    valid: BoolArray,
    current_rad: FloatArray,
    lower_rad: FloatArray,
    upper_rad: FloatArray,
    weights: npt.ArrayLike = 1.0,
) -> tuple[FloatArray, IntArray]:
    """The valid solution nearest to the current joints: (N, J), and its index (N,); nan and -1 where there is none.

    `solutions_rad` (N, K, J), `valid` (N, K), `current_rad` (J,) or (N, J). Distance is the weighted Euclidean one,
    over the turn of every joint that is nearest within its limits: 350 degrees may be 10 degrees away.

    `lower_rad` and `upper_rad` (J,) are the limits of the turns, `weights` (J,) or one number for all joints.

    Raises
    ------
    DataError : the current joints are not finite.
    """
    n, _, joints = solutions_rad.shape
    current = np.ascontiguousarray(np.broadcast_to(np.asarray(current_rad, dtype=np.float64), (n, joints)))
    if not np.all(np.isfinite(current)):
        raise DataError("the current joint positions are not finite", cure="read the arm's state first")
    weight = np.ascontiguousarray(np.broadcast_to(np.asarray(weights, dtype=np.float64), (joints,)))
    return _nearest(np.ascontiguousarray(solutions_rad), valid, current, lower_rad, upper_rad, weight)


@compiled
def _follow(path: FloatArray, start: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    n, joints = path.shape
    unwrapped = np.empty((n, joints))
    last = start.copy()
    for i in range(n):
        for j in range(joints):
            unwrapped[i, j] = nearest_turn(path[i, j], last[j], lower[j], upper[j])
            if not math.isnan(unwrapped[i, j]):
                last[j] = unwrapped[i, j]
    return unwrapped


def follow(path_rad: FloatArray, start_rad: FloatArray, lower_rad: FloatArray, upper_rad: FloatArray) -> FloatArray:
    """Joints (N, J) along a path in one configuration, every angle on the turn nearest to the stop before it.

    Rows with nan stay nan and are passed over. `path_rad` (N, J), `start_rad` (J,) where the arm comes from,
    `lower_rad` and `upper_rad` (J,) the limits of the turns.
    """
    start = np.ascontiguousarray(start_rad, dtype=np.float64)
    return _follow(np.ascontiguousarray(path_rad, dtype=np.float64), start, lower_rad, upper_rad)
