"""The standard deviation of a weighted average of a few readings."""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


@compiled
def sigma_of_average(
    weight: FloatArray, value_m: FloatArray, sigma_m: FloatArray, base: int, first: int, last: int, average_m: float
) -> float:
    """Standard deviation in m of sum(w m) / sum(w) over readings first to last - 1; weights 0 take no part.

    `weight` counts from reading 0, `value_m` and `sigma_m` from reading `base`.

    The larger of two estimates (internal and external error, Birge, Phys. Rev. 40 (1932) 207):
    - from the readings' own sigma: sqrt(sum w^2 sigma^2) / sum w. Four equal readings of a facing plate: sigma / 2;
    - from their scatter about the average: sqrt(sum w^2 (m - M)^2 / (sum w)^2 * n_e / (n_e - 1)), with the effective
      number n_e = (sum w)^2 / sum w^2. Equal weights: the standard error s / sqrt(n). It shows where the readings
      contradict each other (a step, a tilt, an outlier). With n_e near 1 there is no scatter to speak of.

    `weight` is (N,) over all readings of the scan, the others (K,) over a range of them, in m.
    """
    total, squares, own, scatter = 0.0, 0.0, 0.0, 0.0
    for i in range(first, last):
        total += weight[i]
    for i in range(first, last):
        # Relative weights first: squares of tiny weights would underflow.
        w = weight[i] / total
        if w > 0.0:  # the value of a refused reading is not defined
            squares += w * w
            own += (w * sigma_m[i - base]) ** 2
            scatter += (w * (value_m[i - base] - average_m)) ** 2
    # With n_e = 1 / q: n_e / (n_e - 1) = 1 / (1 - q). One dominant reading (q near 1) leaves the scatter undetermined.
    external = scatter / (1.0 - squares) if squares < 0.99 else 0.0
    return math.sqrt(max(own, external))


def sigma_of_averages(share: FloatArray, deviation_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """`sigma_of_average` of many stops at once: the k readings of each are the rows (k, ...) of the arrays.

    `share` are the weights over their sum, `deviation_m` the values less their average.

    All are (k, ...), in m but for the shares; the result (...) is in m. One reading alone has its own sigma.
    """
    squares = np.add.reduce(share * share, axis=0)
    own = np.add.reduce((share * sigma_m) ** 2, axis=0)
    scatter = np.add.reduce((share * deviation_m) ** 2, axis=0)
    external = np.where(squares < 0.99, scatter / np.where(squares < 0.99, 1.0 - squares, 1.0), 0.0)
    return np.asarray(np.sqrt(np.maximum(own, external)), dtype=np.float64)
