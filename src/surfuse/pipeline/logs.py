"""Logs by path: a run folder, an .mcap file of this or another program, or a readings CSV."""

from __future__ import annotations

from pathlib import Path

from surfuse.errors import DataError, StorageError, UsageError
from surfuse.runs.scan_log import ScanLog

CSV_NAME = "readings.csv"


def open_log(
    path: Path, sensors: Path | None = None, frame: Path | None = None, outline: Path | None = None
) -> ScanLog:
    """Read any log into readings, part frame and outline.

    Raises
    ------
    StorageError : no such file or folder.
    UsageError : neither a folder with a log nor a known suffix.
    DataError : the log holds what cannot be used.
    """
    if not path.exists():
        raise StorageError("no such file or folder", cure="give a run folder, an .mcap or a .csv", where=str(path))
    if path.is_dir() and (path / CSV_NAME).is_file():
        path = path / CSV_NAME
    if path.is_dir() or path.suffix.lower() == ".mcap":
        return _from_mcap(path)
    if path.suffix.lower() == ".csv":
        from surfuse.runs.readings_csv import read_readings_csv

        return read_readings_csv(path, sensors, frame, outline)
    raise UsageError(
        f"'{path.name}' is not a log", cure="give a run folder, an .mcap or a readings .csv (see the file reference)"
    )


def _from_mcap(path: Path) -> ScanLog:
    from surfuse.runs.log_reader import is_own_log, read_log

    if not is_own_log(path):
        from surfuse.runs.foreign_log import read_foreign_log

        return read_foreign_log(path)
    log = read_log(path)
    if log.scene is None or not log.sweeps:
        raise DataError("the log holds no sweep", cure="resume the run, or give another log", where=str(path))
    return ScanLog(
        readings=log.readings(),
        world_from_part=log.scene.world_from_part,
        frame_estimated=False,
        outline=log.scene.outline,
        depth_max_m=log.scene.depth_max_m,
        warnings=tuple(f"{damage.segment}: {damage.text}" for damage in log.damage),
        targets_uv_m=None if log.plan is None else log.plan.uv_m,
    )
