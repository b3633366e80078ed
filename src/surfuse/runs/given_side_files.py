"""Sensors, part frame and outline that are given for a log which has its own: they correct it, or are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from surfuse.errors import DataError, nearest
from surfuse.geometry.poses import FloatArray, inverse, transform_points
from surfuse.records import Outline
from surfuse.runs.range_correction import RangeCorrection, corrected_m, correction_note, corrects, shifts
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.side_files import read_corrections, read_frame, read_outline, read_sensors
from surfuse.runs.sweep_grouping import row_numbers
from surfuse.runs.zone_distance import contradicted

_PARALLEL = 1e-9


def with_side_files(scan: ScanLog, sensors: Path | None, frame: Path | None, outline: Path | None) -> ScanLog:
    """The scan with the side files that are given, each in place of what the log says.

    `sensors` corrects the sensors that it names, with their calibration; all it names must be in the log. `frame` is
    another part frame: the outline as seen is carried over into it where that is possible. `outline` is in that frame.

    Raises
    ------
    DataError, ConfigError : a file cannot be used; a sensor that the log does not have.
    """
    if sensors is not None:
        scan = _with_sensors(scan, sensors)
    if frame is not None:
        scan = _with_frame(scan, read_frame(frame), keep_outline=outline is None)
    if outline is not None:
        scan = replace(scan, outline=read_outline(outline, scan.world_from_part))
    return scan


def _with_sensors(scan: ScanLog, path: Path) -> ScanLog:
    given = {spec.name: spec for spec in read_sensors(path)}
    calibrated = dict(zip(given, read_corrections(path), strict=True))
    names = [spec.name for spec in scan.readings.specs]
    for name in given:
        if name not in names:
            raise DataError(f"the log has no sensor '{name}'", where=str(path), cure=nearest(name, names))
    corrections = [calibrated.get(name, RangeCorrection()) for name in names]
    warnings = [f"{path.name} corrects {len(given)} of {len(names)} sensors"]
    readings = replace(scan.readings, specs=tuple(given.get(spec.name, spec) for spec in scan.readings.specs))
    if corrects(corrections):
        warnings += contradicted(
            readings.position_m, readings.axis, readings.range_m, readings.sensor, tuple(corrections)
        )
    if shifts(corrections):
        range_m = corrected_m(readings.range_m, readings.sensor, corrections)
        readings, note = replace(readings, range_m=range_m), correction_note(path.name, corrections)
        warnings.append(note)
    return replace(scan, readings=readings, warnings=(*scan.warnings, *warnings))


def _with_frame(scan: ScanLog, world_from_part: FloatArray, keep_outline: bool) -> ScanLog:
    """The scan in another part frame; where the plan wanted its stops is left to the readings then."""
    readings, warnings = scan.readings, list(scan.warnings)
    places = transform_points(inverse(world_from_part), readings.world_from_grip[:, :3, 3])[:, :2]
    outline = scan.outline
    if outline is not None and keep_outline:
        outline = moved_outline(outline, world_from_part)
        if outline is None:
            warnings.append("the outline of the log cannot be seen in the part frame given: it is left out")
    return replace(
        scan,
        readings=replace(readings, row=row_numbers(places)),
        world_from_part=world_from_part,
        frame_estimated=False,
        outline=outline,
        warnings=tuple(warnings),
        targets_uv_m=None,
    )


def moved_outline(outline: Outline, world_from_part: FloatArray) -> Outline | None:
    """The outline in another part frame (4, 4); None when it cannot be told there.

    One that was seen by a camera is seen from the same place on the new plane w = 0; any other can be moved to a plane
    that is parallel to its own.
    """
    new_from_old = inverse(world_from_part) @ outline.world_from_part
    if outline.viewpoint_m is None:
        if new_from_old[2, 2] < 1.0 - _PARALLEL:
            return None
        eye = None
    else:
        eye = transform_points(new_from_old, outline.viewpoint_m[None])[0]

    def moved(flat: FloatArray) -> FloatArray | None:
        points = transform_points(new_from_old, np.column_stack([flat, np.zeros(len(flat))]))
        if eye is None:
            return points[:, :2]
        if eye[2] <= 0.0 or np.any(points[:, 2] >= eye[2]):
            return None
        share = eye[2] / (eye[2] - points[:, 2])
        return np.asarray((eye + share[:, None] * (points - eye))[:, :2], dtype=np.float64)

    rings = [moved(ring) for ring in (outline.vertices_m, *outline.holes_m)]
    found = [ring for ring in rings if ring is not None]
    if len(found) < len(rings):
        return None
    return replace(
        outline, vertices_m=found[0], holes_m=tuple(found[1:]), world_from_part=world_from_part, viewpoint_m=eye
    )
