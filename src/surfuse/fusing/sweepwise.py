"""Fusion methods that give one fused value a stop from the sweep of that stop and a small memory.

Such a method is two functions: `fresh` makes its memory before the first stop, `walk` is a compiled walk over the
stops that moves the memory on and fills all columns of the fused points but `point_m`. Live fusion walks over one stop
at a time, replay over all of them: the same machine code, so the numbers agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np

from surfuse.confidence.gate import GateParameters, Limits, limits_of
from surfuse.errors import DataError
from surfuse.geometry.compiled import compiled
from surfuse.records import FusedPoints, FusionResult, FusionScene, IntArray, MapGrid, Readings, Sweep, stacked_points
from surfuse.records.checks import check_sensors
from surfuse.records.kernel_columns import PointColumns, ScanColumns, empty_points, fused_points, scan_of

M = TypeVar("M")
Walk = Callable[[ScanColumns, Limits, M, PointColumns], None]


BLOCK = 256
"""Stops that are validated together: their scratch columns stay in the processor's cache."""


@compiled
def block_readings(start: IntArray) -> int:
    """Readings in the largest block of stops: the size of a kernel's scratch columns.

    `start` (M + 1,) is the first reading of each stop and the end of the last one.
    """
    stops, most = start.shape[0] - 1, 0
    for begin in range(0, stops, BLOCK):
        most = max(most, start[min(begin + BLOCK, stops)] - start[begin])
    return most


LEAST_PIECE = 20_000
"""Stops below which a thread of its own costs more than it saves."""


def pieces_at_lines(row: IntArray, most: int) -> list[tuple[int, int]]:
    """Up to `most` pieces (first, last + 1) of nearly equal length that begin with a scan line each; M rows given."""
    wanted = min(most, len(row) // LEAST_PIECE)
    if wanted < 2:
        return [(0, len(row))]
    lines = np.flatnonzero(np.diff(row)) + 1
    ideal = np.arange(1, wanted) * len(row) // wanted
    at = np.searchsorted(lines, ideal)
    cuts = np.unique(np.concatenate([[0], lines[at[at < len(lines)]], [len(row)]]))
    return [(int(a), int(b)) for a, b in pairwise(cuts)]


@compiled
def place(scan: ScanColumns, limits: Limits, out: PointColumns) -> None:
    """Fill in the points o + M g in the part frame; a gap's M is nan, and so is its point."""
    depths, points, grips, part = out.depth_m, out.point_m, scan.world_from_grip, limits.part_from_world
    for j in range(depths.shape[0]):
        depth = depths[j]
        x = grips[j, 0, 3] + depth * grips[j, 0, 2]
        y = grips[j, 1, 3] + depth * grips[j, 1, 2]
        z = grips[j, 2, 3] + depth * grips[j, 2, 2]
        for d in range(3):
            points[j, d] = part[d, 0] * x + part[d, 1] * y + part[d, 2] * z + part[d, 3]


@dataclass
class SweepwiseState(Generic[M]):
    """Where a live fusion stands: limits of the scene, memory of the method, the points so far."""

    sensors: int
    limits: Limits
    memory: M
    points: list[FusedPoints] = field(default_factory=list)


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

    def step(self, state: object, sweep: Sweep) -> FusedPoints:
        """Take in one sweep: the memory in the state moves on, the point of this stop is returned."""
        own = self._own(state)
        check_sensors(sweep.sensor, own.sensors)
        point = self._fused(sweep, own.limits, own.memory)
        own.points.append(point)
        return point

    def finish(self, state: object, grid: MapGrid) -> FusionResult:
        """All points so far; gridding them is left to the caller."""
        return FusionResult(points=stacked_points(self._own(state).points))

    def replay(self, scene: FusionScene, readings: Readings, grid: MapGrid) -> FusionResult:
        """The whole scan at once."""
        sensors = len(scene.specs)
        check_sensors(readings.sensor, sensors)
        return FusionResult(points=self._fused(readings, limits_of(scene, self.gates), self.fresh(sensors)))

    def _fused(self, readings: Readings | Sweep, limits: Limits, memory: M) -> FusedPoints:
        """Live and replayed fusion are this one call: over one stop, or over all of them."""
        scan = scan_of(readings)
        out = empty_points(len(scan.row), len(scan.sensor))
        self.walk(scan, limits, memory, out)
        place(scan, limits, out)
        return fused_points(scan, readings, out)

    def _own(self, state: object) -> SweepwiseState[M]:
        if not isinstance(state, SweepwiseState):
            raise DataError(
                f"'{self.name}' was given a state of type {type(state).__name__}", cure="pass what its start() returned"
            )
        return state
