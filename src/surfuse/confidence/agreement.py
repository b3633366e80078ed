"""dc2: how well a reading agrees with the others of its sweep, and how often its sensor did before (section 3.2).

The reference of a reading is the *median of the others*. The mean of the others would let one outlier of 40 mm move
the reference of three good readings by 13 mm; the median of three others stays where the majority is. The reading
itself is left out, so that it cannot vouch for itself.
"""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.records.kernel_columns import ScanColumns


@compiled
def sort_into(values: FloatArray, gate: IntArray, base: int, first: int, last: int, ordered: FloatArray) -> int:
    """Copy the values of the validated readings first to last - 1 into `ordered`, increasing; returns how many.

    `values` counts from reading `base`, `gate` from reading 0.

    `values` (K,) over a range of readings, `gate` (N,) over all; `ordered` needs room for last - first values, and
    those beyond the returned number are left as they were.
    """
    count = 0
    for s in range(first - base, last - base):
        if gate[base + s] != 0:
            continue
        k = count
        while k > 0 and ordered[k - 1] > values[s]:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = values[s]
        count += 1
    return count


@compiled
def median_of_sorted(ordered: FloatArray, n: int) -> float:
    """Median of the first n >= 1 values of an increasing array.

    `ordered` (n or more,); of an even number it is the mean of the middle two.
    """
    lower: float = ordered[(n - 1) // 2]
    upper: float = ordered[n // 2]
    return 0.5 * (lower + upper)


@compiled
def median_of_others(value: float, a: float, b: float, c: float, d: float) -> float:
    """Median of n increasing values without one occurrence of `value`, from those in the middle (0-based).

    a, b: the values (n - 2) // 2 and the next; c, d: the values (n - 1) // 2 and the next. Leaving out a value moves
    those at and above it down by one place.
    """
    return 0.5 * ((a if a < value else b) + (c if c < value else d))


@compiled
def updated_error_rate(rate: float, is_error: bool, memory: float) -> float:
    """Running error rate of a sensor in [0, 1]: exponential forgetting with a memory of so many readings."""
    return rate + ((1.0 if is_error else 0.0) - rate) / memory


@compiled
def agreement_confidence(deviation_m: float, allowed_m: float, error_rate: float) -> float:
    """dc2 = (1 - error rate) exp(-e^2 / (2 allowed^2)), e = how far |deviation| exceeds the allowed deviation.

    Within the allowed deviation only the history of the sensor counts.
    """
    excess = abs(deviation_m) - allowed_m
    if excess <= 0.0:
        return 1.0 - error_rate
    z = excess / allowed_m
    return (1.0 - error_rate) * math.exp(-0.5 * z * z)


@compiled
def deviations(
    scan: ScanColumns, stops: tuple[int, int], gate: IntArray, value_m: FloatArray, deviation_m: FloatArray
) -> None:
    """How far each validated reading (N,) of a range of stops is from the median of the others of its sweep.

    `value_m` counts from the first reading of the range, `deviation_m` from reading 0. A reading alone in its sweep
    deviates from nobody. All in m; written into `deviation_m` (N,). `stops` is (first, last + 1).
    """
    start = scan.start
    base = start[stops[0]]
    ordered = np.empty(start[stops[1]] - base + 1)
    for j in range(stops[0], stops[1]):
        n = sort_into(value_m, gate, base, start[j], start[j + 1], ordered)
        if n == 1:
            ordered[1] = ordered[0]
        low, high = max(n - 2, 0) // 2, max(n - 1, 0) // 2
        a, b, c, d = ordered[low], ordered[low + 1], ordered[high], ordered[high + 1]
        for i in range(start[j], start[j + 1]):
            if gate[i] == 0:
                deviation_m[i] = value_m[i - base] - median_of_others(value_m[i - base], a, b, c, d)


@compiled
def agreement_confidences(
    scan: ScanColumns,
    stops: tuple[int, int],
    gate: IntArray,
    allowed_m: float,
    memory: float,
    error_rate: FloatArray,
    dc2: FloatArray,
) -> None:
    """dc2 (N,) of a range of stops in the place of the deviations of its readings.

    The sensors' error rates (S,) move on from reading to reading, so this must go through a scan in order.
    """
    sensors = scan.sensor
    for i in range(scan.start[stops[0]], scan.start[stops[1]]):
        if gate[i] == 0:
            deviation = dc2[i]
            rate = updated_error_rate(error_rate[sensors[i]], abs(deviation) > allowed_m, memory)
            error_rate[sensors[i]] = rate
            dc2[i] = agreement_confidence(deviation, allowed_m, rate)
