"""Which point of a surface a sensor hears first, and when: the forward model of the beam-aware method.

Three kinds of arrival compete: the mirror-like echo of a facet whose normal passes near the sensor, the wave that a rim
scatters, and the speckle of the patch around the axis. The earliest is the prediction.
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray

NONE, MIRROR, RIM, SPECKLE = 0, 1, 2, 3
# A facet further than this from the foot of the perpendicular sends its echo past the sensor (tangent of 1.5 degrees).
OFF_MIRROR = 0.026


@compiled
def lookup(table: FloatArray, x: float) -> float:
    """Linear interpolation in a table over 0, 1, 2, ... (held at both ends; inf where a neighbour is inf)."""
    if x <= 0.0:
        return float(table[0])
    k = int(x)
    if k >= table.shape[0] - 1:
        return float(table[-1])
    f = x - k
    return float(table[k] + f * (table[k + 1] - table[k])) if f > 0.0 else float(table[k])


@compiled
def rim_delay(amplitude: float, threshold: float, rise: float) -> float:
    """Late arrival (m) of an echo of this amplitude relative to one of amplitude 1; inf below the threshold."""
    if amplitude <= 1.02 * threshold:
        return float(np.inf)
    return float(rise * (np.log1p(-threshold) - np.log1p(-threshold / amplitude)))


@compiled
def _newton(pull: float, stiff: float, limit: float) -> float:
    """Step to where the derivative of the squared distance vanishes, held inside the cell."""
    if abs(pull) >= abs(stiff) * limit:
        return -limit if (pull > 0.0) == (stiff > 0.0) else limit
    return -pull / stiff


@compiled
def predict_one(
    sx: float, sy: float, sz: float, ax: float, ay: float, az: float, rng: float, level: float,
    height: FloatArray, slope_u: FloatArray, slope_v: FloatArray, bend_u: FloatArray, bend_v: FloatArray, domain: BoolArray, rim: BoolArray,
    u0: float, v0: float, g: float,
    directivity: FloatArray, diffraction: FloatArray, angle_step: float, diffraction_step: float,
    tilts: FloatArray, levels: FloatArray, speckle: FloatArray, scatter: FloatArray,
    threshold: float, rise: float, wavelength: float, reach: float, diffuse: float, grain: float, optical: bool,
) -> tuple[float, int, int, int, float, float, float]:  # fmt: skip
    """First arrival at one station.

    Returns range (m; inf: nothing heard), kind, row and column of the cell, d range / d height of that cell, scale of
    the model's own scatter (m), and the second-earliest arrival of another kind or place (m).
    """
    rows, cols = height.shape
    best, kind, bj, bi, gain, spread = np.inf, 0, -1, -1, 0.0, 0.0
    second = np.inf
    # The patch around the axis: intersection by a few steps along the axis.
    t = rng
    oj, oi = -1, -1
    for _ in range(6):
        x, y = sx + ax * t, sy + ay * t
        j, i = int(np.floor((y - v0) / g + 0.5)), int(np.floor((x - u0) / g + 0.5))
        if j < 0 or i < 0 or j >= rows or i >= cols:
            oj = -1
            break
        oj, oi = j, i
        if not domain[j, i]:
            break
        gu, gv = slope_u[j, i], slope_v[j, i]
        surface = height[j, i] + gu * (x - u0 - i * g) + gv * (y - v0 - j * g)
        denominator = az - gu * ax - gv * ay
        if denominator > -0.05:
            denominator = -0.05
        t += (surface - sz - az * t) / denominator
    # Beyond the part's rim an axis meets nothing.
    if oj >= 0 and domain[oj, oi] and t > 0.0:
        gu, gv = slope_u[oj, oi], slope_v[oj, oi]
        n = np.sqrt(1.0 + gu * gu + gv * gv)
        tilt = np.arccos(min(1.0, max(0.0, -(az - gu * ax - gv * ay) / n)))
        k = np.searchsorted(tilts, tilt) - 1
        k = max(0, min(tilts.shape[0] - 2, k))
        f = min(1.0, max(0.0, (tilt - tilts[k]) / (tilts[k + 1] - tilts[k])))
        last = speckle.shape[1] - 1
        m, w = last, 0.0
        if not np.isnan(level):
            m = int(np.searchsorted(levels, level)) - 1
            m = max(0, min(levels.shape[0] - 2, m))
            w = min(1.0, max(0.0, (level - levels[m]) / (levels[m + 1] - levels[m])))
        m2 = min(m + 1, last) if w > 0.0 else m
        shift = (1 - f) * ((1 - w) * speckle[k, m] + w * speckle[k, m2]) + f * (
            (1 - w) * speckle[k + 1, m] + w * speckle[k + 1, m2]
        )
        best, kind, bj, bi = t + shift, 3, oj, oi
        gain = 1.0 / min(-0.05, az - gu * ax - gv * ay)
        spread = (1 - f) * ((1 - w) * scatter[k, m] + w * scatter[k, m2]) + f * (
            (1 - w) * scatter[k + 1, m] + w * scatter[k + 1, m2]
        )
    if optical:
        return best, kind, bj, bi, gain, spread, second
    cx, cy = sx + ax * rng, sy + ay * rng
    wide = reach * rng / max(0.2, -az)
    i0, i1 = max(0, int(np.ceil((cx - wide - u0) / g))), min(cols - 1, int(np.floor((cx + wide - u0) / g)))
    j0, j1 = max(0, int(np.ceil((cy - wide - v0) / g))), min(rows - 1, int(np.floor((cy + wide - v0) / g)))
    cos_reach = 1.0 / np.sqrt(1.0 + reach * reach)
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if not domain[j, i]:
                continue
            dx, dy, dz = u0 + i * g - sx, v0 + j * g - sy, height[j, i] - sz
            rho = np.sqrt(dx * dx + dy * dy + dz * dz)
            # Nothing that starts later than the best can be earlier.
            if rho - 1.5 * g >= best and rho >= second:
                continue
            cos_theta = (dx * ax + dy * ay + dz * az) / rho
            if cos_theta < cos_reach:
                continue
            gu, gv = slope_u[j, i], slope_v[j, i]
            n = np.sqrt(1.0 + gu * gu + gv * gv)
            normal = (gu * dx + gv * dy - dz) / n
            if normal <= 0.0:
                continue
            theta = np.arccos(min(1.0, cos_theta)) / angle_step
            arrival, way, slope = np.inf, 0, 0.0
            beam = lookup(directivity, theta)
            delay = 0.0
            ku, kv = bend_u[j, i], bend_v[j, i]
            # Foot of the perpendicular on the curved cell: one Newton step of the squared distance along each side.
            stiff_u, stiff_v = 1.0 + gu * gu + dz * ku, 1.0 + gv * gv + dz * kv
            pull_u, pull_v = dx + dz * gu, dy + dz * gv
            shift_u = _newton(pull_u, stiff_u, 0.6 * g)
            shift_v = _newton(pull_v, stiff_v, 0.6 * g)
            miss = np.hypot(pull_u + stiff_u * shift_u, pull_v + stiff_v * shift_v) / rho
            if miss < OFF_MIRROR:
                fx, fy = dx + shift_u, dy + shift_v
                fz = dz + gu * shift_u + gv * shift_v + 0.5 * (ku * shift_u * shift_u + kv * shift_v * shift_v)
                # A convex facet spreads its echo, a concave one gathers it.
                focus = np.sqrt(abs(stiff_u * stiff_v) / (n * n))
                foot = np.sqrt(fx * fx + fy * fy + fz * fz)
                cos_foot = (fx * ax + fy * ay + fz * az) / foot
                beam_foot = lookup(directivity, np.arccos(min(1.0, max(0.0, cos_foot))) / angle_step)
                # Beside a rim half of the first Fresnel zone is missing.
                whole = 0.62 if rim[j, i] else 1.0
                delay = rim_delay(whole * beam_foot / max(focus, 0.7), threshold, rise)
                arrival = foot + delay
                way, slope = 1, -1.0 / n
            if rim[j, i]:
                off = np.sqrt(max(0.0, rho * rho - normal * normal))
                v = 2.0 * off / np.sqrt(wavelength * rho) / diffraction_step
                amplitude = beam * lookup(diffraction, v)
                edge = rho + rim_delay(amplitude, threshold, rise)
                if edge < arrival:
                    arrival, way, slope = edge, 2, dz / rho
                    # A rim weaker than the speckle of the patch is heard only when the speckle happens to be silent.
                    drowned = min(1.0, (1.5 * diffuse / amplitude) ** 2)
                    delay = 0.3 * (edge - rho) + drowned * grain + 0.0005
            if arrival < best:
                if abs(j - bj) + abs(i - bi) > 2 or way != kind:
                    second = best
                best, kind, bj, bi, gain = arrival, way, j, i, slope
                spread = 0.2 * delay if way == 1 else delay
            elif arrival < second and abs(j - bj) + abs(i - bi) > 2:
                second = arrival
    return best, kind, bj, bi, gain, spread, second


@compiled
def predict(
    rows: IntArray, position: FloatArray, axis: FloatArray, range_m: FloatArray, level: FloatArray,
    height: FloatArray, slope_u: FloatArray, slope_v: FloatArray, bend_u: FloatArray, bend_v: FloatArray, domain: BoolArray, rim: BoolArray,
    u0: float, v0: float, g: float,
    directivity: FloatArray, diffraction: FloatArray, angle_step: float, diffraction_step: float,
    tilts: FloatArray, levels: FloatArray, speckle: FloatArray, scatter: FloatArray,
    threshold: float, rise: float, wavelength: float, reach: float, diffuse: float, grain: float, optical: bool,
    out: FloatArray, cell: IntArray,
) -> None:  # fmt: skip
    """First arrivals at the stations `rows`, into out (M, 4: range, d range / d height, scatter, second) and cell (M, 3).

    `cell` holds kind, row and column.
    """
    for q in rows:
        best, kind, j, i, gain, spread, second = predict_one(
            position[q, 0], position[q, 1], position[q, 2], axis[q, 0], axis[q, 1], axis[q, 2], range_m[q], level[q],
            height, slope_u, slope_v, bend_u, bend_v, domain, rim, u0, v0, g, directivity, diffraction, angle_step,
            diffraction_step, tilts, levels, speckle, scatter, threshold, rise, wavelength, reach, diffuse, grain, optical,
        )  # fmt: skip
        out[q, 0], out[q, 1], out[q, 2], out[q, 3] = best, gain, spread, second
        cell[q, 0], cell[q, 1], cell[q, 2] = kind, j, i
