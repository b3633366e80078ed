"""A Kalman filter along each scan line: a plane that moves with the array, and may bend from stop to stop.

State x = (h, a, b): height of the surface at a point of the part frame and its slopes along u and v. Between stops the
point moves to where the array now looks, x <- F x, and the slopes walk at random with the distance travelled (the
integrated Wiener process of target tracking: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation (2001), section 6.2). Each reading is a height at its own axis, so a tilt is told from a change of depth. A
reading whose axis misses the outline is heard from the rim and late: its variance grows by allowed_m^2. Readings beyond
a gate take no part (ibid., section 5.4); when most of a sweep is beyond it, the filter starts afresh, as the paper's
prediction window does (section 3.2). Kalman, J. Basic Eng. 82 (1960) 35-45; adaptation of the noise to the innovations
after Mehra, IEEE Trans. Autom. Control 17 (1972) 693-698.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.agreement import median_of_sorted
from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.confidence.parameters import check_within
from surfuse.fusing.plane_filter import Memory, begin, judge, move, update
from surfuse.fusing.sweepwise import SweepwiseFusion
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, Gap, IntArray
from surfuse.records.kernel_columns import PointColumns, ScanColumns

SUMMARY = "Kalman filter along each scan line: depth and slopes, gated, started afresh at a step"
NO_CONFIDENCE = int(Gap.NO_CONFIDENCE)

RIM_M = 1e-6
"""A hit on the outline is on the part, whatever the rounding."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the filter.

    slope_sigma : standard deviation of a slope before the first sweep. Default 0.47, the tangent of the largest usable
        incidence, 25 degrees. No unit.
    bend_per_root_m : standard deviation of the change of slope over 1 m of travel (it grows with the root of the
        distance). Default 0.5: over a step of 1 cm the slope changes by 0.05, as on a radius of 20 cm. Unit m^(-1/2).
    gate_sigmas : how many standard deviations a reading may lie from the prediction. Default 3.
    scatter_memory : number of sweeps over which the scatter of the readings beyond their own sigma is remembered; 0:
        their own sigma is believed. Default 10.
    allowed_m : the largest deviation that counts as scatter, and how late a rim may be heard. Default 15 mm, the late
        scatter of tilted matte parts.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    slope_sigma: float = 0.47
    bend_per_root_m: float = 0.5
    gate_sigmas: float = 3.0
    scatter_memory: float = 10.0
    allowed_m: float = 0.015

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("slope_sigma", "gate_sigmas", "allowed_m"):
            check_within("kalman_line", name, getattr(self, name), 0.0, float("inf"), above=True)
        check_within("kalman_line", "bend_per_root_m", self.bend_per_root_m, 0.0, float("inf"))
        check_within("kalman_line", "scatter_memory", self.scatter_memory, 0.0, float("inf"))


class _Constants(NamedTuple):
    """`Parameters` as the kernel takes them."""

    slope_sigma: float
    bend_per_root_m: float
    gate_sigmas: float
    scatter_memory: float
    allowed_m: float


def _fresh(sensors: int) -> Memory:
    integer = np.zeros(1, dtype=np.int64)
    return Memory(np.zeros(3), np.zeros((3, 3)), np.zeros(2), np.zeros(1), integer, integer.copy())


@compiled
def hits_of(
    scan: ScanColumns, limits: Limits, j: int, gate: IntArray, inside_m: FloatArray, late_m: float, hits: FloatArray
) -> int:
    """Own-axis hit points of the validated readings of stop j: rows (u, v, w, variance, 1 on the part) of `hits`.

    `inside_m` counts from the first reading of the stop. Returns how many they are.

    `hits` (n, 5) has room for all readings of a stop; u, v, w in m in the part frame, the variance in m^2. `gate` (N,)
    is that of all readings. A reading beside the part has its variance enlarged by `late_m` squared: it may be late.
    """
    part, first, n = limits.part_from_world, scan.start[j], 0
    for i in range(first, scan.start[j + 1]):
        if gate[i] != 0:
            continue
        r = scan.range_m[i]
        x = scan.position_m[i, 0] + r * scan.axis[i, 0]
        y = scan.position_m[i, 1] + r * scan.axis[i, 1]
        z = scan.position_m[i, 2] + r * scan.axis[i, 2]
        for d in range(3):
            hits[n, d] = part[d, 0] * x + part[d, 1] * y + part[d, 2] * z + part[d, 3]
        own = scan.sigma_m[i]
        sigma = own if 0.0 < own < np.inf else limits.sigma_m[scan.sensor[i]]
        slant = part[2, 0] * scan.axis[i, 0] + part[2, 1] * scan.axis[i, 1] + part[2, 2] * scan.axis[i, 2]
        hits[n, 4] = 1.0 if inside_m[i - first] >= -RIM_M else 0.0
        hits[n, 3] = (sigma / max(abs(slant), 0.1)) ** 2 + (1.0 - hits[n, 4]) * late_m * late_m
        n += 1
    return n


@compiled
def level(hits: FloatArray, n: int, ordered: FloatArray) -> float:
    """Median height of the hits on the part, or of all when none is.

    `hits` (n or more, 5) as in `hits_of`, of which the first `n` count; in m along w. `ordered` is room for n values.
    """
    count = 0
    for k in range(n):
        if hits[k, 4] > 0.0:
            ordered[count] = hits[k, 2]
            count += 1
    if count == 0:
        ordered[:n] = hits[:n, 2]
        count = n
    ordered[:count] = np.sort(ordered[:count])
    return median_of_sorted(ordered, count)


@compiled
def on_grip_axis(scan: ScanColumns, limits: Limits, j: int, memory: Memory) -> tuple[float, float]:
    """Where the grip axis of stop j meets the plane, as a range along it, and its standard deviation."""
    part, grip, x, p = limits.part_from_world, scan.world_from_grip, memory.state, memory.covariance
    o, g = np.empty(3), np.empty(3)
    for d in range(3):
        o[d] = part[d, 3]
        g[d] = 0.0
        for e in range(3):
            o[d] += part[d, e] * grip[j, e, 3]
            g[d] += part[d, e] * grip[j, e, 2]
    slant = x[1] * g[0] + x[2] * g[1] - g[2]
    if slant < 0.05:
        return np.nan, np.nan
    over = o[2] - (x[0] + x[1] * (o[0] - memory.at_m[0]) + x[2] * (o[1] - memory.at_m[1]))
    depth = over / slant
    h = np.array([1.0, o[0] + depth * g[0] - memory.at_m[0], o[1] + depth * g[1] - memory.at_m[1]])
    return depth, math.sqrt(h @ (p @ h)) / slant


@compiled
def _sweep(
    memory: Memory, constants: _Constants, hits: FloatArray, n: int, judged: FloatArray, ordered: FloatArray
) -> tuple[int, bool]:
    """Predict, gate, start afresh where the surface has changed, update; returns how many took part, and whether."""
    u, v = hits[:n, 0].mean(), hits[:n, 1].mean()
    within, fresh = 0, memory.held[0] == 0
    changed = False
    if not fresh:
        move(memory, u, v, constants.bend_per_root_m)
        within = judge(memory, hits, n, constants.gate_sigmas, False, judged)
        changed = 2 * within < n
    if fresh or changed:
        begin(memory, level(hits, n, ordered), u, v, constants.slope_sigma)
        within = judge(memory, hits, n, constants.gate_sigmas, True, judged)
    memory.held[0] = 1
    scatter = memory.scatter[0]
    for k in range(n):
        excess = judged[k, 0] ** 2 - judged[k, 1] - hits[k, 3]
        ordered[k] = min(max(excess, 0.0), constants.allowed_m**2)
        if within == 0:
            # Two that contradict each other: neither is believed more.
            judged[k, 2] = 1.0
            hits[k, 3] += judged[k, 0] ** 2
        if judged[k, 2] > 0.0:
            update(memory, hits[k, 0], hits[k, 1], hits[k, 2], hits[k, 3] + scatter)
    if constants.scatter_memory > 0.0:
        # The median of the sweep: one wild reading is no scatter.
        ordered[:n] = np.sort(ordered[:n])
        memory.scatter[0] += (median_of_sorted(ordered, n) - scatter) / max(constants.scatter_memory, 1.0)
    return (n if within == 0 else within), changed


@compiled
def _walk(scan: ScanColumns, limits: Limits, constants: _Constants, memory: Memory, out: PointColumns) -> None:
    start, rows, gate, dc, dc1, dc2, dc3 = scan.start, scan.row, out.gate, out.dc, out.dc1, out.dc2, out.dc3
    most = 1
    for j in range(rows.shape[0]):
        most = max(most, start[j + 1] - start[j])
    value, sigma, inside, ordered = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    hits, judged = np.empty((most, 5)), np.empty((most, 3))
    for j in range(rows.shape[0]):
        first, last = start[j], start[j + 1]
        validate(scan, limits, (j, j + 1), gate, value, sigma, inside)
        for i in range(first, last):
            dc[i] = 0.0
            dc1[i] = dc2[i] = dc3[i] = 1.0 if gate[i] == 0 else np.nan
        out.depth_m[j], out.sigma_m[j], out.gap[j], out.reset[j] = np.nan, np.nan, 0, False
        if rows[j] != memory.row[0]:
            memory.row[0], memory.held[0], memory.scatter[0] = rows[j], 0, 0.0
        n = hits_of(scan, limits, j, gate, inside, constants.allowed_m, hits)
        if n == 0:
            out.gap[j] = gap_reason(gate, first, last)
            continue
        _, out.reset[j] = _sweep(memory, constants, hits, n, judged, ordered)
        depth, spread = on_grip_axis(scan, limits, j, memory)
        if not (math.isfinite(depth) and depth > 0.0 and spread > 0.0):
            out.gap[j] = NO_CONFIDENCE
            continue
        out.depth_m[j], out.sigma_m[j] = depth, spread
        k = 0
        for i in range(first, last):
            if gate[i] == 0:
                dc[i] = dc1[i] = judged[k, 2]
                k += 1


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    constants = _Constants(*(getattr(parameters, name) for name in _Constants._fields))

    def walk(scan: ScanColumns, limits: Limits, memory: Memory, out: PointColumns) -> None:
        _walk(scan, limits, constants, memory, out)

    return SweepwiseFusion("kalman_line", parameters, _fresh, walk)
