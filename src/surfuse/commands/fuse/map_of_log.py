"""From a log to a map in memory: the log that can be fused, the grid of its map, and the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.commands.outcome import Watcher
from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.interfaces import FusionMethod
from surfuse.records import FusionResult, MapGrid, Status, SurfaceMap
from surfuse.runs.odd_sensors import odd_sensors
from surfuse.runs.scan_log import ScanLog, faulty_sensors, few_echoes, require_echoes
from surfuse.runs.scan_source import LogSource
from surfuse.surface.gridding import lattice
from surfuse.surface.resample import thinned


def fused(scan: ScanLog, method: FusionMethod, grid: MapGrid) -> tuple[FusionResult, SurfaceMap]:
    """Points and map of a scan by a method, on a grid, or on a finer one with its nodes where more is known.

    A step that the user asked for is kept.
    """
    result = method.replay(scan.scene(), scan.readings, grid)
    surface = surface_of(result, grid, method.name, scan.outline)
    if scan.step_m is not None:
        surface = thinned(surface, grid)
        result = replace(result, surface=surface)
    return result, surface


def grid_of(scan: ScanLog) -> MapGrid:
    """The grid of the places on the part that the scan's stops look at, in its part frame.

    A wrist turned by 30 degrees stands a quarter of a metre beside what it looks at: the stops are followed along the
    grip axis by the median range.
    """
    if scan.targets_uv_m is not None:
        return lattice(scan.targets_uv_m, scan.world_from_part)
    readings = scan.readings
    heard = readings.range_m[(readings.status == int(Status.OK)) & np.isfinite(readings.range_m)]
    typical = float(np.median(heard)) if len(heard) else 0.0
    seen = readings.world_from_grip[:, :3, 3] + typical * readings.world_from_grip[:, :3, 2]
    return lattice(transform_points(inverse(scan.world_from_part), seen)[:, :2], scan.world_from_part, scan.step_m)


def opened(source: LogSource, watcher: Watcher) -> ScanLog:
    """A log that can be fused; what was odd about it is told."""
    scan = source.load()
    require_echoes(scan.readings, str(source.log))
    readings = scan.readings
    names = [spec.name for spec in readings.specs]
    few = few_echoes(readings.status, faulty_sensors(readings.status, readings.sensor, names))
    odd = (*([] if few is None else [few]), *odd_sensors(readings))
    scan = replace(scan, warnings=(*scan.warnings, *odd))
    for warning in scan.warnings:
        watcher.warn(warning)
    return scan


def require_cells(surface: SurfaceMap, where: str) -> None:
    """Refuse a map without a single value.

    Raises
    ------
    DataError : no cell has a value; `where` names the readings.
    """
    if not surface.mask.any():
        raise DataError(
            f"method '{surface.method}' found no cell that it could give a value",
            cure="check the part frame, the outline and the sensors' limits, or try another method",
            where=where,
        )
