"""Fusion methods without a kernel: a plain function of the validated readings of one sweep.

The function gets the readings along axis 0, as ranges along the grip axis with their standard deviations, and reduces
that axis. It is called with (k,) -> () in mind, and given (k, G): all stops with k valid readings at once, so that a
scan costs a few calls. A stop is never alone in a call (G >= 2), because NumPy adds up a single column in another order
than many; so live and replayed fusion agree to the last bit for every function that treats its columns alike.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.errors import DataError
from surfuse.fusing.sweepwise import BLOCK, LEAST_PIECE, SweepwiseFusion, block_readings
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, Gap, IntArray
from surfuse.records.kernel_columns import PointColumns, ScanColumns

CALL = 8192
"""Stops whose readings are brought together for a call."""

NO_CONFIDENCE = int(Gap.NO_CONFIDENCE)


class Fused(NamedTuple):
    """What a function makes of (k, G) readings: depth and standard deviation (G,) in m, and the weights if it has any.

    A depth that is not finite is a gap. `weight` (k, G) in [0, 1] becomes the degree of confidence of the readings;
    without it each has 1.
    """

    depth_m: FloatArray
    sigma_m: FloatArray
    weight: FloatArray | None = None


Fuse = Callable[[FloatArray, FloatArray], Fused]


def per_stop(name: str, gates: GateParameters, fuse: Fuse) -> FusionMethod:
    """The method that fuses every stop by `fuse(value_m, sigma_m)`, given readings along axis 0.

    `fuse` gets ranges and sigmas (k, G) in m, see the module, and makes a `Fused` of them. It may run in several
    threads at once. Errors in what it returns are reported with the name of the method when it runs.
    """

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        calls = [(first, min(first + CALL, len(scan.row))) for first in range(0, len(scan.row), CALL)]

        def run(stops: tuple[int, int]) -> None:
            _fuse_stops(name, fuse, scan, limits, stops, out)

        if len(scan.row) < 2 * LEAST_PIECE:
            for stops in calls:
                run(stops)
            return
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            list(pool.map(run, calls))

    return SweepwiseFusion(name, gates, fresh, walk)


def one_by_one(fuse: Callable[[FloatArray, FloatArray], tuple[float, float]]) -> Fuse:
    """A function of the k readings of one sweep, that cannot take more at once, as one that can.

    `fuse` gets ranges (k,) and sigmas (k,) in m and returns a depth and its sigma in m; it is called once a stop.
    """

    def each(value_m: FloatArray, sigma_m: FloatArray) -> Fused:
        columns = zip(np.ascontiguousarray(value_m.T), np.ascontiguousarray(sigma_m.T), strict=True)
        found = np.array([fuse(value, sigma) for value, sigma in columns], dtype=np.float64)
        return Fused(found[:, 0], found[:, 1])

    return each


class _Groups(NamedTuple):
    """Stops of a call, ordered by how many valid readings they have.

    Those with k are `stop[edge[k]:edge[k + 1]]`. Of their readings, laid out as (k, G) one group behind the other,
    `value_m` and `sigma_m` are on the grip axis and `reading` is the number in the scan. A group of one stop is laid
    out as two equal ones.
    """

    edge: IntArray
    stop: IntArray
    value_m: FloatArray
    sigma_m: FloatArray
    reading: IntArray


@compiled
def _columns(stops: int) -> int:
    """How many columns a group of so many stops has."""
    return 2 if stops == 1 else stops


class _Validated(NamedTuple):
    """Readings of a range of stops on the grip axis (m) and their sigmas (m), and how many of each stop passed."""

    value_m: FloatArray
    sigma_m: FloatArray
    passed: IntArray


@compiled
def _validated(scan: ScanColumns, limits: Limits, stops: tuple[int, int], out: PointColumns) -> _Validated:
    """Validate a range of stops block by block, and write the gate and the confidences of their readings."""
    start, gate, base, n = scan.start, out.gate, scan.start[stops[0]], stops[1] - stops[0]
    readings = start[stops[1]] - base
    value, sigma = np.empty(readings), np.empty(readings)
    inside = np.empty(block_readings(start[stops[0] : stops[1] + 1]))
    for block in range(stops[0], stops[1], BLOCK):
        own = (block, min(block + BLOCK, stops[1]))
        first = start[own[0]] - base
        validate(scan, limits, own, gate, value[first:], sigma[first:], inside)
    count = np.zeros(n, dtype=np.int64)
    for j in range(n):
        for i in range(start[stops[0] + j], start[stops[0] + j + 1]):
            passed = gate[i] == 0
            out.dc[i] = 1.0 if passed else 0.0
            out.dc1[i] = out.dc2[i] = out.dc3[i] = 1.0 if passed else np.nan
            count[j] += passed
    return _Validated(value, sigma, count)


@compiled
def _grouped(scan: ScanColumns, limits: Limits, stops: tuple[int, int], out: PointColumns) -> _Groups:
    """Validate a range of stops, write all of their columns but depth and sigma, and group their readings."""
    value, sigma, count = _validated(scan, limits, stops, out)
    start, gate, base, n = scan.start, out.gate, scan.start[stops[0]], stops[1] - stops[0]
    most = 0
    for j in range(n):
        most = max(most, count[j])
    edge, place = np.zeros(most + 2, dtype=np.int64), np.zeros(most + 2, dtype=np.int64)
    for j in range(n):
        edge[count[j] + 1] += 1
    for k in range(most + 1):
        edge[k + 1] += edge[k]
        place[k + 1] = place[k] + k * _columns(edge[k + 1] - edge[k])
    filled, stop = edge.copy(), np.empty(n, dtype=np.int64)
    total = place[most + 1]
    by_stop, sigmas, numbers = np.empty(total), np.empty(total), np.empty(total, dtype=np.int64)
    for j in range(n):
        s, k = stops[0] + j, count[j]
        alone = edge[k + 1] - edge[k] == 1
        at, size = place[k] + filled[k] - edge[k], _columns(edge[k + 1] - edge[k])
        stop[filled[k]] = s
        filled[k] += 1
        out.depth_m[s], out.sigma_m[s], out.gap[s], out.reset[s] = np.nan, np.nan, 0, False
        if k == 0:
            out.gap[s] = gap_reason(gate, start[s], start[s + 1])
        for i in range(start[s], start[s + 1]):
            if gate[i] == 0:
                for twin in range(at, at + 1 + alone):
                    by_stop[twin], sigmas[twin], numbers[twin] = value[i - base], sigma[i - base], i
                at += size
    return _Groups(edge, stop, by_stop, sigmas, numbers)


def _fuse_stops(
    name: str, fuse: Fuse, scan: ScanColumns, limits: Limits, stops: tuple[int, int], out: PointColumns
) -> None:
    """Fill in the columns of a range of stops."""
    groups, place = _grouped(scan, limits, stops, out), 0
    edges = groups.edge.tolist()
    for k in range(1, len(edges) - 1):
        n = edges[k + 1] - edges[k]
        if n == 0:
            continue
        shape = (k, _columns(n))
        cells = slice(place, place + k * shape[1])
        place = cells.stop
        depth, sigma, weight = fuse(groups.value_m[cells].reshape(shape), groups.sigma_m[cells].reshape(shape))
        _check(name, shape, depth, sigma, weight)
        known = np.isfinite(depth)
        stop = groups.stop[edges[k] : edges[k + 1]]
        out.depth_m[stop], out.sigma_m[stop] = depth[:n], sigma[:n]
        if not known.all():
            gaps = stop[~known[:n]]
            out.depth_m[gaps] = out.sigma_m[gaps] = np.nan
            out.gap[gaps] = NO_CONFIDENCE
        if weight is not None:
            out.dc[groups.reading[cells]] = out.dc2[groups.reading[cells]] = weight.ravel()


def _check(
    name: str, shape: tuple[int, int], depth_m: FloatArray, sigma_m: FloatArray, weight: FloatArray | None
) -> None:
    """Refuse an answer of the wrong shape, and a depth without a standard deviation.

    Raises
    ------
    DataError : names the method, what it gave and what is wanted.
    """
    if depth_m.shape != shape[1:] or sigma_m.shape != shape[1:] or (weight is not None and weight.shape != shape):
        raise DataError(
            f"fusion method '{name}' made {depth_m.shape} depths and {sigma_m.shape} sigmas of readings {shape}",
            cure=f"reduce axis 0 of the readings: wanted {shape[1:]} of both, and weights of the shape of the readings",
        )
    if not (sigma_m >= 0.0).all() and np.any(wrong := np.isfinite(depth_m) & ~(sigma_m >= 0.0)):
        raise DataError(
            f"fusion method '{name}' gave a depth the standard deviation {sigma_m[wrong][0]:g} m",
            cure="give a number above 0 with every depth",
        )
