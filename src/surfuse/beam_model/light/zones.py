"""What a zone of light reads of a surface: the mean over its solid angle, not the distance along its axis.

A matte surface returns cos(incidence) / range^2 of the light from each direction (Lambert).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from surfuse.records import FloatArray, SurfaceMap

# Directions of equal solid angle, and how often each ray is brought closer to the surface.
RINGS, AZIMUTHS = 2, 8
ITERATIONS, DAMPING = 14, 0.7
# A ray may leave the range of its axis by this share of it; beyond, it has passed a rim and hit something else.
FARTHEST_SHARE = 0.5


@dataclass(frozen=True)
class HeightField:
    """Heights (R, C) in m over nodes `u_m` (C,), `v_m` (R,), continued beyond what is known by the nearest value.

    `known` (R, C) is 1 where the map has a value and 0 elsewhere.
    """

    height_m: FloatArray
    slope_u: FloatArray
    slope_v: FloatArray
    u_m: FloatArray
    v_m: FloatArray
    known: FloatArray

    @staticmethod
    def of(surface: SurfaceMap) -> HeightField:
        """The heights of a map that has a value somewhere and at least two nodes a side."""
        _, nearest = distance_transform_edt(~surface.mask, return_indices=True)
        height = surface.height_m[nearest[0], nearest[1]]
        slope_v, slope_u = np.gradient(height, surface.grid.v_m, surface.grid.u_m)
        known = surface.mask.astype(np.float64)
        return HeightField(height, slope_u, slope_v, surface.grid.u_m, surface.grid.v_m, known)

    def at(self, layer: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
        """A layer (R, C) at points (N,): bilinear, held at the border."""
        i = np.interp(u, self.u_m, np.arange(len(self.u_m), dtype=np.float64))
        j = np.interp(v, self.v_m, np.arange(len(self.v_m), dtype=np.float64))
        return np.asarray(map_coordinates(layer, [j, i], order=1, mode="nearest"), dtype=np.float64)

    def holds(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Whether points (N,) lie on what is known: 1.0 or 0.0."""
        half = 0.5 * float(np.median(np.diff(self.u_m)))
        inside = (u >= self.u_m[0] - half) & (u <= self.u_m[-1] + half)
        inside &= (v >= self.v_m[0] - half) & (v <= self.v_m[-1] + half)
        return np.asarray(inside & (self.at(self.known, u, v) >= 0.5), dtype=np.float64)

    def ranges(self, position_m: FloatArray, ray: FloatArray, start_m: FloatArray) -> FloatArray:
        """Range (N,) along unit rays (N, 3) from positions (N, 3), sought from `start_m` (N,)."""
        t = start_m.copy()
        for _ in range(ITERATIONS):
            x, y = position_m[:, 0] + t * ray[:, 0], position_m[:, 1] + t * ray[:, 1]
            miss = self.at(self.height_m, x, y) - position_m[:, 2] - t * ray[:, 2]
            steep = self.at(self.slope_u, x, y) * ray[:, 0] + self.at(self.slope_v, x, y) * ray[:, 1]
            t = t + DAMPING * miss / np.minimum(ray[:, 2] - steep, -0.2)
            t = np.clip(t, (1.0 - FARTHEST_SHARE) * start_m, (1.0 + FARTHEST_SHARE) * start_m)
        return t


def predicted(
    field: HeightField, position_m: FloatArray, axis: FloatArray, half_rad: FloatArray, range_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range along the axis, mean range over the zone, and the share of the zone that is on the surface (N,).

    What the zone sees beside the surface takes no part in the mean.

    `position_m`, `axis` (N, 3), half angles `half_rad` (N,) of the zones; the search starts from the measured ranges.
    """
    along = field.ranges(position_m, axis, range_m)
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    weight, moment, on = np.zeros(len(axis)), np.zeros(len(axis)), np.zeros(len(axis))
    for ring in range(RINGS):
        angle = half_rad * np.sqrt((ring + 0.5) / RINGS)
        for turn in 2.0 * np.pi * (np.arange(AZIMUTHS) + 0.5 * ring) / AZIMUTHS:
            ray = np.sin(angle)[:, None] * (np.cos(turn) * first + np.sin(turn) * second)
            ray = ray + np.cos(angle)[:, None] * axis
            met = field.ranges(position_m, ray, along)
            x, y = position_m[:, 0] + met * ray[:, 0], position_m[:, 1] + met * ray[:, 1]
            gu, gv = field.at(field.slope_u, x, y), field.at(field.slope_v, x, y)
            facing = (gu * ray[:, 0] + gv * ray[:, 1] - ray[:, 2]) / np.sqrt(1.0 + gu**2 + gv**2)
            there = field.holds(x, y)
            share = there * np.maximum(facing, 0.02) / met**2
            on += there
            weight += share
            moment += share * met
    mean = np.where(weight > 0.0, moment / np.where(weight > 0.0, weight, 1.0), along)
    return along, mean, on / (RINGS * AZIMUTHS)
