"""Single readings in the order of time, whatever log they come from, made into a scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import FloatArray, inverse, transform_points
from surfuse.records import IntArray, ReadingColumns, Readings, SensorSpec, Status
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.side_files import RangeCorrection, read_frame, read_outline
from surfuse.runs.sweep_grouping import estimate_part_frame, grip_poses, group_by_repeat, row_numbers, sweep_means


@dataclass(frozen=True, eq=False)
class SingleReadings:
    """Readings in the order of time; `stop` (N,) is None when the log does not number its stops."""

    specs: tuple[SensorSpec, ...]
    columns: ReadingColumns
    stop: IntArray | None = None
    corrections: tuple[RangeCorrection, ...] = ()


def status_of_range(range_m: FloatArray) -> IntArray:
    """Status (N,) that a range implies by REP-117."""
    return np.select(
        [np.isnan(range_m), np.isposinf(range_m), np.isneginf(range_m)],
        [int(Status.FAULT), int(Status.NO_ECHO), int(Status.TOO_CLOSE)],
        default=int(Status.OK),
    ).astype(np.int64)


def assemble(single: SingleReadings, frame: Path | None, outline: Path | None, warnings: list[str]) -> ScanLog:
    """Group readings into sweeps and scan lines, in the part frame given or estimated.

    Raises
    ------
    DataError, ConfigError : the frame or the outline cannot be used, or an outline comes without a frame.
    """
    if outline is not None and frame is None:
        raise DataError("an outline without a part frame", where=str(outline), cure="add frame.toml beside it")
    rows, start, stops = _sweeps(single)
    columns = replace(single.columns, range_m=_corrected(single, warnings)).take(rows)
    position, axis = columns.position_m, columns.axis
    if frame is None:
        towards = axis.mean(axis=0)
        world_from_part = estimate_part_frame(sweep_means(start, position), towards, single.columns.range_m)
        warnings.append("no frame.toml: the part frame is estimated from the readings")
    else:
        world_from_part = read_frame(frame)
    poses = grip_poses(start, position, axis, world_from_part[:3, 0])
    readings = Readings(
        specs=single.specs,
        start=start,
        stop=stops,
        row=row_numbers(transform_points(inverse(world_from_part), poses[:, :3, 3])[:, :2]),
        world_from_grip=poses,
        **columns.by_name(),
    )
    return ScanLog(
        readings=readings,
        world_from_part=world_from_part,
        frame_estimated=frame is None,
        outline=None if outline is None else read_outline(outline, world_from_part),
        warnings=tuple(warnings),
    )


def _corrected(single: SingleReadings, warnings: list[str]) -> FloatArray:
    """Ranges (N,) with the calibration of their sensors taken out; what is no number stays what it is."""
    columns = single.columns
    if not any(one != RangeCorrection() for one in single.corrections):
        return columns.range_m
    offset = np.array([one.offset_m for one in single.corrections])[columns.sensor]
    scale = np.array([one.scale for one in single.corrections])[columns.sensor]
    warnings.append("sensors.toml holds a calibration: offset and scale are taken out of the ranges")
    return np.asarray((columns.range_m - offset) / scale, dtype=np.float64)


def _sweeps(single: SingleReadings) -> tuple[IntArray, IntArray, IntArray]:
    """Rows sweep after sweep (N,), where each sweep starts (M + 1,), and the numbers of the stops (M,).

    Sweeps come in the order of their first reading; the rows of one stop belong together wherever they are.
    """
    if single.stop is None:
        sweep = group_by_repeat(single.columns.sensor)
        stops = np.arange(int(sweep[-1]) + 1)
    else:
        found, first, of_row = np.unique(single.stop, return_index=True, return_inverse=True)
        by_time = np.argsort(first)
        rank = np.empty(len(found), dtype=np.int64)
        rank[by_time] = np.arange(len(found))
        sweep, stops = rank[of_row], found[by_time]
    start = np.concatenate([[0], np.cumsum(np.bincount(sweep))]).astype(np.int64)
    return np.argsort(sweep, kind="stable"), start, stops
