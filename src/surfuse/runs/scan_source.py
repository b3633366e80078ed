"""The LOG of a command: a run folder, an MCAP file or bag of anyone, or a readings CSV; always the same scan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surfuse.errors import DataError
from surfuse.runs.foreign_log import read_foreign_log
from surfuse.runs.given_side_files import with_side_files
from surfuse.runs.log_files import log_segments
from surfuse.runs.log_reader import is_own_log, read_log
from surfuse.runs.log_records import Damage
from surfuse.runs.readings_csv import read_readings_csv
from surfuse.runs.recorded_log import is_recorded, recorded_scan, wanted_step_m
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.tof_vicon import is_tof_vicon, read_tof_vicon

CSV_NAME = "readings.csv"
_SIDE_FILES = ("sensors", "frame", "outline")


@dataclass(frozen=True)
class LogSource:
    """A log and the side files that were given for it, as the table `source` of a run.toml names them.

    `sensors`, `frame` and `outline` are files that win over what the log says (None: the log's own).
    """

    log: Path
    sensors: Path | None = None
    frame: Path | None = None
    outline: Path | None = None

    def load(self) -> ScanLog:
        """Read it; see `load_scan`."""
        return load_scan(self.log, self.sensors, self.frame, self.outline)

    def table(self) -> dict[str, str]:
        """The table for a run.toml, with whole paths."""
        given = {"log": self.log, **{key: self.side_file(key) for key in _SIDE_FILES}}
        return {key: str(path.resolve()) for key, path in given.items() if path is not None}

    def side_file(self, key: str) -> Path | None:
        """The side file of that name."""
        return {"sensors": self.sensors, "frame": self.frame, "outline": self.outline}[key]


def source_of_table(table: object) -> LogSource | None:
    """The source that a run.toml names; None when it names no log."""
    if not isinstance(table, dict) or not isinstance(table.get("log"), str):
        return None
    files = [Path(value) if isinstance(value := table.get(key), str) else None for key in _SIDE_FILES]
    return LogSource(Path(table["log"]), *files)


def load_scan(
    path: Path,
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
    assumed: AssumedSensor | None = None,
) -> ScanLog:
    """Read the readings, sensors, part frame and outline of a log; side files that are given win over the log's own.

    A folder that holds a readings.csv means that file; one with time-of-flight frames and motion-capture poses is a
    recording of them.

    Raises
    ------
    DataError, ConfigError : not there, not a log, or it cannot be used; the message says why.
    StorageError : a file cannot be read.
    """
    if (path / CSV_NAME).is_file():
        path = path / CSV_NAME
    if is_tof_vicon(path):
        return with_side_files(read_tof_vicon(path).scan, sensors, frame, outline)
    if path.is_file() and path.suffix.lower() in (".csv", ".txt", ".tsv"):
        return read_readings_csv(path, sensors, frame, outline, assumed)
    if path.is_file() and path.suffix.lower() != ".mcap":
        raise DataError(
            f"'{path.suffix}' is no kind of log", where=str(path), cure="give a run folder, an .mcap or a .csv file"
        )
    log_segments(path)
    if is_own_log(path):
        return with_side_files(own_scan(path), sensors, frame, outline)
    return read_foreign_log(path, sensors, frame, outline, assumed)


def own_scan(path: Path) -> ScanLog:
    """The scan in a log of ours.

    Raises
    ------
    DataError : no scene or no sweep in it; what is damaged is named.
    """
    log = read_log(path)
    notes = tuple(f"{item.segment}: {item.text}" for item in log.damage if item.kind is not Damage.UNFINISHED)
    if log.scene is None or not log.sweeps:
        lost = "scene (sensors and part frame)" if log.scene is None else "complete sweep"
        because = f" ({notes[0]})" if notes else ""
        raise DataError(f"the log has no {lost}{because}", where=str(path), cure="acquire again, or 'surfuse resume'")
    if is_recorded(log):
        return recorded_scan(log, log.scene, wanted_step_m(path), notes)
    return ScanLog(
        readings=log.readings(),
        world_from_part=log.scene.world_from_part,
        frame_estimated=False,
        outline=log.scene.outline,
        depth_max_m=log.scene.depth_max_m,
        warnings=notes,
        targets_uv_m=None if log.plan is None else log.plan.uv_m,
    )
