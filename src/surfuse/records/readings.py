"""Readings as columns, from the device to the map: of one stop (`Sweep`) and of a scan (`Readings`).

The table of the columns is `ReadingColumns` (an entry per reading) and the definitions above `Sweep` (an entry per
stop). How a column is added is told in docs/explanations/records.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import FloatArray, IntArray, check_least, check_rigid, check_sensors, check_unit
from surfuse.records.codes import Status
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
from surfuse.records.sensing import Echo, SensorSpec


@dataclass(frozen=True, eq=False)
class ReadingColumns(ArrayRecord):
    """N readings in columns, in any order, with the pose of each sensor as reached (world frame)."""

    t_s: FloatArray = per_reading("s", "moment of the first emission")
    sensor: IntArray = per_reading("", "number of the sensor among the specs of the scan", dtype=np.int64)
    position_m: FloatArray = per_reading("m", "place of the sensor", tail=(3,))
    axis: FloatArray = per_reading("1", "unit direction of the beam", tail=(3,))
    range_m: FloatArray = per_reading("m", "measured range, by REP-117 where there is none")
    status: IntArray = per_reading("", "what the sensor says of it, see `Status`", dtype=np.int64)
    amplitude: FloatArray = per_reading("1", "strength of the echo, 1: a facing plate; nan: unknown", missing=np.nan)
    spread_m: FloatArray = per_reading("m", "scatter of the pings that agreed; nan: unknown", missing=np.nan)
    count: IntArray = per_reading("", "how many pings the range is the mean of", dtype=np.int64, missing=1)
    sigma_m: FloatArray = per_reading(
        "m", "standard deviation that the log states; nan: that of the spec holds", missing=np.nan
    )

    def __post_init__(self) -> None:
        own_columns(self, len(self.sensor), None)
        self._check()

    def _check(self) -> None:
        name = type(self).__name__
        check_unit(self.axis, f"{name}.axis")
        if len(self.status) and not (self.status.min() >= 0 and self.status.max() <= max(Status)):
            wrong = self.status[(self.status < 0) | (self.status > max(Status))]
            raise DataError(f"{name}.status holds {wrong[0]}", cure=f"give 0 to {int(max(Status))}, see Status")
        check_least(self.count, f"{name}.count", 0)
        check_least(self.sigma_m, f"{name}.sigma_m", 0.0)

    @property
    def n_readings(self) -> int:
        """Number of readings N."""
        return len(self.sensor)

    def take(self, rows: IntArray) -> ReadingColumns:
        """The readings of some rows, in the order of the rows."""
        return ReadingColumns(**{name: column[rows] for name, column in self.by_name().items()})

    def by_name(self) -> dict[str, Any]:
        """The columns with an entry per reading, by name."""
        return {column.name: getattr(self, column.name) for column in columns_of(ReadingColumns)}


_stop = partial(per_stop, "", "number of the stop", dtype=np.int64)
_row = partial(per_stop, "", "scan line of the stop", dtype=np.int64)
_world_from_grip = partial(per_stop, "1", "pose of the grip as reached", tail=(4, 4))
_joints_rad = partial(
    per_stop, "rad", "joints of the arm there, J of them; width 0: unknown", tail=(None,), missing=np.nan
)


@dataclass(frozen=True, eq=False)
class Sweep(ReadingColumns):
    """The readings of one stop; a sensor may be missing."""

    stop: int = _stop()
    row: int = _row()
    world_from_grip: FloatArray = _world_from_grip()
    joints_rad: FloatArray = _joints_rad()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_rigid(self.world_from_grip, "Sweep.world_from_grip")

    def echo(self, i: int) -> Echo:
        """Reading i as the answer of its device."""
        values: dict[str, Any] = {name: getattr(self, name)[i].item() for name in ECHO_COLUMNS}
        return Echo(**{**values, "status": Status(values["status"])})


ECHO_COLUMNS = tuple(one.name for one in fields(Echo))
"""Columns that a device answers."""


def columns_of_echoes(echoes: Sequence[Echo]) -> dict[str, Any]:
    """The columns (S,) of the answers of a device, by name."""
    return {name: np.array([getattr(echo, name) for echo in echoes]) for name in ECHO_COLUMNS}


@dataclass(frozen=True, eq=False)
class Readings(ReadingColumns):
    """All readings of a scan, sweep after sweep: what every fusion method starts from.

    N readings, M sweeps; sweep j holds the rows `start[j]:start[j + 1]`. The sensors are numbered as in `specs`.
    """

    specs: tuple[SensorSpec, ...] = field(kw_only=True)
    start: IntArray = ragged_start()
    stop: IntArray = _stop()
    row: IntArray = _row()
    world_from_grip: FloatArray = _world_from_grip()
    joints_rad: FloatArray = _joints_rad()

    def __post_init__(self) -> None:
        n, m = len(self.sensor), len(self.stop)
        own_columns(self, n, m)
        own_start(self, self.start, n, m)
        self._check()
        check_rigid(self.world_from_grip, "Readings.world_from_grip")
        check_sensors(self.sensor, len(self.specs))

    @property
    def n_sweeps(self) -> int:
        """Number of sweeps M."""
        return len(self.stop)

    def sweep(self, j: int) -> Sweep:
        """Sweep j as the record that live fusion receives; a view."""
        rows = slice(int(self.start[j]), int(self.start[j + 1]))
        values = {name: getattr(self, name)[rows] for name in _PER_READING}
        values |= {name: getattr(self, name)[j] for name in _ARRAYS_PER_STOP}
        values |= {name: getattr(self, name)[j].item() for name in _NUMBERS_PER_STOP}
        return view(Sweep, **values)

    def select(self, rows: IntArray) -> Readings:
        """The readings of some rows, in their order here and in their sweeps; sweeps without one are left out."""
        kept = np.sort(rows)
        sweeps, sizes = np.unique(np.searchsorted(self.start, kept, side="right") - 1, return_counts=True)
        of_stops: dict[str, Any] = {column.name: getattr(self, column.name)[sweeps] for column in STOP_COLUMNS}
        start = edges_of(sizes.tolist())
        return Readings(specs=self.specs, start=start, **self.take(kept).by_name(), **of_stops)


SWEEP_COLUMNS = columns_of(Sweep)
STOP_COLUMNS = columns_per(Sweep, Per.STOP)
_PER_READING = tuple(column.name for column in columns_of(ReadingColumns))
_ARRAYS_PER_STOP = tuple(column.name for column in STOP_COLUMNS if column.tail)
_NUMBERS_PER_STOP = tuple(column.name for column in STOP_COLUMNS if not column.tail)


def readings_from_sweeps(specs: tuple[SensorSpec, ...], sweeps: Sequence[Sweep]) -> Readings:
    """Stack sweeps, in the order given, into the columns of one scan."""
    values: dict[str, Any] = {}
    for column in SWEEP_COLUMNS:
        parts = list(map(attrgetter(column.name), sweeps))
        if column.per is Per.READING:
            values[column.name] = stacked(column, parts)
        elif column.tail:
            values[column.name] = stacked(column, [part[np.newaxis] for part in parts])
        else:
            values[column.name] = np.array(parts, dtype=column.dtype)
        values[column.name].setflags(write=False)
    return Readings(specs=specs, start=edges_of([sweep.n_readings for sweep in sweeps]), **values)
