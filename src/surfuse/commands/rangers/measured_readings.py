"""Readings of a known surface in a recorded log, with what was true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from surfuse.commands.judge.truth_files import truth_mesh
from surfuse.errors import DataError, nearest
from surfuse.records import Readings, SensorSpec
from surfuse.rig.simulated.ranger_bench import KnownReadings, known_readings_of
from surfuse.runs.scan_source import load_scan
from surfuse.surface.casting import RayCaster
from surfuse.surface.truth import check_mesh


def readings_in_log(spec: SensorSpec, log: Path, truth: Path) -> KnownReadings:
    """The readings of a log whose axis meets the true surface; all sensors of the log when none has the spec's name.

    The mesh is in the frame of the log, in metres.

    Raises
    ------
    DataError : no readings, no mesh.
    """
    readings = load_scan(log).readings
    vertices, faces = truth_mesh(truth)
    check_mesh(vertices, faces, str(truth))
    caster = RayCaster(vertices, faces)
    names = [one.name for one in readings.specs]
    mine = np.ones(len(readings.t_s), dtype=np.bool_)
    if spec.name in names:
        mine = readings.sensor == names.index(spec.name)
    distance = caster.ranges(readings.position_m[mine], readings.axis[mine])
    met = np.isfinite(distance)
    incidence = np.radians(caster.incidence_deg(readings.position_m[mine], readings.axis[mine]))[met]
    found = known_readings_of(spec, distance[met], incidence, None, readings.range_m[mine][met])
    return replace(found, t_s=readings.t_s[mine][met])


def facing_readings(readings: Readings, distances_m: tuple[float, ...], spec: SensorSpec, where: str) -> KnownReadings:
    """Readings of a facing plate that stood at these distances one after the other, equally many at each.

    Raises
    ------
    DataError : no such sensor, or the readings cannot be shared out among the distances.
    """
    names, name = [one.name for one in readings.specs], spec.name
    if name not in names:
        raise DataError(f"no sensor '{name}' in the log", cure=nearest(name, names), where=where)
    mine = readings.sensor == names.index(name)
    count = int(mine.sum())
    if not distances_m or count < 2 * len(distances_m) or count % len(distances_m):
        raise DataError(
            f"{count} readings of '{name}' for {len(distances_m)} distances",
            cure="record equally many at each distance, at least two, and name the distances in that order",
            where=where,
        )
    axis_m = np.repeat(np.array(distances_m), count // len(distances_m))
    found = known_readings_of(spec, axis_m, np.zeros(count), None, readings.range_m[mine])
    return replace(found, t_s=readings.t_s[mine])
