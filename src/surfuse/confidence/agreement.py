"""dc2: how well a reading agrees with the others of its sweep, and how often its sensor did before (section 3.2).

The reference of a reading is the *median of the others*. The mean of the others would let one outlier of 40 mm move
the reference of three good readings by 13 mm; the median of three others stays where the majority is. The reading
itself is left out, so that it cannot vouch for itself.
"""

from __future__ import annotations

import math

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


@compiled
def sort_into(values: FloatArray, passed: FloatArray, n: int, ordered: FloatArray) -> int:
    """Copy the values with passed[s] != 0 among the first n into `ordered`, increasing; returns how many."""
    count = 0
    for s in range(n):
        if passed[s] == 0.0:
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
    """Median of the first n >= 1 values of an increasing array."""
    lower: float = ordered[(n - 1) // 2]
    upper: float = ordered[n // 2]
    return 0.5 * (lower + upper)


@compiled
def median_of_others(value: float, ordered: FloatArray, n: int) -> float:
    """Median of the first n increasing values without one occurrence of `value`; the value itself when it is alone."""
    if n < 2:
        return value
    rank = 0
    while ordered[rank] < value:
        rank += 1
    low, high = (n - 2) // 2, (n - 1) // 2
    lower: float = ordered[low] if low < rank else ordered[low + 1]
    upper: float = ordered[high] if high < rank else ordered[high + 1]
    return 0.5 * (lower + upper)


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
