"""How loud the strongest echo of a ping should be over a surface: what the amplitude of a reading says of it.

A facet that faces the sensor answers ten times louder than matte speckle, whichever echo comes first. So a loud reading
means that something in the beam faces the sensor, and a quiet one that nothing does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.beam_model.echo.arrivals import OFF_MIRROR, Hearing, Surface, at_axis, held_step, lookup, window
from surfuse.geometry.compiled import compiled, inlined
from surfuse.records import FloatArray, IntArray

RIM_SHARE = 0.64
"""Share of the first Fresnel zone that a facet at a rim fills."""


class Strength(NamedTuple):
    """Amplitudes of a mirror-like echo and of speckle by its tilt, over multiples of the angle step of `Hearing`."""

    mirror: FloatArray
    murmur: FloatArray


@compiled
def loudest(
    rows: IntArray, station: FloatArray, range_m: FloatArray, surface: Surface, ear: Hearing, strength: Strength,
    out: FloatArray,
) -> None:  # fmt: skip
    """Amplitude (M,; 1: a facing plate) of the loudest echo at the stations `rows`, into `out`.

    `station` (M, 6) holds positions and axes, `range_m` (M,) what was measured: cells about that range are looked at.
    """
    domain = surface.cells.domain
    for q in rows:
        rng = range_m[q]
        loud = max(ear.threshold, _murmur(station[q], rng, surface, ear, strength))
        wide = ear.reach * rng / max(0.2, -station[q, 5])
        j0, j1, i0, i1 = window(station[q], rng, wide, surface.cells)
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                if domain[j, i]:
                    loud = max(loud, _facing(station[q], rng, j, i, surface, ear, strength))
        out[q] = loud


@compiled
def _murmur(station: FloatArray, rng: float, surface: Surface, ear: Hearing, strength: Strength) -> float:
    """Amplitude of the speckle around the axis; 0 where the axis misses the part."""
    _, j, i, gain, _ = at_axis(station, rng, np.nan, surface, ear)
    if j < 0:
        return 0.0
    n = np.sqrt(1.0 + surface.slope_u[j, i] ** 2 + surface.slope_v[j, i] ** 2)
    tilt = np.arccos(min(1.0, max(0.0, 1.0 / (abs(gain) * n))))
    return lookup(strength.murmur, tilt / ear.angle_step)


@inlined
def _facing(station: FloatArray, rng: float, j: int, i: int, surface: Surface, ear: Hearing, strength: Strength
            ) -> float:  # fmt: skip
    """Amplitude of the mirror-like echo of one cell; 0 where it sends none to the sensor."""
    cells, limit, slack = surface.cells, 0.6 * surface.cells.g, OFF_MIRROR * 1.2 * rng
    ax, ay, az = station[3], station[4], station[5]
    x, y = cells.u0 + i * cells.g - station[0], cells.v0 + j * cells.g - station[1]
    z, gu, gv = surface.height[j, i] - station[2], surface.slope_u[j, i], surface.slope_v[j, i]
    stiff_u, stiff_v = 1.0 + gu * gu + z * surface.bend_u[j, i], 1.0 + gv * gv + z * surface.bend_v[j, i]
    pull_u, pull_v = x + z * gu, y + z * gv
    if abs(pull_u) > limit * abs(stiff_u) + slack or abs(pull_v) > limit * abs(stiff_v) + slack:
        return 0.0
    rho = np.sqrt(x * x + y * y + z * z)
    if (x * ax + y * ay + z * az) * np.sqrt(1.0 + ear.reach * ear.reach) < rho:
        return 0.0
    du, dv = held_step(pull_u, stiff_u, limit), held_step(pull_v, stiff_v, limit)
    if np.hypot(pull_u + stiff_u * du, pull_v + stiff_v * dv) >= OFF_MIRROR * rho:
        return 0.0
    focus = np.sqrt(abs(stiff_u * stiff_v)) / np.sqrt(1.0 + gu * gu + gv * gv)
    fx, fy, fz = x + du, y + dv, z + gu * du + gv * dv
    cos_foot = (fx * ax + fy * ay + fz * az) / np.sqrt(fx * fx + fy * fy + fz * fz)
    beam = lookup(strength.mirror, np.arccos(min(1.0, max(0.0, cos_foot))) / ear.angle_step)
    share = 1.0 if np.isnan(surface.rim[j, i, 0]) else RIM_SHARE
    return float(share * beam / max(focus, 0.7))
