"""Symmetric positive band matrices (n, width + 1): row j holds A[j + k, j] for k = 0 .. width.

Own kernels rather than a threaded library: the matrices are small, the answer is the same bit for bit on every machine,
and no threads fight for the cores. Source: Golub and Van Loan, Matrix Computations, 4.3.5 (band Cholesky).
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray

SMALLEST_PIVOT = 1e-12


@compiled
def factor(band: FloatArray) -> FloatArray:
    """Cholesky factor L in the same layout; a pivot lost to rounding is held at a tiny share of its diagonal.

    `band` (n, width + 1) stays as it is. L L^T = A.
    """
    lower = band.copy()
    n, columns = lower.shape
    for j in range(n):
        pivot = np.sqrt(max(lower[j, 0], SMALLEST_PIVOT * max(band[j, 0], 1e-300)))
        lower[j, 0] = pivot
        last = min(columns, n - j)
        for k in range(1, last):
            lower[j, k] /= pivot
        for k in range(1, last):
            share = lower[j, k]
            if share != 0.0:
                for i in range(k, last):
                    lower[j + k, i - k] -= share * lower[j, i]
    return lower


@compiled
def solve(lower: FloatArray, right: FloatArray) -> FloatArray:
    """Solve A x = right (n,) with the factor of A.

    `lower` (n, width + 1) is that of `factor`; `right` stays as it is.
    """
    x = right.copy()
    n, columns = lower.shape
    for j in range(n):
        x[j] /= lower[j, 0]
        for k in range(1, min(columns, n - j)):
            x[j + k] -= lower[j, k] * x[j]
    for j in range(n - 1, -1, -1):
        total = x[j]
        for k in range(1, min(columns, n - j)):
            total -= lower[j, k] * x[j + k]
        x[j] = total / lower[j, 0]
    return x


@compiled
def colour(lower: FloatArray, white: FloatArray) -> FloatArray:
    """Samples (n, S) with covariance A^-1 from white noise (n, S): solve L^T x = white."""
    x = white.copy()
    n, columns = lower.shape
    for j in range(n - 1, -1, -1):
        for k in range(1, min(columns, n - j)):
            share = lower[j, k]
            if share != 0.0:
                for s in range(x.shape[1]):
                    x[j, s] -= share * x[j + k, s]
        for s in range(x.shape[1]):
            x[j, s] /= lower[j, 0]
    return x


def log_determinant(lower: FloatArray) -> float:
    """Logarithm of the determinant of the factored matrix.

    That of A; `lower` (n, width + 1) is its factor.
    """
    return 2.0 * float(np.sum(np.log(lower[:, 0])))
