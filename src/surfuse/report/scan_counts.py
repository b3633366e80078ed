"""Counts of the scan: why readings were kept out, which stops have no value, where the prediction started afresh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import FusedPoints, Gap, Gate, IntArray


@dataclass(frozen=True)
class ScanCounts:
    """`gates` (S, number of reasons) counts the readings of each sensor, `gaps` (number of reasons,) the stops.

    `resets` is the number of stops at which the fusion started afresh.
    """

    gates: IntArray
    gaps: IntArray
    resets: int

    @property
    def stops(self) -> int:
        """Number of stops."""
        return int(self.gaps.sum())


def count_scan(points: FusedPoints, sensors: int) -> ScanCounts:
    """Count gate reasons by sensor, gap reasons and restarts of the prediction."""
    gates = np.zeros((max(sensors, int(points.sensor.max(initial=-1)) + 1), len(Gate)), dtype=np.int64)
    np.add.at(gates, (points.sensor, points.gate), 1)
    gaps = np.bincount(points.gap, minlength=len(Gap)).astype(np.int64)
    return ScanCounts(gates=gates, gaps=gaps, resets=int(points.reset.sum()))
