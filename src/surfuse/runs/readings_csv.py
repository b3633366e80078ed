"""The readings CSV and the files beside it: import into a scan, export back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from surfuse import durable
from surfuse.records import FusionScene, Readings, Status
from surfuse.runs.csv_source import OPTIONAL, REQUIRED
from surfuse.runs.csv_table import read_csv_table
from surfuse.runs.reading_table import scan_of_table
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.side_files import (
    frame_toml,
    outline_csv,
    read_described_sensors,
    read_part,
    sensors_toml,
)


def read_readings_csv(
    path: Path,
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
    assumed: AssumedSensor | None = None,
) -> ScanLog:
    """Read a readings CSV; side files that are not given are looked for beside it. See `scan_of_table`.

    Raises
    ------
    DataError, ConfigError : what cannot be used, with file, line and column.
    StorageError : a file cannot be read.
    """
    table = read_csv_table(path)
    sensors_file = _beside(path, sensors, "sensors.toml")
    described = () if sensors_file is None else read_described_sensors(sensors_file)
    part = read_part(_beside(path, frame, "frame.toml"), _beside(path, outline, "outline.csv"))
    return scan_of_table(table, described, part, assumed or AssumedSensor())


def _beside(path: Path, given: Path | None, name: str) -> Path | None:
    if given is not None:
        return given
    beside = path.with_name(name)
    return beside if beside.is_file() else None


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
