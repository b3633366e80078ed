"""Baseline: the median of the validated readings of a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.confidence.agreement import median_of_sorted, sort_into
from surfuse.confidence.columns import PointColumns, ScanColumns
from surfuse.confidence.gate import GateParameters, Limits
from surfuse.confidence.sweepwise import SweepwiseFusion, begin_stop, widest, write_factors, write_value
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray

SUMMARY = "median of the validated readings of each sweep"

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation of a normal distribution, as a factor to its standard deviation."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


@compiled
def median_inflation(n: int) -> float:
    """Variance of the median of n normal readings over that of their mean.

    1 for one and two readings; pi / 2 in the limit. The rational approximation to the known variances of normal
    order statistics (n = 3: 1.346, 4: 1.193, 5: 1.434, 6: 1.288) is within 0.5 % for every n.
    """
    if n <= 2:
        return 1.0
    limit = math.pi / 2.0
    return limit - 0.675 / n if n % 2 == 1 else limit - 2.229 / (n + 1.9)


@compiled
def _sigma(
    value: FloatArray, sigma: FloatArray, passed: FloatArray, n: int, depth: float, scratch: FloatArray
) -> float:
    """The larger of the readings' own sigma and of their scatter (median absolute deviation), taken to the median."""
    own, count = 0.0, 0
    for s in range(n):
        if passed[s] != 0.0:
            own += sigma[s] * sigma[s]
            count += 1
    own /= count
    for s in range(n):
        value[s] = abs(value[s] - depth)
    scatter = 0.0
    if count > 1:
        sort_into(value, passed, n, scratch)
        scatter = (MAD_TO_SIGMA * median_of_sorted(scratch, count)) ** 2
    return math.sqrt(max(own, scatter) * median_inflation(count) / count)


@compiled
def _walk(scan: ScanColumns, limits: Limits, out: PointColumns) -> None:
    width = widest(scan)
    value, sigma, inside = np.empty(width), np.empty(width), np.empty(width)
    passed, ordered = np.empty(width), np.empty(width)
    for j in range(scan.row.shape[0]):
        first, n = scan.start[j], scan.start[j + 1] - scan.start[j]
        if begin_stop(scan, limits, j, value, sigma, inside, passed, out) == 0:
            continue
        for s in range(n):
            if passed[s] != 0.0:
                write_factors(out, first + s, 1.0, 1.0, 1.0)
        depth = median_of_sorted(ordered, sort_into(value, passed, n, ordered))
        spread = _sigma(value, sigma, passed, n, depth, ordered)
        write_value(out, j, depth, spread, scan.world_from_grip[j], limits.part_from_world)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, out)

    return SweepwiseFusion("median", parameters, fresh, walk)
