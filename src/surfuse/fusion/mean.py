"""Baseline: the plain average of the validated readings of a sweep (the paper's spatial average without weights)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.fusing.per_stop import Fused, per_stop
from surfuse.fusing.uncertainty import sigma_of_averages
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray

SUMMARY = "plain average of the validated readings of each sweep"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


def fuse(value_m: FloatArray, sigma_m: FloatArray) -> Fused:
    """Average of k readings, and the larger of its errors from their own sigma and from their scatter (Birge 1932).

    `value_m` and `sigma_m` (k, G) are the readings of G sweeps on the grip axis, in m; depth and sigma (G,) in m.
    """
    depth = np.add.reduce(value_m, axis=0) / len(value_m)
    share = np.full(value_m.shape, 1.0 / len(value_m))
    return Fused(depth, sigma_of_averages(share, value_m - depth, sigma_m))


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""
    return per_stop("mean", parameters, fuse)
