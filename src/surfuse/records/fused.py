"""What fusion takes beside the readings, and what it returns for each stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records.checks import BoolArray, FloatArray, IntArray, own, own_pose
from surfuse.records.codes import Gap
from surfuse.records.pictures import Outline
from surfuse.records.sensing import SensorSpec


@dataclass(frozen=True)
class FusionScene:
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


@dataclass(frozen=True)
class FusedPoint:
    """The fused value of one stop: M(n), its standard deviation, and why.

    `depth_m` is M(n), the range assigned to the grip axis (nan: a gap, see `gap`); `point_m` (3,) the same as u, v, w
    in the part frame; `dc`, `dc1`, `dc2`, `dc3` (S,) the degree of confidence of each reading and its factors;
    `gate` (S,) why a reading took no part; `reset` whether the prediction window started afresh.
    """

    stop: int
    row: int
    depth_m: float
    sigma_m: float
    point_m: FloatArray
    sensor: IntArray
    dc: FloatArray
    dc1: FloatArray
    dc2: FloatArray
    dc3: FloatArray
    gate: IntArray
    gap: Gap
    reset: bool

    def __post_init__(self) -> None:
        s = len(self.sensor)
        own(self, np.float64, point_m=(3,), dc=(s,), dc1=(s,), dc2=(s,), dc3=(s,))
        own(self, np.int64, sensor=(s,), gate=(s,))


@dataclass(frozen=True)
class FusedPoints:
    """Fused points of a scan in columns: M stops, their N readings ragged by `start` as in `Readings`."""

    stop: IntArray
    row: IntArray
    depth_m: FloatArray
    sigma_m: FloatArray
    point_m: FloatArray
    gap: IntArray
    reset: BoolArray
    start: IntArray
    sensor: IntArray
    dc: FloatArray
    dc1: FloatArray
    dc2: FloatArray
    dc3: FloatArray
    gate: IntArray

    def __post_init__(self) -> None:
        m, n = len(self.stop), len(self.sensor)
        own(
            self,
            np.float64,
            depth_m=(m,),
            sigma_m=(m,),
            point_m=(m, 3),
            dc=(n,),
            dc1=(n,),
            dc2=(n,),
            dc3=(n,),
        )
        own(self, np.int64, stop=(m,), row=(m,), gap=(m,), start=(m + 1,), sensor=(n,), gate=(n,))
        own(self, np.bool_, reset=(m,))

    def __len__(self) -> int:
        return len(self.stop)

    def at(self, j: int) -> FusedPoint:
        """Fused point j as the record that live fusion returns."""
        rows = slice(int(self.start[j]), int(self.start[j + 1]))
        return FusedPoint(
            stop=int(self.stop[j]),
            row=int(self.row[j]),
            depth_m=float(self.depth_m[j]),
            sigma_m=float(self.sigma_m[j]),
            point_m=self.point_m[j],
            sensor=self.sensor[rows],
            dc=self.dc[rows],
            dc1=self.dc1[rows],
            dc2=self.dc2[rows],
            dc3=self.dc3[rows],
            gate=self.gate[rows],
            gap=Gap(int(self.gap[j])),
            reset=bool(self.reset[j]),
        )
