"""Single readings in the order of time, whatever log they come from, made into a scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surfuse.geometry.poses import FloatArray, inverse, transform_points
from surfuse.records import IntArray, ReadingColumns, Readings, SensorSpec, Status
from surfuse.runs.range_correction import RangeCorrection, corrected_m, correction_note, corrects, shifts
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.side_files import GivenPart
from surfuse.runs.sweep_grouping import estimate_part_frame, grip_poses, group_by_repeat, row_numbers, sweep_means
from surfuse.runs.zone_distance import contradicted


@dataclass(frozen=True, eq=False)
class SingleReadings:
    """Readings in the order of time; `stop` (N,) is None when the log does not number its stops.

    `columns` has N rows; `specs` and `corrections` have one entry a sensor (no corrections at all: none is needed).
    They are not yet applied.
    """

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


def assemble(
    single: SingleReadings,
    part: GivenPart,
    warnings: list[str],
    sensors_name: str = "sensors.toml",
    frame_name: str = "frame.toml",
) -> ScanLog:
    """Group readings into sweeps and scan lines, in the part frame given or estimated.

    `sensors_name` and `frame_name` say in the warnings where sensors and frame come from, or could.

    Raises
    ------
    DataError : no frame is given, and none can be estimated.
    """
    rows, start, stops = _sweeps(single)
    columns = replace(single.columns, range_m=_corrected(single, warnings, sensors_name)).take(rows)
    position, axis = columns.position_m, columns.axis
    if part.world_from_part is None:
        towards = axis.mean(axis=0)
        world_from_part = estimate_part_frame(sweep_means(start, position), towards, single.columns.range_m)
        warnings.append(f"no {frame_name}: the part frame is estimated from the readings")
    else:
        world_from_part = part.world_from_part
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
        frame_estimated=part.world_from_part is None,
        outline=part.outline,
        warnings=tuple(warnings),
    )


def _corrected(single: SingleReadings, warnings: list[str], sensors_name: str) -> FloatArray:
    """Ranges (N,) with the calibration of their sensors taken out; what is no number stays what it is."""
    columns = single.columns
    if not corrects(single.corrections):
        return columns.range_m
    warnings += contradicted(columns.position_m, columns.axis, columns.range_m, columns.sensor, single.corrections)
    if not shifts(single.corrections):
        return columns.range_m
    warnings.append(correction_note(sensors_name, single.corrections))
    return corrected_m(columns.range_m, columns.sensor, single.corrections)


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
