"""Errors of ranges against a known surface, by angle of incidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import LIGHT_KINDS, FloatArray, IntArray, Readings, Status
from surfuse.surface.beam_average import averaged_ranges
from surfuse.surface.casting import RayCaster
from surfuse.surface.time_lag import moved_poses

BAND_DEG = 10.0
LEAST_ECHOES = 20
BELONGS_M = 0.10
"""An echo farther than this from where the surface is comes from something else."""


@dataclass(frozen=True)
class IncidenceError:
    """Ranges minus distances along the axis (m) for one band of incidence.

    The band reaches from `low_deg` to `high_deg`; `scatter_m` is the robust standard deviation about the median,
    `echoes` says of how many.
    """

    low_deg: float
    high_deg: float
    echoes: int
    median_m: float
    scatter_m: float


def errors_by_incidence(
    readings: Readings, mesh: tuple[FloatArray, IntArray], lag_s: float = 0.0, beams: bool = False
) -> tuple[IncidenceError, ...]:
    """Errors of the echoes that point at a mesh (world frame), with the poses of t + lag, in bands of 10 degrees.

    With a lag other than 0 the offset that all ranges share (their median error) is taken out too. With `beams` the
    range of an optical sensor is compared with the mean over its beam instead of the distance along its axis.

    `mesh` are vertices (V, 3) in m and triangles (F, 3). Bands with fewer than `LEAST_ECHOES` are left out.
    """
    rows = np.flatnonzero((readings.status == int(Status.OK)) & np.isfinite(readings.range_m))
    place, axis = (values[rows] for values in moved_poses(readings, lag_s))
    caster = RayCaster(*mesh)
    along = caster.ranges(place, axis)
    expected = _expected(readings, rows, caster, place, axis, along) if beams else along
    with np.errstate(invalid="ignore"):
        error = readings.range_m[rows] - expected
    # The same echoes count with and without the beam: those whose axis meets the mesh.
    belongs = np.isfinite(along) & (
        np.abs(readings.range_m[rows] - np.where(np.isfinite(along), along, 0.0)) <= BELONGS_M
    )
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


def _expected(
    readings: Readings, rows: IntArray, caster: RayCaster, place: FloatArray, axis: FloatArray, along_m: FloatArray
) -> FloatArray:
    """What each echo should read: the mean over the beam of an optical sensor, else the distance along the axis."""
    specs, sensor = readings.specs, readings.sensor[rows]
    optical = np.array([spec.kind in LIGHT_KINDS for spec in specs])[sensor] & np.isfinite(along_m)
    half = np.array([0.5 * spec.beam_full_angle_rad for spec in specs])[sensor]
    expected = along_m.copy()
    expected[optical] = averaged_ranges(caster, place[optical], axis[optical], half[optical])[0]
    return expected


@dataclass(frozen=True)
class PlaneError:
    """A plane fitted to echoes against the true one: angle between the normals (rad), distance at the centre (m).

    `echoes` says how many of them the plane rests on.
    """

    angle_rad: float
    distance_m: float
    echoes: int


def fitted_plane(
    readings: Readings, mesh: tuple[FloatArray, IntArray], lag_s: float = 0.0, rounds: int = 10
) -> PlaneError | None:
    """The plane through the echoes that belong to a flat mesh (world frame), with the poses of t + lag.

    Total least squares, repeated without what is farther than 3 robust sigma; None with fewer than 20 echoes. The
    distance counts from the centre of the mesh, positive on the side of the sensors.

    `mesh` are vertices (V, 3) in m and triangles (F, 3); `rounds` bounds the repetitions.
    """
    rows = np.flatnonzero((readings.status == int(Status.OK)) & np.isfinite(readings.range_m))
    place, axis = (values[rows] for values in moved_poses(readings, lag_s))
    error = readings.range_m[rows] - RayCaster(*mesh).ranges(place, axis)
    belongs = np.isfinite(error) & (np.abs(error) <= BELONGS_M)
    if int(belongs.sum()) < LEAST_ECHOES:
        return None
    hits = (place + readings.range_m[rows, None] * axis)[belongs]
    kept = np.ones(len(hits), dtype=np.bool_)
    centre, normal = hits.mean(axis=0), np.zeros(3)
    for _ in range(rounds):
        centre = hits[kept].mean(axis=0)
        normal = np.linalg.svd(hits[kept] - centre, full_matrices=False)[2][-1]
        off = (hits - centre) @ normal
        kept = np.abs(off) <= 3.0 * max(1.4826 * float(np.median(np.abs(off))), 1e-9)
    a, b, c = mesh[0][mesh[1][0]]
    true = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    towards = np.sign((np.median(place, axis=0) - mesh[0].mean(axis=0)) @ normal)
    distance = float((centre - mesh[0].mean(axis=0)) @ normal * towards)
    return PlaneError(float(np.arccos(min(1.0, abs(float(true @ normal))))), distance, int(kept.sum()))
