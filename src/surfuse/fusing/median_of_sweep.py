"""The median of the validated readings of a sweep: the method `median`, and the points of methods that make a map."""

from __future__ import annotations

import math

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.fusing.per_stop import Fused, per_stop
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation of a normal distribution, as a factor to its standard deviation."""


def median_inflation(n: int) -> float:
    """Variance of the median of n normal readings over that of their mean.

    1 for one and two readings; pi / 2 in the limit. The rational approximation to the known variances of normal
    order statistics (n = 3: 1.346, 4: 1.193, 5: 1.434, 6: 1.288) is within 0.5 % for every n.
    """
    if n <= 2:
        return 1.0
    limit = math.pi / 2.0
    return limit - 0.675 / n if n % 2 == 1 else limit - 2.229 / (n + 1.9)


def _median(value_m: FloatArray) -> FloatArray:
    ordered, k = np.sort(value_m, axis=0), len(value_m)
    return np.asarray(0.5 * (ordered[(k - 1) // 2] + ordered[k // 2]), dtype=np.float64)


def fuse(value_m: FloatArray, sigma_m: FloatArray) -> Fused:
    """Median of k readings, and the larger of its errors from their own sigma and from their median deviation.

    `value_m` and `sigma_m` (k, G) are the readings of G sweeps on the grip axis, in m; depth and sigma (G,) in m. The
    variance of a median is `median_inflation(k)` times that of a mean.
    """
    k, depth = len(value_m), _median(value_m)
    own = np.add.reduce(sigma_m**2, axis=0) / k
    scatter = MAD_TO_SIGMA * _median(np.abs(value_m - depth))
    return Fused(depth, np.sqrt(np.maximum(own, scatter**2) * (median_inflation(k) / k)))


def medians(gates: GateParameters) -> FusionMethod:
    """The method that gives every stop the median of its valid readings."""
    return per_stop("median", gates, fuse)
