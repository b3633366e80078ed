"""The nearest surface that mirror-like readings leave free: envelope of spheres, gated against late spikes."""

from __future__ import annotations

import numpy as np

from surfuse.beam_model.echo.arrivals import lookup, rim_delay
from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray


@compiled
def carve(
    rows: IntArray, position: FloatArray, axis: FloatArray, range_m: FloatArray, domain: BoolArray,
    u0: float, v0: float, g: float,
    rim_wave: FloatArray, diffraction: FloatArray, angle_step: float, diffraction_step: float,
    threshold: float, rise: float, wavelength: float, reach: float, lowest: FloatArray,
) -> None:  # fmt: skip
    """Lower the bounds `lowest` (R, C, 2): the two smallest heights above which a cell would have been heard.

    A facing rim in the cell at angle theta is heard late by its diffraction; the range is shortened by that delay
    before it bounds the cell.
    """
    nrows, ncols = domain.shape
    cos_reach = 1.0 / np.sqrt(1.0 + reach * reach)
    for q in rows:
        sx, sy, sz = position[q, 0], position[q, 1], position[q, 2]
        ax, ay, az = axis[q, 0], axis[q, 1], axis[q, 2]
        r = range_m[q]
        cx, cy = sx + ax * r, sy + ay * r
        wide = reach * r / max(0.2, -az) + g
        i0, i1 = max(0, int(np.ceil((cx - wide - u0) / g))), min(ncols - 1, int(np.floor((cx + wide - u0) / g)))
        j0, j1 = max(0, int(np.ceil((cy - wide - v0) / g))), min(nrows - 1, int(np.floor((cy + wide - v0) / g)))
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                if not domain[j, i]:
                    continue
                dx, dy = u0 + i * g - sx, v0 + j * g - sy
                side = dx * dx + dy * dy
                free = r
                z = 0.0
                for _ in range(3):
                    if free * free <= side:
                        free = -1.0
                        break
                    z = np.sqrt(free * free - side)
                    cos_theta = (dx * ax + dy * ay - z * az) / free
                    if cos_theta < cos_reach:
                        free = -1.0
                        break
                    sin_theta = np.sqrt(max(0.0, 1.0 - cos_theta * cos_theta))
                    across = 2.0 * free * sin_theta / np.sqrt(wavelength * free) / diffraction_step
                    theta = np.arccos(min(1.0, cos_theta)) / angle_step
                    # Half of the axis patch answers even when the cell under the axis is a rim.
                    strength = lookup(rim_wave, theta) * lookup(diffraction, across)
                    delay = rim_delay(strength, threshold, rise)
                    if delay > 0.2 * r:
                        free = -1.0
                        break
                    free = r - delay
                if free < 0.0:
                    continue
                bound = sz - z
                if bound < lowest[j, i, 0]:
                    lowest[j, i, 1] = lowest[j, i, 0]
                    lowest[j, i, 0] = bound
                elif bound < lowest[j, i, 1]:
                    lowest[j, i, 1] = bound
