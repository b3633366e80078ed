"""Every reading of a scan, as columns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import FloatArray, IntArray, own
from surfuse.records.sensing import SensorSpec, Sweep


@dataclass(frozen=True)
class Readings:
    """All readings of a scan in columns, sweep after sweep: what every fusion method starts from.

    N readings, M sweeps; sweep j holds the rows `start[j]:start[j + 1]`. `stop` and `row` (M,) number the stop
    and its scan line, `world_from_grip` (M, 4, 4) is the grip pose of each sweep. `sigma_m` (N,) is the reading's
    own standard deviation where the log has one, else nan (use the spec's); `spread_m` (N,) the scatter of its pings.
    """

    specs: tuple[SensorSpec, ...]
    t_s: FloatArray
    sensor: IntArray
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    status: IntArray
    amplitude: FloatArray
    sigma_m: FloatArray
    count: IntArray
    start: IntArray
    stop: IntArray
    row: IntArray
    world_from_grip: FloatArray
    spread_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n, m = len(self.t_s), len(self.stop)
        if not np.size(self.spread_m):
            object.__setattr__(self, "spread_m", np.full(n, np.nan))
        own(
            self,
            np.float64,
            t_s=(n,),
            position_m=(n, 3),
            axis=(n, 3),
            range_m=(n,),
            amplitude=(n,),
            sigma_m=(n,),
            spread_m=(n,),
        )
        own(self, np.int64, sensor=(n,), status=(n,), count=(n,), start=(m + 1,), stop=(m,), row=(m,))
        own(self, np.float64, world_from_grip=(m, 4, 4))
        if n and not (int(self.sensor.min()) >= 0 and int(self.sensor.max()) < len(self.specs)):
            raise DataError(f"readings name sensor {int(self.sensor.max())}, but there are {len(self.specs)} sensors")
        if self.start[0] != 0 or self.start[-1] != n or np.any(np.diff(self.start) < 0):
            raise DataError("the sweeps of the readings do not cover the rows in order")

    @property
    def n_sweeps(self) -> int:
        """Number of sweeps M."""
        return len(self.stop)

    def sweep(self, j: int) -> Sweep:
        """Sweep j as the record that live fusion receives."""
        rows = slice(int(self.start[j]), int(self.start[j + 1]))
        return Sweep(
            stop=int(self.stop[j]),
            row=int(self.row[j]),
            world_from_grip=self.world_from_grip[j],
            t_s=self.t_s[rows],
            sensor=self.sensor[rows],
            position_m=self.position_m[rows],
            axis=self.axis[rows],
            range_m=self.range_m[rows],
            status=self.status[rows],
            amplitude=self.amplitude[rows],
            spread_m=self.spread_m[rows],
            sigma_m=self.sigma_m[rows],
            count=self.count[rows],
        )


def readings_from_sweeps(specs: tuple[SensorSpec, ...], sweeps: list[Sweep]) -> Readings:
    """Stack sweeps, in the order given, into the columns of one scan."""
    sizes = [len(sweep.sensor) for sweep in sweeps]

    def column(name: str, *tail: int) -> FloatArray:
        return np.concatenate([getattr(sweep, name) for sweep in sweeps]) if sweeps else np.zeros((0, *tail))

    def integers(name: str) -> IntArray:
        return column(name).astype(np.int64)

    return Readings(
        specs=specs,
        t_s=column("t_s"),
        sensor=integers("sensor"),
        position_m=column("position_m", 3),
        axis=column("axis", 3),
        range_m=column("range_m"),
        status=integers("status"),
        amplitude=column("amplitude"),
        sigma_m=column("sigma_m"),
        spread_m=column("spread_m"),
        count=integers("count"),
        start=np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]),
        stop=np.array([sweep.stop for sweep in sweeps], dtype=np.int64),
        row=np.array([sweep.row for sweep in sweeps], dtype=np.int64),
        world_from_grip=np.array([sweep.world_from_grip for sweep in sweeps]).reshape(-1, 4, 4),
    )
