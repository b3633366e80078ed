"""Baseline: the median of the validated readings of a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.confidence.agreement import median_of_sorted, sort_into
from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.fusing.columns import PointColumns, ScanColumns
from surfuse.fusing.sweepwise import BLOCK, SweepwiseFusion, block_readings
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, IntArray

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
    value: FloatArray, sigma: FloatArray, gate: IntArray, base: int, first: int, last: int, ordered: FloatArray, n: int
) -> float:
    """The larger of the readings' own sigma and of their scatter (median absolute deviation), taken to the median.

    `ordered` holds the n values, increasing; it is overwritten.
    """
    own, median = 0.0, median_of_sorted(ordered, n)
    for i in range(first, last):
        if gate[i] == 0:
            own += sigma[i - base] * sigma[i - base] / n
            value[i - base] = abs(value[i - base] - median)
    sort_into(value, gate, base, first, last, ordered)
    scatter = MAD_TO_SIGMA * median_of_sorted(ordered, n)
    return math.sqrt(max(own, scatter * scatter) * median_inflation(n) / n)


@compiled
def _walk(scan: ScanColumns, limits: Limits, out: PointColumns) -> None:
    start, depths, sigmas, gaps, resets = scan.start, out.depth_m, out.sigma_m, out.gap, out.reset
    gate, dc, dc1, dc2, dc3 = out.gate, out.dc, out.dc1, out.dc2, out.dc3
    stops, room = scan.row.shape[0], block_readings(start)
    value, sigma, inside, ordered = np.empty(room), np.empty(room), np.empty(room), np.empty(room)
    for block in range(0, stops, BLOCK):
        end, base = min(block + BLOCK, stops), start[block]
        validate(scan, limits, (block, end), gate, value, sigma, inside)
        for j in range(block, end):
            first, last = start[j], start[j + 1]
            for i in range(first, last):
                dc[i] = 1.0 if gate[i] == 0 else 0.0
                dc1[i] = dc2[i] = dc3[i] = 1.0 if gate[i] == 0 else np.nan
            depths[j], sigmas[j], gaps[j], resets[j] = np.nan, np.nan, 0, False
            count = sort_into(value, gate, base, first, last, ordered)
            if count == 0:
                gaps[j] = gap_reason(gate, first, last)
                continue
            depths[j] = median_of_sorted(ordered, count)
            sigmas[j] = _sigma(value, sigma, gate, base, first, last, ordered, count)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, out)

    return SweepwiseFusion("median", parameters, fresh, walk)
