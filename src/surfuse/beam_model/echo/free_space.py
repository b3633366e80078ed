"""The nearest surface that mirror-like readings leave free: envelope of spheres, gated against late spikes."""

from __future__ import annotations

import numpy as np

from surfuse.beam_model.echo.arrivals import Cells, Hearing, lookup, rim_delay, window
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray


@compiled
def carve(
    rows: IntArray, station: FloatArray, range_m: FloatArray, cells: Cells, ear: Hearing, lowest: FloatArray
) -> None:
    """Lower the bounds `lowest` (R, C, 2): the two smallest heights above which a cell would have been heard.

    `station` (M, 6) holds positions and axes, of which `rows` count.
    """
    domain, u0, v0, g = cells.domain, cells.u0, cells.v0, cells.g
    cos_reach = 1.0 / np.sqrt(1.0 + ear.reach * ear.reach)
    for q in rows:
        r = range_m[q]
        wide = ear.reach * r / max(0.2, -station[q, 5]) + g
        j0, j1, i0, i1 = window(station[q], r, wide, cells)
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                if not domain[j, i]:
                    continue
                dx, dy = u0 + i * g - station[q, 0], v0 + j * g - station[q, 1]
                below = _below(station[q], dx, dy, r, cos_reach, ear)
                if below < 0.0:
                    continue
                bound = station[q, 2] - below
                if bound < lowest[j, i, 0]:
                    lowest[j, i, 1] = lowest[j, i, 0]
                    lowest[j, i, 0] = bound
                elif bound < lowest[j, i, 1]:
                    lowest[j, i, 1] = bound


@compiled
def _below(station: FloatArray, dx: float, dy: float, r: float, cos_reach: float, ear: Hearing) -> float:
    """How far below the station a rim at (dx, dy) from it must be, not to be heard before range r; -1: never heard.

    A facing rim in the cell at angle theta is heard late by its diffraction; the range is shortened by that delay
    before it bounds the cell.
    """
    side = dx * dx + dy * dy
    free, z = r, 0.0
    for _ in range(3):
        if free * free <= side:
            return -1.0
        z = np.sqrt(free * free - side)
        cos_theta = (dx * station[3] + dy * station[4] - z * station[5]) / free
        if cos_theta < cos_reach:
            return -1.0
        sin_theta = np.sqrt(max(0.0, 1.0 - cos_theta * cos_theta))
        across = 2.0 * free * sin_theta / np.sqrt(ear.wavelength * free) / ear.diffraction_step
        theta = np.arccos(min(1.0, cos_theta)) / ear.angle_step
        # Half of the axis patch answers even when the cell under the axis is a rim.
        strength = lookup(ear.rim_wave, theta) * lookup(ear.diffraction, across)
        delay = rim_delay(strength, ear.threshold, ear.rise)
        if delay > 0.2 * r:
            return -1.0
        free = r - delay
    return z
