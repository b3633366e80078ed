"""A table of readings, whatever it came from, checked and made into a scan.

A readings CSV and the same numbers as arrays go through this one door, so that they give the same scan to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from surfuse.errors import DataError, nearest
from surfuse.geometry.poses import FloatArray
from surfuse.records import BoolArray, IntArray, ReadingColumns, SensorSpec, Status
from surfuse.runs.assembly import SingleReadings, assemble, status_of_range
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.side_files import METRES_LIMIT, DescribedSensor, GivenPart

STATUS_WORDS = {status.name.lower(): int(status) for status in Status} | {str(int(s)): int(s) for s in Status}
UNKNOWN_STATUS = -1
_UNIT_TOLERANCE = 1e-3
_EXACT_UNIT = 1e-9


class TableSource(Protocol):
    """Where a table came from, in the words of its messages."""

    @property
    def name(self) -> str:
        """The file, or the call."""

    @property
    def sensors_name(self) -> str:
        """What describes its sensors: a file, or an argument."""

    @property
    def frame_name(self) -> str:
        """What gives its part frame."""

    def where(self, row: int, column: str) -> str:
        """The cell of data row `row` (from 0) and a column of the readings CSV."""

    def row_names(self, one: int, other: int) -> str:
        """Two rows alone."""


@dataclass(frozen=True)
class ReadingTable:
    """The cells of a table of readings: N rows, columns in SI units; absent optional columns are None.

    `t_s`, `range_m`, `sigma_m`, `amplitude` (N,), `position_m` and `axis` (N, 3) in one frame of the user's, `sensor` N
    names, `stop` (N,) numbers of stops. No echo is +inf, an unknown sigma_m or amplitude nan, an unknown status
    `UNKNOWN_STATUS`. `notes` are to be told with the warnings of the scan.
    """

    source: TableSource
    t_s: FloatArray
    sensor: list[str]
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    status: IntArray | None
    sigma_m: FloatArray | None
    amplitude: FloatArray | None
    stop: IntArray | None
    notes: tuple[str, ...] = ()

    def where(self, row: int, column: str) -> str:
        """Where a cell stands, for a message."""
        return self.source.where(row, column)


def with_stop(table: ReadingTable, stop: FloatArray) -> ReadingTable:
    """The table with numbers of stops (N,), which must be whole.

    Raises
    ------
    DataError : a number is not whole, or negative; names its line.
    """
    wrong = np.flatnonzero(~((stop >= 0.0) & (stop == np.round(stop)) & (stop < 2.0**53)))
    if len(wrong):
        row = int(wrong[0])
        raise DataError(f"stop = {stop[row]:g}", where=table.where(row, "stop"), cure="number the stops 0, 1, 2, ...")
    return replace(table, stop=stop.astype(np.int64))


def scan_of_table(
    table: ReadingTable, described: tuple[DescribedSensor, ...], part: GivenPart, assumed: AssumedSensor
) -> ScanLog:
    """Check a table and make a scan of it; `described` is empty when nothing describes the sensors.

    Rows are put in the order of their times, exact repetitions of a row are dropped; both are told in the warnings.
    The axes are made unit length. Without a part frame it is estimated, see `estimate_part_frame`.

    Raises
    ------
    DataError : what cannot be used, with its place in the table.
    """
    warnings = list(table.notes)
    _check_poses(table)
    specs = tuple(one.spec for one in described) or _assumed_specs(table, assumed, warnings)
    sensor = _sensor_numbers(table, specs)
    range_m, status = _ranges(table, warnings)
    axis = _unit_axes(table)
    rows = _order(table, sensor, warnings)
    nothing = np.full(len(rows), np.nan)
    columns = ReadingColumns(
        t_s=table.t_s[rows],
        sensor=sensor[rows],
        position_m=table.position_m[rows],
        axis=axis[rows],
        range_m=range_m[rows],
        status=status[rows],
        amplitude=nothing if table.amplitude is None else table.amplitude[rows],
        sigma_m=nothing if table.sigma_m is None else table.sigma_m[rows],
    )
    single = SingleReadings(
        specs=specs,
        columns=columns,
        stop=None if table.stop is None else table.stop[rows],
        corrections=tuple(one.correction for one in described),
    )
    return assemble(single, part, warnings, table.source.sensors_name, table.source.frame_name)


def _first(wrong: BoolArray) -> int | None:
    rows = np.flatnonzero(wrong)
    return int(rows[0]) if len(rows) else None


def _check_poses(table: ReadingTable) -> None:
    """Times and poses must be finite, in metres, with axes of unit length; ranges in metres and not negative."""
    columns: list[tuple[str, FloatArray]] = [("t", table.t_s)]
    columns += [(f"p{name}", table.position_m[:, i]) for i, name in enumerate("xyz")]
    columns += [(f"a{name}", table.axis[:, i]) for i, name in enumerate("xyz")]
    for name, values in columns:
        row = _first(~np.isfinite(values))
        if row is not None:
            cure = "a reading needs its time and pose: remove the line, or complete it"
            raise DataError(f"{name} = {values[row]}", where=table.where(row, name), cure=cure)
    metres = [*columns[1:4], ("range_m", np.where(np.isfinite(table.range_m), table.range_m, 0.0))]
    for name, values in metres:
        row = _first(np.abs(values) > METRES_LIMIT)
        if row is not None:
            raise DataError(
                f"{name} = {values[row]:g} is more than {METRES_LIMIT:g} m: millimetres?",
                where=table.where(row, name),
                cure="divide by 1000, positions and ranges are in metres",
            )
    row = _first(np.isfinite(table.range_m) & (table.range_m < 0.0))
    if row is not None:
        cure = "a range is >= 0; too close is '-inf', faulty is 'nan', no echo is empty"
        raise DataError(f"range_m = {table.range_m[row]:g}", where=table.where(row, "range_m"), cure=cure)
    _check_optional(table)


def _check_optional(table: ReadingTable) -> None:
    if table.sigma_m is not None:
        row = _first(~np.isnan(table.sigma_m) & ~((table.sigma_m > 0.0) & np.isfinite(table.sigma_m)))
        if row is not None:
            raise DataError(
                f"sigma_m = {table.sigma_m[row]:g}",
                where=table.where(row, "sigma_m"),
                cure="give a standard deviation > 0, or leave it empty",
            )
    if table.amplitude is not None:
        row = _first(~np.isnan(table.amplitude) & ~((table.amplitude >= 0.0) & np.isfinite(table.amplitude)))
        if row is not None:
            raise DataError(
                f"amplitude = {table.amplitude[row]:g}",
                where=table.where(row, "amplitude"),
                cure="give the strength of the echo (1: a facing plate), or leave it empty",
            )


def _unit_axes(table: ReadingTable) -> FloatArray:
    norm = np.linalg.norm(table.axis, axis=1)
    row = _first(np.abs(norm - 1.0) > _UNIT_TOLERANCE)
    if row is not None:
        raise DataError(
            f"the sensor axis has length {norm[row]:.6g}",
            where=table.where(row, "ax"),
            cure="give a unit vector (ax, ay, az) along the beam",
        )
    # Axes that are already exact keep their bits, so that export and import are inverse to one another.
    return np.where(np.abs(norm - 1.0)[:, None] > _EXACT_UNIT, table.axis / norm[:, None], table.axis)


def _assumed_specs(table: ReadingTable, assumed: AssumedSensor, warnings: list[str]) -> tuple[SensorSpec, ...]:
    echoes = table.range_m[np.isfinite(table.range_m)]
    range_max = max(assumed.range_max_m, float(echoes.max(initial=0.0)) * 1.05)
    warnings.append(
        f"no {table.source.sensors_name}: every sensor is taken for ultrasonic with a full beam angle of "
        f"{math.degrees(assumed.beam_full_angle_rad):g} degrees, range {assumed.range_min_m:g} to {range_max:g} m, "
        f"sigma {assumed.sigma_m * 1e3:g} mm"
    )
    return tuple(
        SensorSpec(
            name=name,
            kind="ultrasonic",
            range_min_m=assumed.range_min_m,
            range_max_m=range_max,
            beam_full_angle_rad=assumed.beam_full_angle_rad,
            sigma_m=assumed.sigma_m,
        )
        for name in dict.fromkeys(table.sensor)
    )


def _sensor_numbers(table: ReadingTable, specs: tuple[SensorSpec, ...]) -> IntArray:
    number = {spec.name: i for i, spec in enumerate(specs)}
    try:
        return np.array([number[name] for name in table.sensor], dtype=np.int64)
    except KeyError as error:
        name = str(error.args[0])
        raise DataError(
            f"sensor '{name[:40]}' is not in {table.source.sensors_name}",
            where=table.where(table.sensor.index(name), "sensor"),
            cure=f"add a table for it; {nearest(name[:40], number)}",
        ) from error


def _ranges(table: ReadingTable, warnings: list[str]) -> tuple[FloatArray, IntArray]:
    """Ranges with their status; a reading is an echo only when both its range and its own status say so."""
    implied = status_of_range(table.range_m)
    if table.status is None:
        return table.range_m, implied
    given = np.where(table.status == UNKNOWN_STATUS, implied, table.status)
    status = np.where(given == int(Status.OK), implied, given)
    contradicting = int(np.sum(given != implied))
    if contradicting:
        warnings.append(f"{contradicting} readings have a status that contradicts their range; they count as no echoes")
    value = np.array([np.nan, np.inf, -np.inf, np.nan])
    return np.where(status == int(Status.OK), table.range_m, value[status]), status


def _order(table: ReadingTable, sensor: IntArray, warnings: list[str]) -> IntArray:
    """Rows in the order of their times, without repetitions.

    Raises
    ------
    DataError : two different readings of one sensor at one time.
    """
    backwards = int(np.sum(np.diff(table.t_s) < 0.0))
    order = np.argsort(table.t_s, kind="stable") if backwards else np.arange(len(table.t_s))
    if backwards:
        warnings.append(f"the time goes back {backwards} times; the readings are put in the order of their times")
    by_key = order[np.lexsort((order, sensor[order], table.t_s[order]))]
    same = (np.diff(table.t_s[by_key]) == 0.0) & (np.diff(sensor[by_key]) == 0)
    if not np.any(same):
        return order
    earlier, later = by_key[:-1][same], by_key[1:][same]
    content = np.column_stack([table.position_m, table.axis, table.range_m])
    row = _first(~np.all((content[earlier] == content[later]) | np.isnan(content[later]), axis=1))
    if row is not None:
        pair = table.source.row_names(int(earlier[row]), int(later[row]))
        raise DataError(
            f"sensor '{table.sensor[int(later[row])]}' has two different readings at t = {table.t_s[later[row]]:g} "
            f"({pair})",
            where=table.source.name,
            cure="give every reading its own time, or remove one of the two",
        )
    warnings.append(f"{len(later)} readings are repeated (same sensor, same time); each is used once")
    return order[~np.isin(order, later)]
