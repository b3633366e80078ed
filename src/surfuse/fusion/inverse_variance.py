"""The minimum-variance average of a sweep: each reading weighted by the inverse of its variance.

The best linear unbiased estimate from independent readings of one depth (Gauss-Markov theorem; Aitken, Proc. R. Soc.
Edinburgh 55 (1936) 42-48): M = sum(m / s^2) / sum(1 / s^2), variance 1 / sum(1 / s^2). With sensors of one kind it is
the mean; with mixed kinds, or with standard deviations in the log, good readings count more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.fusing.per_stop import Fused, per_stop
from surfuse.fusing.uncertainty import sigma_of_averages
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray

SUMMARY = "average of each sweep weighted by the inverse variance of its readings"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


def fuse(value_m: FloatArray, sigma_m: FloatArray) -> Fused:
    """Weighted average of k readings, and the larger of its internal and external error (Birge 1932).

    Weights are relative to the best reading of the sweep, so that a degree of confidence stays within [0, 1].

    `value_m` and `sigma_m` (k, G) are the readings of G sweeps on the grip axis, in m; depth and sigma (G,) in m.
    """
    finest = np.minimum.reduce(sigma_m, axis=0)
    # A beam across the grip axis tells its depth exactly: sigma 0.
    weight = np.where(sigma_m > 0.0, (finest / np.where(sigma_m > 0.0, sigma_m, 1.0)) ** 2, 1.0)
    total = np.add.reduce(weight, axis=0)
    depth = np.add.reduce(weight * value_m, axis=0) / total
    return Fused(depth, sigma_of_averages(weight / total, value_m - depth, sigma_m), weight)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    return per_stop("inverse_variance", parameters, fuse)
