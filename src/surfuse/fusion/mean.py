"""Baseline: the plain average of the validated readings of a sweep (the paper's spatial average without weights)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters, Limits, gap_reason, validate
from surfuse.fusing.columns import PointColumns, ScanColumns
from surfuse.fusing.sweepwise import BLOCK, SweepwiseFusion, block_readings
from surfuse.fusing.uncertainty import sigma_of_average
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod

SUMMARY = "plain average of the validated readings of each sweep"


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
            first, last, total, count = start[j], start[j + 1], 0.0, 0
            for i in range(first, last):
                passed = gate[i] == 0
                dc[i] = 1.0 if passed else 0.0
                dc1[i] = dc2[i] = dc3[i] = 1.0 if passed else np.nan
                if passed:
                    total += value[i - base]
                    count += 1
            depths[j], sigmas[j], gaps[j], resets[j] = np.nan, np.nan, 0, False
            if count == 0:
                gaps[j] = gap_reason(gate, first, last)
                continue
            depths[j] = total / count
            sigmas[j] = sigma_of_average(dc, value, sigma, base, first, last, depths[j])


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, out)

    return SweepwiseFusion("mean", parameters, fresh, walk)
