"""Where the sensors will stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records.checks import FloatArray, IntArray, check_finite, check_number, check_rigid, own
from surfuse.records.columns import ArrayRecord
from surfuse.records.pictures import Outline


@dataclass(frozen=True)
class SkippedStop:
    """A stop that the plan leaves out, where it would have been (part frame), and why."""

    u_m: float
    v_m: float
    reason: str


@dataclass(frozen=True, eq=False)
class ScanPlan(ArrayRecord):
    """Targets of the grip in visiting order.

    `world_from_grip` (N, 4, 4), `uv_m` (N, 2) where the grip axis meets the acquisition plane (part frame),
    `row` (N,) the scan line, `joints_rad` (N, J) the chosen configuration.
    """

    world_from_grip: FloatArray
    uv_m: FloatArray
    row: IntArray
    joints_rad: FloatArray
    outline: Outline
    step_m: float
    standoff_m: float
    skipped: tuple[SkippedStop, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.uv_m)
        own(self, np.float64, world_from_grip=(n, 4, 4), uv_m=(n, 2), joints_rad=(n, None))
        own(self, np.int64, row=(n,))
        check_rigid(self.world_from_grip, "ScanPlan.world_from_grip")
        check_finite(self.uv_m, "ScanPlan.uv_m")
        check_finite(self.joints_rad, "ScanPlan.joints_rad")
        check_number("ScanPlan.step_m", self.step_m, 0.0, float("inf"), above=True)
        check_number("ScanPlan.standoff_m", self.standoff_m, 0.0, float("inf"), above=True)

    def __len__(self) -> int:
        return len(self.uv_m)
