"""dc3: the probability that a sensor points at the part, from where its footprint lies (section 3.2)."""

from __future__ import annotations

import math

import numpy as np

from surfuse.confidence.gate import Limits
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.records.kernel_columns import ScanColumns


@compiled
def boundary_confidence(inside_m: float, scale_m: float) -> float:
    """dc3 = 1 / (1 + exp(-d / scale)), d the signed distance of the footprint's centre to the outline in m.

    Positive d is on the part; 1/2 on the boundary; 1 without an outline (d = +inf). The logistic is the sigmoid that
    approximates the normal distribution function of an outline error with standard deviation 1.7 scale.
    """
    return 1.0 / (1.0 + math.exp(-inside_m / scale_m))


@compiled
def boundary_scale(footprint_m: float, share: float, floor_m: float) -> float:
    """Scale of the sigmoid in m: a share of the footprint's radius, at least `floor_m`, the error of the outline."""
    return max(share * footprint_m, floor_m)


@compiled
def boundary_confidences(
    scan: ScanColumns,
    limits: Limits,
    stops: tuple[int, int],
    gate: IntArray,
    inside_m: FloatArray,
    share: float,
    floor_m: float,
    dc3: FloatArray,
) -> None:
    """dc3 (N,) of the validated readings of a range of stops; `inside_m` counts from the first reading of the range.

    `inside_m` (K,) is how far the footprint's centre lies inside the outline (m; negative: outside), `gate` (N,) says
    which readings are valid; the others get nan. Scale of the sigmoid: `share` of the footprint's radius, at least
    `floor_m` (m).
    """
    ranges, sensors, spread, base = scan.range_m, scan.sensor, limits.spread, scan.start[stops[0]]
    for i in range(base, scan.start[stops[1]]):
        scale = boundary_scale(ranges[i] * spread[sensors[i]], share, floor_m)
        dc3[i] = boundary_confidence(inside_m[i - base], scale) if gate[i] == 0 else np.nan
