"""The minimum-variance average of a sweep: each reading weighted by the inverse of its variance.

The best linear unbiased estimate from independent readings of one depth (Gauss-Markov theorem; Aitken, Proc. R. Soc.
Edinburgh 55 (1936) 42-48): M = sum(m / s^2) / sum(1 / s^2), variance 1 / sum(1 / s^2). With sensors of one kind it is
the mean; with mixed kinds, or with standard deviations in the log, good readings count more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.fusing.columns import PointColumns, ScanColumns
from surfuse.fusing.sweepwise import BLOCK, SweepwiseFusion, block_readings
from surfuse.fusing.uncertainty import sigma_of_average
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod

SUMMARY = "average of each sweep weighted by the inverse variance of its readings"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


@compiled
def _walk(scan: ScanColumns, limits: Limits, out: PointColumns) -> None:
    start, depths, sigmas, gaps, resets = scan.start, out.depth_m, out.sigma_m, out.gap, out.reset
    gate, dc, dc1, dc2, dc3 = out.gate, out.dc, out.dc1, out.dc2, out.dc3
    stops, room = scan.row.shape[0], block_readings(start)
    value, sigma, inside = np.empty(room), np.empty(room), np.empty(room)
    for block in range(0, stops, BLOCK):
        end, base = min(block + BLOCK, stops), start[block]
        validate(scan, limits, (block, end), gate, value, sigma, inside)
        for j in range(block, end):
            first, last, finest = start[j], start[j + 1], np.inf
            for i in range(first, last):
                dc[i] = 0.0
                dc1[i] = dc2[i] = dc3[i] = 1.0 if gate[i] == 0 else np.nan
                if gate[i] == 0:
                    finest = min(finest, sigma[i - base])
            depths[j], sigmas[j], gaps[j], resets[j] = np.nan, np.nan, 0, False
            if finest == np.inf:
                gaps[j] = gap_reason(gate, first, last)
                continue
            weights, moment = 0.0, 0.0
            for i in range(first, last):
                if gate[i] == 0:
                    # Relative to the best reading of the sweep, so that a degree of confidence stays within [0, 1].
                    dc[i] = dc2[i] = (finest / sigma[i - base]) ** 2 if sigma[i - base] > 0.0 else 1.0
                    weights += dc[i]
                    moment += dc[i] * value[i - base]
            depths[j] = moment / weights
            sigmas[j] = sigma_of_average(dc, value, sigma, base, first, last, depths[j])


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, out)

    return SweepwiseFusion("inverse_variance", parameters, fresh, walk)
