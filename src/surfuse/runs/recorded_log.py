"""A log of ours whose arm was moved by somebody else: it has no plan, so lines, part frame and step come from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from surfuse.errors import SurfuseError
from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.geometry.sensor_array import step_m
from surfuse.records import FloatArray, FusionScene, IntArray, Readings
from surfuse.runs.configuration import read_configuration
from surfuse.runs.log_records import RunLog
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.sweep_grouping import estimate_part_frame, row_numbers

RECORDED = "record"
"""Source of the event that marks such a log."""

_SWEEPS_FOR_STEP = 100


def is_recorded(log: RunLog) -> bool:
    """Whether somebody else moved the arm."""
    return any(event.source == RECORDED for event in log.events)


def recorded_scan(log: RunLog, scene: FusionScene, wanted_m: float | None, notes: tuple[str, ...]) -> ScanLog:
    """The scan; its part frame is that of the area, which comes with an outline, else it is estimated.

    `wanted_m` is the step of the map, None: that of an acquisition with these sensors.

    Raises
    ------
    DataError : no frame is given, and none can be estimated.
    """
    readings = log.readings()
    given = scene.outline is not None
    frame = scene.world_from_part if given else estimated_frame(readings)
    notes = notes if given else (*notes, "no [area]: the part frame is estimated from the readings")
    return ScanLog(
        readings=replace(readings, row=_rows(readings, frame)),
        world_from_part=frame,
        frame_estimated=not given,
        outline=scene.outline,
        depth_max_m=scene.depth_max_m,
        warnings=notes,
        step_m=usual_step_m(readings) if wanted_m is None else wanted_m,
    )


def wanted_step_m(path: Path) -> float | None:
    """`scan.step_m` of the run folder `path`; None where it is not said, or the log lies alone."""
    configuration = path / "run.toml"
    if not configuration.is_file():
        return None
    try:
        scan = read_configuration(configuration)[0].get("scan")
    except SurfuseError:
        return None  # the readings can be fused without it
    step = scan.get("step_m") if isinstance(scan, dict) else None
    return float(step) if isinstance(step, int | float) else None


def estimated_frame(readings: Readings) -> FloatArray:
    """A part frame (4, 4) for what was seen.

    Raises
    ------
    DataError : the beams have no common direction.
    """
    grips = readings.world_from_grip
    return estimate_part_frame(grips[:, :3, 3], grips[:, :3, 2].mean(axis=0), readings.range_m)


def _rows(readings: Readings, world_from_part: FloatArray) -> IntArray:
    return row_numbers(transform_points(inverse(world_from_part), readings.world_from_grip[:, :3, 3])[:, :2])


def usual_step_m(readings: Readings) -> float:
    """The step of a planned scan with these sensors: the median over the first sweeps, to a tenth of a millimetre."""
    steps = []
    for j in range(min(readings.n_sweeps, _SWEEPS_FOR_STEP)):
        sweep = readings.sweep(j)
        grip_from_world = inverse(sweep.world_from_grip)
        place = transform_points(grip_from_world, sweep.position_m)
        steps.append(step_m(place, rotate_vectors(grip_from_world, sweep.axis)))
    return round(float(np.median(steps)), 4)
