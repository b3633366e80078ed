"""The LOG of a command: a run folder, an MCAP file or bag of anyone, or a readings CSV; always the same scan."""

from __future__ import annotations

from pathlib import Path

from surfuse.errors import DataError
from surfuse.runs.foreign_log import read_foreign_log
from surfuse.runs.log_files import log_segments
from surfuse.runs.log_reader import is_own_log, read_log
from surfuse.runs.log_records import Damage
from surfuse.runs.readings_csv import read_readings_csv
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.tof_vicon import is_tof_vicon, read_tof_vicon

CSV_NAME = "readings.csv"


def load_scan(
    path: Path,
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
    assumed: AssumedSensor | None = None,
) -> ScanLog:
    """Read the readings, sensors, part frame and outline of a log; the side files are for logs that are not ours.

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
        return read_tof_vicon(path).scan
    if path.is_file() and path.suffix.lower() in (".csv", ".txt", ".tsv"):
        return read_readings_csv(path, sensors, frame, outline, assumed)
    if path.is_file() and path.suffix.lower() != ".mcap":
        raise DataError(
            f"'{path.suffix}' is no kind of log", where=str(path), cure="give a run folder, an .mcap or a .csv file"
        )
    log_segments(path)
    if is_own_log(path):
        return own_scan(path)
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
    return ScanLog(
        readings=log.readings(),
        world_from_part=log.scene.world_from_part,
        frame_estimated=False,
        outline=log.scene.outline,
        depth_max_m=log.scene.depth_max_m,
        warnings=notes,
        targets_uv_m=None if log.plan is None else log.plan.uv_m,
    )
