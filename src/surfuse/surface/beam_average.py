"""What an optical ranger reads of a surface: the mean over its beam, not the distance along its axis.

A matte surface returns from each direction of the beam cos(incidence) / range^2 of the light that it gets (Lambert), so
nearer parts count more. What the beam meets beside the surface is too far behind it to be averaged with it.
"""

from __future__ import annotations

import numpy as np

from surfuse.records import FloatArray
from surfuse.surface.casting import RayCaster

RINGS, AZIMUTHS = 3, 8


def averaged_ranges(
    caster: RayCaster, origin_m: FloatArray, axis: FloatArray, half_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predicted range (N,) of N beams (half angles (N,)), inf where nothing is met, and the share that meets the mesh.

    The beam is sampled on rings of equal solid angle.
    """
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    weight, moment, met = np.zeros(len(axis)), np.zeros(len(axis)), np.zeros(len(axis))
    for ring in range(RINGS):
        angle = half_rad * np.sqrt((ring + 0.5) / RINGS)
        for turn in 2.0 * np.pi * (np.arange(AZIMUTHS) + 0.5 * (ring % 2)) / AZIMUTHS:
            beside = np.cos(turn) * first + np.sin(turn) * second
            ray = np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * beside
            range_m = caster.ranges(origin_m, ray)
            hit = np.isfinite(range_m)
            cosine = np.cos(np.radians(np.where(hit, caster.incidence_deg(origin_m, ray), 90.0)))
            share = np.where(hit, cosine / np.where(hit, range_m, 1.0) ** 2, 0.0)
            weight += share
            moment += share * np.where(hit, range_m, 0.0)
            met += hit
    known = weight > 0.0
    mean = np.where(known, moment / np.where(known, weight, 1.0), np.inf)
    return mean, met / (RINGS * AZIMUTHS)
