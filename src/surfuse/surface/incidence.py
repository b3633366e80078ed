"""Errors of ranges against a known surface, by angle of incidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import FloatArray, IntArray, Readings, Status
from surfuse.surface.casting import RayCaster
from surfuse.surface.time_lag import moved_poses

BAND_DEG = 10.0
LEAST_ECHOES = 20
BELONGS_M = 0.10
"""An echo farther than this from where the surface is comes from something else."""


@dataclass(frozen=True)
class IncidenceError:
    """Ranges minus distances along the axis for one band of incidence: median, robust scatter, echoes."""

    low_deg: float
    high_deg: float
    echoes: int
    median_m: float
    scatter_m: float


def errors_by_incidence(
    readings: Readings, mesh: tuple[FloatArray, IntArray], lag_s: float = 0.0
) -> tuple[IncidenceError, ...]:
    """Errors of the echoes that point at a mesh (world frame), with the poses of t + lag, in bands of 10 degrees.

    With a lag other than 0 the offset that all ranges share (their median error) is taken out too.
    """
    rows = np.flatnonzero((readings.status == int(Status.OK)) & np.isfinite(readings.range_m))
    place, axis = (values[rows] for values in moved_poses(readings, lag_s))
    caster = RayCaster(*mesh)
    error = readings.range_m[rows] - caster.ranges(place, axis)
    belongs = np.isfinite(error) & (np.abs(error) <= BELONGS_M)
    if not np.any(belongs):
        return ()
    error = error[belongs] - (float(np.median(error[belongs])) if lag_s != 0.0 else 0.0)
    angle = caster.incidence_deg(place[belongs], axis[belongs])
    found = []
    for low in np.arange(0.0, 90.0, BAND_DEG):
        here = error[(angle >= low) & (angle < low + BAND_DEG)]
        if len(here) >= LEAST_ECHOES:
            middle = float(np.median(here))
            scatter = 1.4826 * float(np.median(np.abs(here - middle)))
            found.append(IncidenceError(float(low), float(low + BAND_DEG), len(here), middle, scatter))
    return tuple(found)
