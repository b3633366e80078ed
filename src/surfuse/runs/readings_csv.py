"""The readings CSV and the files beside it: import into a scan, export back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from surfuse import durable
from surfuse.errors import DataError, nearest
from surfuse.geometry.poses import FloatArray
from surfuse.records import BoolArray, FusionScene, IntArray, ReadingColumns, Readings, SensorSpec, Status
from surfuse.runs.assembly import SingleReadings, assemble, status_of_range
from surfuse.runs.csv_source import OPTIONAL, REQUIRED
from surfuse.runs.csv_table import UNKNOWN_STATUS, CsvTable, read_csv_table
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.side_files import METRES_LIMIT, frame_toml, outline_csv, read_corrections, read_sensors, sensors_toml

_UNIT_TOLERANCE = 1e-3
_EXACT_UNIT = 1e-9


def read_readings_csv(
    path: Path,
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
    assumed: AssumedSensor | None = None,
) -> ScanLog:
    """Read a readings CSV; side files that are not given are looked for beside it.

    Rows are put in the order of their times, exact repetitions of a row are dropped; both are told in the warnings.
    The axes are made unit length. Without frame.toml the part frame is estimated, see `estimate_part_frame`.

    Raises
    ------
    DataError, ConfigError : what cannot be used, with file, line and column.
    StorageError : a file cannot be read.
    """
    table = read_csv_table(path)
    warnings: list[str] = []
    _check_poses(table)
    sensors_file = _beside(path, sensors, "sensors.toml")
    specs = _specs(table, sensors_file, assumed or AssumedSensor(), warnings)
    sensor = _sensor_numbers(table, specs)
    range_m, status = _ranges(table, warnings)
    axis = _unit_axes(table)
    rows = _order(table, sensor, warnings)
    unknown = np.full(len(rows), np.nan)
    columns = ReadingColumns(
        t_s=table.t_s[rows],
        sensor=sensor[rows],
        position_m=table.position_m[rows],
        axis=axis[rows],
        range_m=range_m[rows],
        status=status[rows],
        amplitude=unknown if table.amplitude is None else table.amplitude[rows],
        sigma_m=unknown if table.sigma_m is None else table.sigma_m[rows],
    )
    single = SingleReadings(
        specs=specs,
        columns=columns,
        stop=None if table.stop is None else table.stop[rows],
        corrections=() if sensors_file is None else read_corrections(sensors_file),
    )
    return assemble(single, _beside(path, frame, "frame.toml"), _beside(path, outline, "outline.csv"), warnings)


def _beside(path: Path, given: Path | None, name: str) -> Path | None:
    if given is not None:
        return given
    beside = path.with_name(name)
    return beside if beside.is_file() else None


def _first(wrong: BoolArray) -> int | None:
    rows = np.flatnonzero(wrong)
    return int(rows[0]) if len(rows) else None


def _check_poses(table: CsvTable) -> None:
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


def _check_optional(table: CsvTable) -> None:
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


def _unit_axes(table: CsvTable) -> FloatArray:
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


def _specs(table: CsvTable, path: Path | None, assumed: AssumedSensor, warnings: list[str]) -> tuple[SensorSpec, ...]:
    if path is not None:
        return read_sensors(path)
    echoes = table.range_m[np.isfinite(table.range_m)]
    range_max = max(assumed.range_max_m, float(echoes.max(initial=0.0)) * 1.05)
    warnings.append(
        f"no sensors.toml: every sensor is taken for ultrasonic with a full beam angle of "
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


def _sensor_numbers(table: CsvTable, specs: tuple[SensorSpec, ...]) -> IntArray:
    number = {spec.name: i for i, spec in enumerate(specs)}
    try:
        return np.array([number[name] for name in table.sensor], dtype=np.int64)
    except KeyError as error:
        name = str(error.args[0])
        raise DataError(
            f"sensor '{name[:40]}' is not in sensors.toml",
            where=table.where(table.sensor.index(name), "sensor"),
            cure=f"add a table for it; {nearest(name[:40], number)}",
        ) from error


def _ranges(table: CsvTable, warnings: list[str]) -> tuple[FloatArray, IntArray]:
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


def _order(table: CsvTable, sensor: IntArray, warnings: list[str]) -> IntArray:
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
        lines = table.source.line_of(int(earlier[row])), table.source.line_of(int(later[row]))
        raise DataError(
            f"sensor '{table.sensor[int(later[row])]}' has two different readings at t = {table.t_s[later[row]]:g} "
            f"(lines {lines[0]} and {lines[1]})",
            where=str(table.source.path),
            cure="give every reading its own time, or remove one of the two",
        )
    warnings.append(f"{len(later)} readings are repeated (same sensor, same time); each is used once")
    return order[~np.isin(order, later)]


def write_readings_csv(path: Path, readings: Readings, scene: FusionScene | None, *, overwrite: bool = False) -> None:
    """Write readings as CSV with sensors.toml and, given the scene, frame.toml and outline.csv beside it.

    Reading the files back gives the same numbers to the last bit (counts of pings and joint positions have no column).

    Raises
    ------
    StorageError : a file exists and `overwrite` is false, or the disk refused.
    """
    files = {path: _csv_text(readings), path.with_name("sensors.toml"): sensors_toml(readings.specs)}
    if scene is not None:
        files[path.with_name("frame.toml")] = frame_toml(scene.world_from_part)
        if scene.outline is not None:
            files[path.with_name("outline.csv")] = outline_csv(scene.outline)
    for name in files:
        durable.refuse_existing(name, overwrite)
    for name, text in files.items():
        durable.write_text(name, text, overwrite=overwrite)


def _csv_text(readings: Readings) -> str:
    """One row a reading; numbers in the shortest form that reads back exactly."""
    names = [_quoted(spec.name) for spec in readings.specs]
    stops = np.repeat(readings.stop, np.diff(readings.start)).tolist()
    words = {int(status): status.name.lower() for status in Status}
    rows = zip(
        readings.t_s.tolist(),
        readings.sensor.tolist(),
        readings.position_m.tolist(),
        readings.axis.tolist(),
        readings.range_m.tolist(),
        readings.status.tolist(),
        readings.sigma_m.tolist(),
        readings.amplitude.tolist(),
        stops,
        strict=True,
    )
    lines = [",".join(REQUIRED + OPTIONAL)]
    for t, sensor, (px, py, pz), (ax, ay, az), range_m, status, sigma, amplitude, stop in rows:
        lines.append(
            f"{t!r},{names[sensor]},{px!r},{py!r},{pz!r},{ax!r},{ay!r},{az!r},{range_m!r},{words[status]},"
            f"{_optional(sigma)},{_optional(amplitude)},{stop}"
        )
    return "\n".join(lines) + "\n"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(mark in name for mark in ',"\n\r') else name


def _optional(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
