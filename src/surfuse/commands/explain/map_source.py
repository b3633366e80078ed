"""The readings that a map was made from: the run's own log, or the one that its run.toml names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.maps.map_files import map_path, read_map
from surfuse.errors import DataError
from surfuse.exporters import nc
from surfuse.records import FusedPoints, FusionScene, Readings, SurfaceMap
from surfuse.runs.configuration import read_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_files import segment_paths
from surfuse.runs.scan_source import LogSource, source_of_table
from surfuse.settings import FusionSettings


@dataclass(frozen=True)
class MapSource:
    """A map, its fused points, the readings behind them, and what fusion knew before.

    `log` is where the readings were read from, None when they never were in a file of their own.
    """

    surface: SurfaceMap
    points: FusedPoints
    readings: Readings
    log: Path | None
    scene: FusionScene
    fusion: FusionSettings


def source_of(path: Path, log: Path | None = None) -> MapSource:
    """Map, points and readings of a map file or a run folder; `log` when the readings lie elsewhere.

    Raises
    ------
    DataError : the map keeps no points, its readings are not found, or they are not those of the map.
    """
    file = map_path(path)
    if file.suffix.lower() not in nc.SUFFIXES:
        raise DataError(f"'{file.suffix}' keeps no readings", where=str(file), cure="give the run or its surface.nc")
    surface, points = read_map(file), nc.read_points(file)
    if points is None:
        raise DataError("the map keeps no fused points", where=str(file), cure="give the surface.nc of a run")
    source = LogSource(log) if log is not None else _log_of(RunFolder(file.parent), file)
    scan, found = source.load(), source.log
    readings = scan.readings
    same = (
        readings.n_sweeps == len(points)
        and np.array_equal(readings.start, points.start)
        and np.array_equal(readings.stop, points.stop)
        and np.array_equal(readings.sensor, points.sensor)
    )
    if not same:
        raise DataError(
            f"{readings.n_sweeps} sweeps in the log, {len(points)} in the map: it was made from other readings",
            where=str(found),
            cure="give the log that the map was made from with --log, or fuse again",
        )
    return MapSource(surface, points, readings, found, scan.scene(), _fusion_of(RunFolder(file.parent)))


def _fusion_of(run: RunFolder) -> FusionSettings:
    """The parameters of the methods that the run was made with; the defaults for a map without a run.toml."""
    if not run.configuration.is_file():
        return FusionSettings()
    tables, _ = read_configuration(run.configuration)
    return FusionSettings.model_validate(tables.get("fusion", {}))


def _log_of(run: RunFolder, file: Path) -> LogSource:
    if run.log.is_dir() and segment_paths(run.log):
        return LogSource(run.path)
    cure = "give the log that the map was made from with --log"
    if not run.configuration.is_file():
        raise DataError("neither a log nor a run.toml lies beside the map", where=str(file), cure=cure)
    found = source_of_table(read_configuration(run.configuration)[0].get("source"))
    if found is None:
        raise DataError("run.toml names no source.log", where=str(run.configuration), cure=cure)
    if not found.log.exists():
        raise DataError(f"the log '{found.log}' is no longer there", where=str(run.configuration), cure=cure)
    return found
