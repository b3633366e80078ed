"""What a beam can meet of a known surface: the nearest point within every angle off its axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import BoolArray, FloatArray
from surfuse.surface.casting import RayCaster

RINGS_DEG = np.arange(0.5, 25.01, 0.5)
AZIMUTHS = 24
COVERED_RAD, ALONE_RAD = float(np.radians(4.0)), float(np.radians(12.0))


@dataclass(frozen=True)
class BeamView:
    """For N beams: range (N,) and incidence (N,) of their axis, and the nearest range (N, K) within each ring angle.

    `flat` (N,) says that the beam meets the plane that its axis meets out to 4 degrees, and no other out to 12.

    `axis_range_m` and `nearest_m` in m (+inf: nothing is met), `incidence_rad` (nan: nothing is met). The ring angles
    are `RINGS_DEG`.
    """

    axis_range_m: FloatArray
    incidence_rad: FloatArray
    nearest_m: FloatArray
    flat: BoolArray


def view(caster: RayCaster, origin_m: FloatArray, axis: FloatArray) -> BeamView:
    """Send fans of rays at a surface; +inf where nothing is met.

    `origin_m` (N, 3) in m and unit `axis` (N, 3) lie in the frame of the mesh.
    """
    along = caster.ranges(origin_m, axis)
    incidence = np.radians(caster.incidence_deg(origin_m, axis))
    first, second = _across(axis)
    nearest, flat = np.empty((len(axis), len(RINGS_DEG))), np.isfinite(along)
    level = caster.normals(origin_m, axis)
    offset = np.sum(level * (origin_m + np.where(np.isfinite(along), along, 0.0)[:, None] * axis), axis=1)
    for k, ring in enumerate(np.radians(RINGS_DEG)):
        found = np.full(len(axis), np.inf)
        for turn in 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS:
            ray = np.cos(ring) * axis + np.sin(ring) * (np.cos(turn) * first + np.sin(turn) * second)
            there = caster.ranges(origin_m, ray)
            found = np.minimum(found, there)
            if ring <= ALONE_RAD:
                reached = np.where(np.isfinite(there), there, 0.0)[:, None] * ray + origin_m
                same = np.abs(np.sum(level * reached, axis=1) - offset) < 1e-4
                # Beside a plate the beam may meet nothing: that weakens the echo, but moves nothing.
                flat &= same | (~np.isfinite(there) & (ring > COVERED_RAD))
        nearest[:, k] = found
    return BeamView(along, incidence, np.minimum.accumulate(np.minimum(nearest, along[:, None]), axis=1), flat)


def _across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (N, 3) across each axis and each other."""
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(axis, first)
