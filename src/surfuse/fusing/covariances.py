"""Covariance of a surface, and the choice of its constants by the restricted likelihood of small neighbourhoods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from surfuse.records import FloatArray, IntArray

ROOT3 = 3.0**0.5


@dataclass(frozen=True)
class Covariance:
    """Length and standard deviation of the surface about its trend, and a factor to the readings' own sigma.

    `length_m` is that of the Matern correlation, `signal_m` in m, `noise` multiplies every stated sigma.
    """

    length_m: float
    signal_m: float
    noise: float

    def between(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray:
        """Covariance (..., P, Q) of heights at places (..., P, 2) and (..., Q, 2).

        In m^2, with the constants of this record, for places (u, v) in m.
        """
        return self.signal_m**2 * matern(a_m, b_m, self.length_m)


def matern(a_m: FloatArray, b_m: FloatArray, length_m: float) -> FloatArray:
    """Matern correlation with smoothness 3/2 (Rasmussen and Williams 2006, equation 4.17): once differentiable.

    (..., P, Q) for places (..., P, 2) and (..., Q, 2) in m: (1 + x) exp(-x) with x = sqrt(3) distance / length.
    """
    offset = a_m[..., :, None, :] - b_m[..., None, :, :]
    scaled = ROOT3 * np.sqrt(np.sum(offset**2, axis=-1)) / length_m
    return np.asarray((1.0 + scaled) * np.exp(-scaled), dtype=np.float64)


LENGTHS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Candidate lengths, in distances between neighbouring places."""

RATIOS = np.logspace(-2.0, 3.0, 21)
"""Candidate standard deviations of the surface, in those of the noise."""

NOISES = np.logspace(-0.5, 2.0, 11)
"""Candidate factors to the readings' own sigma: from a pessimistic data sheet to speckle."""


def chosen(
    uv_m: FloatArray, height_m: FloatArray, sigma_m: FloatArray, index: IntArray, spacing_m: float
) -> Covariance:
    """The candidate with the largest restricted likelihood, summed over neighbourhoods (Q, n) of the places (N, 2).

    Restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545-554): the plane of each neighbourhood is
    projected out, so that a tilt is no signal. For each length one generalised eigenproblem serves all candidates of
    the two standard deviations. Neighbourhoods of fewer than six places decide nothing: a smooth surface is assumed.
    """
    fallback = Covariance(8.0 * spacing_m, 10.0 * float(np.median(sigma_m)), 1.0)
    if index.shape[1] < 6:
        return fallback
    best, found = -np.inf, fallback
    typical = float(np.median(sigma_m))
    for length in LENGTHS:
        total = np.zeros((len(RATIOS), len(NOISES)))
        for rows in index:
            total += _likelihood(uv_m[rows], height_m[rows], sigma_m[rows], length * spacing_m, typical)
        k, q = np.unravel_index(int(np.argmax(total)), total.shape)
        if total[k, q] > best:
            best = float(total[k, q])
            found = Covariance(length * spacing_m, float(RATIOS[k] * NOISES[q]) * typical, float(NOISES[q]))
    return found


def _likelihood(uv: FloatArray, height: FloatArray, sigma: FloatArray, length_m: float, typical: float) -> FloatArray:
    """Restricted log likelihood of one neighbourhood for all candidates of ratio and noise."""
    centre = uv.mean(axis=0)
    basis = np.column_stack([np.ones(len(uv)), (uv - centre) / length_m])
    # The columns of Q after the third are perpendicular to every plane.
    free = np.linalg.qr(basis, mode="complete")[0][:, 3:]
    noise = free.T @ ((sigma / typical) ** 2 * free.T).T
    value, vector = eigh(free.T @ matern(uv, uv, length_m) @ free, noise)
    contrast = vector.T @ (free.T @ (height - height.mean())) / typical
    # In units of the typical sigma the contrasts are independent with variance noise^2 (ratio^2 value + 1).
    inner = RATIOS[:, None] ** 2 * np.maximum(value, 0.0) + 1.0
    squares, logs = np.sum(contrast**2 / inner, axis=1), np.sum(np.log(inner), axis=1)
    n = len(value)
    return np.asarray(
        -0.5 * (squares[:, None] / NOISES**2 + logs[:, None] + 2.0 * n * np.log(NOISES)), dtype=np.float64
    )
