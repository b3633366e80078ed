"""How loud the strongest echo of a ping should be over a surface: what the amplitude of a reading says of it.

A facet that faces the sensor answers ten times louder than matte speckle, whichever echo comes first. So a loud reading
means that something in the beam faces the sensor, and a quiet one that nothing does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.beam_model.echo.arrivals import OFF_MIRROR, Hearing, Surface, at_axis, held_step, lookup, window
from surfuse.geometry.compiled import compiled
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
    One loop without calls that take arrays: those would be counted in and out for every cell.
    """
    mirror, murmur = strength.mirror, strength.murmur
    height, slope_u, slope_v = surface.height, surface.slope_u, surface.slope_v
    bend_u, bend_v, rim, cells = surface.bend_u, surface.bend_v, surface.rim, surface.cells
    domain, u0, v0, g = cells.domain, cells.u0, cells.v0, cells.g
    reach, limit = np.sqrt(1.0 + ear.reach * ear.reach), 0.6 * g
    for q in rows:
        sx, sy, sz = station[q, 0], station[q, 1], station[q, 2]
        ax, ay, az = station[q, 3], station[q, 4], station[q, 5]
        rng = range_m[q]
        loud, slack = ear.threshold, OFF_MIRROR * 1.2 * rng
        _, bj, bi, gain, _ = at_axis(station[q], rng, np.nan, surface, ear)
        if bj >= 0:
            n = np.sqrt(1.0 + slope_u[bj, bi] ** 2 + slope_v[bj, bi] ** 2)
            tilt = np.arccos(min(1.0, max(0.0, 1.0 / (abs(gain) * n))))
            loud = max(loud, lookup(murmur, tilt / ear.angle_step))
        j0, j1, i0, i1 = window(station[q], rng, ear.reach * rng / max(0.2, -az), cells)
        for j in range(j0, j1 + 1):
            y = v0 + j * g - sy
            for i in range(i0, i1 + 1):
                if not domain[j, i]:
                    continue
                x, z, gu, gv = u0 + i * g - sx, height[j, i] - sz, slope_u[j, i], slope_v[j, i]
                stiff_u, stiff_v = 1.0 + gu * gu + z * bend_u[j, i], 1.0 + gv * gv + z * bend_v[j, i]
                pull_u, pull_v = x + z * gu, y + z * gv
                if abs(pull_u) > limit * abs(stiff_u) + slack or abs(pull_v) > limit * abs(stiff_v) + slack:
                    continue
                rho = np.sqrt(x * x + y * y + z * z)
                if (x * ax + y * ay + z * az) * reach < rho:
                    continue
                du, dv = held_step(pull_u, stiff_u, limit), held_step(pull_v, stiff_v, limit)
                if np.hypot(pull_u + stiff_u * du, pull_v + stiff_v * dv) >= OFF_MIRROR * rho:
                    continue
                focus = np.sqrt(abs(stiff_u * stiff_v)) / np.sqrt(1.0 + gu * gu + gv * gv)
                fx, fy, fz = x + du, y + dv, z + gu * du + gv * dv
                cos_foot = (fx * ax + fy * ay + fz * az) / np.sqrt(fx * fx + fy * fy + fz * fz)
                beam = lookup(mirror, np.arccos(min(1.0, max(0.0, cos_foot))) / ear.angle_step)
                share = 1.0 if np.isnan(rim[j, i, 0]) else RIM_SHARE
                loud = max(loud, share * beam / max(focus, 0.7))
        out[q] = loud
