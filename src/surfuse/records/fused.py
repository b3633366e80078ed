"""What fusion takes beside the readings, and what it returns for each stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import BoolArray, FloatArray, IntArray, own_pose
from surfuse.records.columns import (
    ArrayRecord,
    Per,
    columns_of,
    columns_per,
    edges_of,
    own_columns,
    own_start,
    per_reading,
    per_stop,
    ragged_start,
    stacked,
    view,
)
from surfuse.records.pictures import Outline
from surfuse.records.sensing import SensorSpec


@dataclass(frozen=True, eq=False)
class FusionScene(ArrayRecord):
    """What a fusion method knows before the first reading: sensors, part frame, outline, limits of the cell.

    `depth_max_m` bounds the range along the grip axis (the table's outer edge; inf: unknown). The outline is the
    one that the camera saw, not enlarged (None: unknown).
    """

    specs: tuple[SensorSpec, ...]
    world_from_part: FloatArray
    outline: Outline | None = None
    depth_max_m: float = float("inf")

    def __post_init__(self) -> None:
        own_pose(self, "world_from_part")
        if not self.depth_max_m > 0.0:
            raise DataError(f"FusionScene.depth_max_m = {self.depth_max_m:g}", cure="give a range above 0, or inf")


@dataclass(frozen=True, eq=False)
class FusedPoints(ArrayRecord):
    """Fused points in columns: M stops, their N readings ragged by `start` as in `Readings`; one stop is a slice.

    `depth_m` is M(n), the range assigned to the grip axis (nan: a gap, see `gap`); `dc`, `dc1`, `dc2`, `dc3` are the
    degree of confidence of each reading and its factors.
    """

    stop: IntArray = per_stop("", "number of the stop", dtype=np.int64)
    row: IntArray = per_stop("", "scan line of the stop", dtype=np.int64)
    depth_m: FloatArray = per_stop("m", "fused value M(n), the range along the grip axis")
    sigma_m: FloatArray = per_stop("m", "standard deviation of the fused value")
    point_m: FloatArray = per_stop("m", "fused point u, v, w in the part frame", tail=(3,))
    gap: IntArray = per_stop("", "why the stop has no fused value", dtype=np.int64)
    reset: BoolArray = per_stop("", "whether the prediction window started afresh", dtype=np.bool_)
    start: IntArray = ragged_start()
    sensor: IntArray = per_reading("", "number of the sensor", dtype=np.int64)
    dc: FloatArray = per_reading("1", "degree of confidence, the product of its factors")
    dc1: FloatArray = per_reading("1", "factor of prediction")
    dc2: FloatArray = per_reading("1", "factor of agreement")
    dc3: FloatArray = per_reading("1", "factor of the boundary")
    gate: IntArray = per_reading("", "why validation kept the reading out", dtype=np.int64)

    def __post_init__(self) -> None:
        n, m = len(self.sensor), len(self.stop)
        own_columns(self, n, m)
        own_start(self, self.start, n, m)

    def __len__(self) -> int:
        return len(self.stop)

    def at(self, j: int) -> FusedPoints:
        """Fused point j alone; a view."""
        first, last = int(self.start[j]), int(self.start[j + 1])
        values = {name: getattr(self, name)[first:last] for name in _PER_READING}
        values |= {name: getattr(self, name)[j : j + 1] for name in _PER_STOP}
        return view(FusedPoints, start=edges_of([last - first]), **values)


POINT_COLUMNS = columns_of(FusedPoints)
_PER_READING = tuple(column.name for column in columns_per(FusedPoints, Per.READING))
_PER_STOP = tuple(column.name for column in columns_per(FusedPoints, Per.STOP))


def stacked_points(points: Sequence[FusedPoints]) -> FusedPoints:
    """Fused points in the order given, as one record."""
    values: dict[str, Any] = {
        column.name: stacked(column, [getattr(one, column.name) for one in points]) for column in POINT_COLUMNS
    }
    for array in values.values():
        array.setflags(write=False)
    return FusedPoints(start=edges_of([n for one in points for n in np.diff(one.start).tolist()]), **values)
