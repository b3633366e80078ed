"""Fusion methods that give one fused value a stop from the sweep of that stop and a small memory.

Such a method is two functions: `fresh` makes its memory before the first stop, `walk` is a compiled walk over the
stops that moves the memory on and fills the columns of the fused points. Live fusion walks over one stop at a time,
replay over all of them: the same machine code, so the numbers agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from surfuse.confidence.columns import (
    PointColumns,
    ScanColumns,
    empty_points,
    fused_point,
    fused_points,
    scan_of_readings,
    scan_of_sweep,
    stacked,
)
from surfuse.confidence.gate import GateParameters, Limits, gap_reason, limits_of, validate
from surfuse.errors import DataError
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, FusedPoint, FusionResult, FusionScene, IntArray, MapGrid, Readings, Sweep

M = TypeVar("M")
Walk = Callable[[ScanColumns, Limits, M, PointColumns], None]


@compiled
def widest(scan: ScanColumns) -> int:
    """Readings in the largest sweep: the size of a kernel's scratch arrays."""
    most = 0
    for j in range(scan.row.shape[0]):
        most = max(most, scan.start[j + 1] - scan.start[j])
    return most


@compiled
def write_value(
    out: PointColumns, j: int, depth_m: float, sigma_m: float, world_from_grip: FloatArray, part_from_world: FloatArray
) -> None:
    """Record M, its sigma and the point o + M g in the part frame."""
    out.depth_m[j], out.sigma_m[j], out.gap[j] = depth_m, sigma_m, 0
    x = world_from_grip[0, 3] + depth_m * world_from_grip[0, 2]
    y = world_from_grip[1, 3] + depth_m * world_from_grip[1, 2]
    z = world_from_grip[2, 3] + depth_m * world_from_grip[2, 2]
    for d in range(3):
        out.point_m[j, d] = (
            part_from_world[d, 0] * x + part_from_world[d, 1] * y + part_from_world[d, 2] * z + part_from_world[d, 3]
        )


@compiled
def write_gap(out: PointColumns, j: int, reason: int) -> None:
    """Record a stop without a value: nan, never 0, and why."""
    out.depth_m[j], out.sigma_m[j], out.gap[j] = np.nan, np.nan, reason
    out.point_m[j, 0], out.point_m[j, 1], out.point_m[j, 2] = np.nan, np.nan, np.nan


@compiled
def write_factors(out: PointColumns, i: int, dc1: float, dc2: float, dc3: float) -> float:
    """Record the three factors of reading i and return their product (equation 2)."""
    dc = dc1 * dc2 * dc3
    out.dc[i], out.dc1[i], out.dc2[i], out.dc3[i] = dc, dc1, dc2, dc3
    return dc


@compiled
def write_refused(out: PointColumns, i: int) -> None:
    """Record that reading i takes no part: no confidence, factors never evaluated."""
    out.dc[i], out.dc1[i], out.dc2[i], out.dc3[i] = 0.0, np.nan, np.nan, np.nan


@compiled
def begin_stop(
    scan: ScanColumns,
    limits: Limits,
    j: int,
    value_m: FloatArray,
    sigma_m: FloatArray,
    inside_m: FloatArray,
    passed: FloatArray,
    out: PointColumns,
) -> int:
    """Validate stop j: returns how many readings passed, sets `passed[s]` to 1 or 0, records those refused.

    With none passed the stop is recorded as a gap with its reason.
    """
    from_row, to_row = scan.start[j], scan.start[j + 1]
    out.reset[j] = False
    n_passed = validate(scan, limits, j, out.gate, value_m, sigma_m, inside_m)
    for i in range(from_row, to_row):
        passed[i - from_row] = 1.0 if out.gate[i] == 0 else 0.0
        if out.gate[i] != 0:
            write_refused(out, i)
    if n_passed == 0:
        write_gap(out, j, gap_reason(out.gate, from_row, to_row))
    return n_passed


def _known_sensors(sensor: IntArray, known: int) -> None:
    if len(sensor) and not (int(sensor.min()) >= 0 and int(sensor.max()) < known):
        raise DataError(
            f"a reading names sensor {int(sensor.max() if sensor.min() >= 0 else sensor.min())}, "
            f"but the scene has {known} sensors, numbered from 0",
            cure="describe every sensor of the log",
        )


@dataclass
class SweepwiseState(Generic[M]):
    """Where a live fusion stands: limits of the scene, memory of the method, the points so far."""

    sensors: int
    limits: Limits
    memory: M
    points: list[FusedPoint] = field(default_factory=list)


@dataclass(frozen=True)
class SweepwiseFusion(Generic[M]):
    """A `FusionMethod` made of a name, the parameters of validation, `fresh` and `walk` (see the module)."""

    name: str
    gates: GateParameters
    fresh: Callable[[int], M]
    walk: Walk[M]

    def start(self, scene: FusionScene) -> SweepwiseState[M]:
        """A fresh state for the sensors and the outline of the scene."""
        sensors = len(scene.specs)
        return SweepwiseState(sensors, limits_of(scene, self.gates), self.fresh(sensors))

    def step(self, state: object, sweep: Sweep) -> FusedPoint:
        """Take in one sweep: the memory in the state moves on, the point of this stop is returned."""
        own = self._own(state)
        _known_sensors(sweep.sensor, own.sensors)
        out = empty_points(1, len(sweep.sensor))
        self.walk(scan_of_sweep(sweep), own.limits, own.memory, out)
        point = fused_point(sweep, out)
        own.points.append(point)
        return point

    def finish(self, state: object, grid: MapGrid) -> FusionResult:
        """All points so far; gridding them is left to the caller."""
        return FusionResult(points=stacked(self._own(state).points))

    def replay(self, scene: FusionScene, readings: Readings, grid: MapGrid) -> FusionResult:
        """The whole scan at once."""
        _known_sensors(readings.sensor, len(scene.specs))
        out = empty_points(readings.n_sweeps, len(readings.t_s))
        self.walk(scan_of_readings(readings), limits_of(scene, self.gates), self.fresh(len(scene.specs)), out)
        return FusionResult(points=fused_points(readings, out))

    def _own(self, state: object) -> SweepwiseState[M]:
        if not isinstance(state, SweepwiseState):
            raise DataError(
                f"'{self.name}' was given a state of type {type(state).__name__}", cure="pass what its start() returned"
            )
        return state
