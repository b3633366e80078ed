"""The Kalman filter of a plane that is carried along a scan line: predict, judge, update, start afresh.

State x = (h, a, b): height of the surface at a point of the part frame, and its slopes along u and v. References in
`surfuse.fusion.kalman_line`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray

UNKNOWN_M2 = 1.0
"""Variance of a height before its first reading: (1 m)^2, a million times that of any reading."""


class Memory(NamedTuple):
    """What a filter over one scan line remembers, moved on in place.

    `state` (3,) is the height (m) of the plane and its slopes along u and v, `covariance` (3, 3) theirs, `at_m` (2,)
    the place (u, v) where they hold. `scatter` (1,) is the variance (m^2) of the readings about the plane, `held` (1,)
    says whether there is a plane, `row` (1,) on which scan line.
    """

    state: FloatArray
    covariance: FloatArray
    at_m: FloatArray
    scatter: FloatArray
    held: IntArray
    row: IntArray


@compiled
def move(memory: Memory, u: float, v: float, bend: float) -> None:
    """Carry the state to another point of the part: x <- F x, P <- F P F^T + Q."""
    x, p = memory.state, memory.covariance
    du, dv = u - memory.at_m[0], v - memory.at_m[1]
    step = np.array([[1.0, du, dv], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    x[0] += du * x[1] + dv * x[2]
    p[:, :] = step @ p @ step.T
    ds = math.sqrt(du * du + dv * dv)
    q = bend * bend * ds
    p[0, 0] += q * ds * ds / 3.0
    p[0, 1] += 0.5 * q * du
    p[1, 0] += 0.5 * q * du
    p[0, 2] += 0.5 * q * dv
    p[2, 0] += 0.5 * q * dv
    p[1, 1] += q
    p[2, 2] += q
    memory.at_m[0], memory.at_m[1] = u, v


@compiled
def begin(memory: Memory, height: float, u: float, v: float, slope_sigma: float) -> None:
    """Start at a level of unknown height and slope."""
    memory.state[:] = 0.0
    memory.state[0] = height
    memory.covariance[:, :] = 0.0
    memory.covariance[0, 0] = UNKNOWN_M2
    memory.covariance[1, 1] = memory.covariance[2, 2] = slope_sigma * slope_sigma
    memory.at_m[0], memory.at_m[1] = u, v


@compiled
def judge(memory: Memory, hits: FloatArray, n: int, sigmas: float, fresh: bool, judged: FloatArray) -> int:
    """Innovation, its variance without the reading's, and 1.0 or 0.0 within the gate: rows of `judged`; how many are.

    A level that has just begun was put at the median of the sweep: its height is not counted as unknown then.

    `hits` (n or more, 5) are rows (u, v, w, variance, on the part), in m and m^2; `judged` (n or more, 3) is written.
    """
    x, p, within = memory.state, memory.covariance, 0
    for k in range(n):
        du, dv = hits[k, 0] - memory.at_m[0], hits[k, 1] - memory.at_m[1]
        predicted = p[0, 0] + du * du * p[1, 1] + dv * dv * p[2, 2]
        predicted += 2.0 * (du * p[0, 1] + dv * p[0, 2] + du * dv * p[1, 2])
        if fresh:
            predicted -= UNKNOWN_M2
        innovation = hits[k, 2] - (x[0] + du * x[1] + dv * x[2])
        judged[k, 0], judged[k, 1] = innovation, predicted
        allowed = sigmas * sigmas * (predicted + hits[k, 3] + memory.scatter[0])
        judged[k, 2] = 1.0 if innovation * innovation <= allowed else 0.0
        within += int(judged[k, 2])
    return within


@compiled
def update(memory: Memory, u: float, v: float, w: float, variance: float) -> None:
    """Take in one height: gain, state, covariance in Joseph's form."""
    x, p = memory.state, memory.covariance
    h = np.array([1.0, u - memory.at_m[0], v - memory.at_m[1]])
    ph = p @ h
    gain = ph / (h @ ph + variance)
    x += gain * (w - h @ x)
    keep = np.eye(3) - np.outer(gain, h)
    p[:, :] = keep @ p @ keep.T + variance * np.outer(gain, gain)
