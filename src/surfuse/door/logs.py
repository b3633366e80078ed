"""Readings to fuse: from a file, or from arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy.typing as npt

from surfuse.door.arguments import FilePath, path_of, shown
from surfuse.door.array_table import NAME, part_of_arrays, table_of_arrays, with_optional
from surfuse.door.sensor import Sensor, described, sensor_of
from surfuse.errors import UsageError
from surfuse.records import FloatArray, Readings
from surfuse.runs.reading_table import scan_of_table
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import DescribedSensor


class Frame(NamedTuple):
    """The part frame in the frame of the readings: its origin (3,) in m, unit vectors along u and v (3,)."""

    origin: FloatArray
    u: FloatArray
    v: FloatArray


@dataclass(frozen=True, eq=False)
class Log:
    """Readings with all that is known before the fusion; made by `read` and `log`.

    `scan` is the record that the stages take; `path` the file or folder that was read, None for arrays.
    """

    scan: ScanLog
    path: Path | None = None

    @property
    def readings(self) -> Readings:
        """The readings in columns, sweep after sweep."""
        return self.scan.readings

    @property
    def sensors(self) -> dict[str, Sensor]:
        """The sensors by name, in the order of their numbers in `readings.sensor`."""
        return {spec.name: sensor_of(spec) for spec in self.readings.specs}

    @property
    def frame(self) -> Frame:
        """The part frame: as given, or an estimate (see `frame_estimated`)."""
        pose = self.scan.world_from_part
        return Frame(pose[:3, 3], pose[:3, 0], pose[:3, 1])

    @property
    def frame_estimated(self) -> bool:
        """Whether nobody gave the part frame."""
        return self.scan.frame_estimated

    @property
    def outline(self) -> FloatArray | None:
        """Vertices (K, 2) of the part's outline, u and v in m of the part frame; None when it is unknown."""
        return None if self.scan.outline is None else self.scan.outline.vertices_m

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was repaired, assumed or left out while reading, a sentence each."""
        return self.scan.warnings

    @property
    def name(self) -> str:
        """The file, or `sf.log`, for messages."""
        return NAME if self.path is None else str(self.path)

    def __len__(self) -> int:
        return len(self.readings.t_s)

    def __repr__(self) -> str:
        sensors = len(self.readings.specs)
        return f"<Log: {len(self)} readings of {sensors} sensors in {self.readings.n_sweeps} sweeps>"


def read(
    path: FilePath,
    sensors: FilePath | None = None,
    frame: FilePath | None = None,
    outline: FilePath | None = None,
) -> Log:
    """Read a log: a readings CSV, an MCAP file or ROS 2 bag, or a run folder.

    `sensors`, `frame` and `outline` are the files that describe the sensors, the part frame and the outline; beside a
    CSV sensors.toml, frame.toml and outline.csv are found without being named.

    Raises
    ------
    DataError, ConfigError : not there, not a log, or it cannot be used; the message says where and why.
    StorageError : a file cannot be read.
    """
    log_path = path_of(path, "path")
    beside = {"sensors": sensors, "frame": frame, "outline": outline}
    sensors_path, frame_path, outline_path = (
        None if value is None else path_of(value, name) for name, value in beside.items()
    )
    return Log(load_scan(log_path, sensors_path, frame_path, outline_path), log_path)


def log(
    t_s: npt.ArrayLike,
    sensor: npt.ArrayLike,
    position_m: npt.ArrayLike,
    axis: npt.ArrayLike,
    range_m: npt.ArrayLike,
    sensors: Mapping[str, Sensor] | None = None,
    *,
    status: npt.ArrayLike | None = None,
    sigma_m: npt.ArrayLike | None = None,
    amplitude: npt.ArrayLike | None = None,
    stop: npt.ArrayLike | None = None,
    frame: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None = None,
    outline: npt.ArrayLike | None = None,
) -> Log:
    """Make a log of N readings in arrays; the same numbers in a readings CSV give the same log, to the last bit.

    `t_s` (N,) s, `sensor` N names, `position_m` (N, 3) of the sensor and `axis` (N, 3), its unit direction, in one
    frame of the caller's; `range_m` (N,): +inf no echo, -inf too close, nan faulty. `sensors` describes the sensors by
    name (None: bare ultrasonic rangers are assumed, and a warning says so).

    `status` N words or codes of the CSV, `sigma_m` (N,) the readings' own standard deviations (nan: the sensor's),
    `amplitude` (N,) strengths of the echoes (1: a facing plate, nan: unknown), `stop` (N,) numbers of the stops (None:
    a new sweep begins when a sensor comes again). `frame` is (origin, u, v) of the part frame (None: estimated),
    `outline` (K, 2) the part's outline in it.

    Raises
    ------
    DataError, ConfigError : an array of another shape or type, or a value that cannot be used; the message names it.
    """
    required = table_of_arrays(t_s, sensor, position_m, axis, range_m)
    table = with_optional(required, status, sigma_m, amplitude, stop)
    part = part_of_arrays(frame, outline)
    return Log(scan_of_table(table, _described(sensors), part, AssumedSensor()))


def _described(sensors: Mapping[str, Sensor] | None) -> tuple[DescribedSensor, ...]:
    if sensors is None:
        return ()
    wrong = not isinstance(sensors, Mapping) or not all(isinstance(one, Sensor) for one in sensors.values())
    if wrong or not sensors:
        raise UsageError(f"sensors = {shown(sensors)}", cure='give a mapping {"name": sf.Sensor(kind=..., ...)}')
    return tuple(described(one, str(name), f"{NAME}: sensors['{name}']") for name, one in sensors.items())
