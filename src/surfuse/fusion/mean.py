"""Baseline: the plain average of the validated readings of a sweep (the paper's spatial average without weights)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.columns import PointColumns, ScanColumns
from surfuse.confidence.gate import GateParameters, Limits
from surfuse.confidence.sweepwise import SweepwiseFusion, begin_stop, widest, write_factors, write_value
from surfuse.confidence.uncertainty import sigma_of_average
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod

SUMMARY = "plain average of the validated readings of each sweep"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Only those of validation: gate_footprints, gate_allowance_m (m)."""


@compiled
def _walk(scan: ScanColumns, limits: Limits, out: PointColumns) -> None:
    width = widest(scan)
    value, sigma, inside, passed = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    for j in range(scan.row.shape[0]):
        first, n = scan.start[j], scan.start[j + 1] - scan.start[j]
        n_passed = begin_stop(scan, limits, j, value, sigma, inside, passed, out)
        if n_passed == 0:
            continue
        total = 0.0
        for s in range(n):
            if passed[s] != 0.0:
                write_factors(out, first + s, 1.0, 1.0, 1.0)
                total += value[s]
        depth = total / n_passed
        spread = sigma_of_average(passed, value, sigma, n, depth)
        write_value(out, j, depth, spread, scan.world_from_grip[j], limits.part_from_world)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def fresh(sensors: int) -> None:
        return None

    def walk(scan: ScanColumns, limits: Limits, memory: None, out: PointColumns) -> None:
        _walk(scan, limits, out)

    return SweepwiseFusion("mean", parameters, fresh, walk)
