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
# Steps from the axis to the patch that answers first.
NEAR_STEPS = 4


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
def _nearest_patch(
    station: FloatArray, t: float, late: float, tilt: float, slope_u: float, slope_v: float, domain: BoolArray,
    u0: float, v0: float, g: float,
) -> float:  # fmt: skip
    """Range of the nearest patch that answers before the axis: uphill in the plane of incidence, on the part.

    At the off-axis angle d the tilted plane is at t cos(tilt) / cos(tilt - d).
    """
    rows, cols = domain.shape
    ax, ay, az = station[3], station[4], station[5]
    n = np.sqrt(1.0 + slope_u * slope_u + slope_v * slope_v)
    # Unit vector across the axis towards the foot of the perpendicular.
    along = (slope_u * ax + slope_v * ay - az) / n
    bx, by = slope_u / n - along * ax, slope_v / n - along * ay
    bz = -1.0 / n - along * az
    size = np.sqrt(bx * bx + by * by + bz * bz)
    if size < 1e-9:
        return t
    widest = tilt - np.arccos(min(1.0, t * np.cos(tilt) / (t + late)))
    found = t
    for k in range(1, NEAR_STEPS + 1):
        d = widest * k / NEAR_STEPS
        r = t * np.cos(tilt) / np.cos(tilt - d)
        x = station[0] + r * (np.cos(d) * ax + np.sin(d) * bx / size)
        y = station[1] + r * (np.cos(d) * ay + np.sin(d) * by / size)
        j, i = int(np.floor((y - v0) / g + 0.5)), int(np.floor((x - u0) / g + 0.5))
        if j < 0 or i < 0 or j >= rows or i >= cols or not domain[j, i]:
            break
        found = r
    return float(found)


@compiled
def at_axis(
    station: FloatArray, rng: float, level: float,
    height: FloatArray, slope_u: FloatArray, slope_v: FloatArray, domain: BoolArray,
    u0: float, v0: float, g: float,
    tilts: FloatArray, levels: FloatArray, speckle: FloatArray, scatter: FloatArray,
) -> tuple[float, int, int, float, float]:  # fmt: skip
    """Speckle of the patch around the axis: range (inf: the axis misses the part), row, column, gain, scatter.

    `station` (6,) is position and axis; the intersection is found by a few steps along the axis.
    """
    sx, sy, sz, ax, ay, az = station[0], station[1], station[2], station[3], station[4], station[5]
    rows, cols = height.shape
    t, j, i = rng, -1, -1
    for _ in range(6):
        j, i = int(np.floor((sy + ay * t - v0) / g + 0.5)), int(np.floor((sx + ax * t - u0) / g + 0.5))
        if j < 0 or i < 0 or j >= rows or i >= cols or not domain[j, i]:
            return np.inf, -1, -1, 0.0, 0.0
        gu, gv = slope_u[j, i], slope_v[j, i]
        surface = height[j, i] + gu * (sx + ax * t - u0 - i * g) + gv * (sy + ay * t - v0 - j * g)
        t += (surface - sz - az * t) / min(-0.05, az - gu * ax - gv * ay)
    if t <= 0.0:
        return np.inf, -1, -1, 0.0, 0.0
    gu, gv = slope_u[j, i], slope_v[j, i]
    towards = az - gu * ax - gv * ay
    tilt = np.arccos(min(1.0, max(0.0, -towards / np.sqrt(1.0 + gu * gu + gv * gv))))
    k = max(0, min(tilts.shape[0] - 2, int(np.searchsorted(tilts, tilt)) - 1))
    f = min(1.0, max(0.0, (tilt - tilts[k]) / (tilts[k + 1] - tilts[k])))
    m, other, w = speckle.shape[1] - 1, speckle.shape[1] - 1, 0.0
    if not np.isnan(level):
        m = max(0, min(levels.shape[0] - 2, int(np.searchsorted(levels, level)) - 1))
        w = min(1.0, max(0.0, (level - levels[m]) / (levels[m + 1] - levels[m])))
        other = m + 1
    late = (1.0 - f) * ((1.0 - w) * speckle[k, m] + w * speckle[k, other])
    late += f * ((1.0 - w) * speckle[k + 1, m] + w * speckle[k + 1, other])
    spread = (1.0 - f) * ((1.0 - w) * scatter[k, m] + w * scatter[k, other])
    spread += f * ((1.0 - w) * scatter[k + 1, m] + w * scatter[k + 1, other])
    if late < 0.0 and tilt > 0.0:
        late = max(late, _nearest_patch(station, t, late, tilt, gu, gv, domain, u0, v0, g) - t)
    return t + late, j, i, 1.0 / min(-0.05, towards), spread


@compiled
def predict_one(
    station: FloatArray, rng: float, level: float,
    height: FloatArray, slope_u: FloatArray, slope_v: FloatArray, bend_u: FloatArray, bend_v: FloatArray,
    domain: BoolArray, rim: FloatArray, u0: float, v0: float, g: float,
    mirror: FloatArray, rim_wave: FloatArray, diffraction: FloatArray, angle_step: float, diffraction_step: float,
    tilts: FloatArray, levels: FloatArray, speckle: FloatArray, scatter: FloatArray,
    threshold: float, rise: float, wavelength: float, reach: float,
    diffuse: float, murmur: float, grain: float, optical: bool,
) -> tuple[float, int, int, int, float, float]:  # fmt: skip
    """First arrival at one station: range (m; inf: nothing heard), kind, row, column, d range / d height, scatter."""
    best, bj, bi, gain, spread = at_axis(
        station, rng, level, height, slope_u, slope_v, domain, u0, v0, g, tilts, levels, speckle, scatter
    )
    kind = 3 if bj >= 0 else 0
    if optical:
        return best, kind, bj, bi, gain, spread
    sx, sy, sz, ax, ay, az = station[0], station[1], station[2], station[3], station[4], station[5]
    rows, cols = height.shape
    cx, cy = sx + ax * rng, sy + ay * rng
    wide = reach * rng / max(0.2, -az)
    i0, i1 = max(0, int(np.ceil((cx - wide - u0) / g))), min(cols - 1, int(np.floor((cx + wide - u0) / g)))
    j0, j1 = max(0, int(np.ceil((cy - wide - v0) / g))), min(rows - 1, int(np.floor((cy + wide - v0) / g)))
    cos_reach = 1.0 / np.sqrt(1.0 + reach * reach)
    slack = OFF_MIRROR * 1.2 * rng
    for j in range(j0, j1 + 1):
        dy = v0 + j * g - sy
        for i in range(i0, i1 + 1):
            if not domain[j, i]:
                continue
            at_rim = not np.isnan(rim[j, i, 0])
            dx, dz = u0 + i * g - sx, height[j, i] - sz
            gu, gv, ku, kv = slope_u[j, i], slope_v[j, i], bend_u[j, i], bend_v[j, i]
            # Foot of the perpendicular on the curved cell: one Newton step of the squared distance along each side.
            stiff_u, stiff_v = 1.0 + gu * gu + dz * ku, 1.0 + gv * gv + dz * kv
            pull_u, pull_v = dx + dz * gu, dy + dz * gv
            far = abs(pull_u) > 0.6 * g * abs(stiff_u) + slack or abs(pull_v) > 0.6 * g * abs(stiff_v) + slack
            if far and not at_rim:
                continue
            rho = np.sqrt(dx * dx + dy * dy + dz * dz)
            along = dx * ax + dy * ay + dz * az
            # Nothing that starts later than the best can be earlier.
            if rho - 1.5 * g >= best or along < cos_reach * rho:
                continue
            n = np.sqrt(1.0 + gu * gu + gv * gv)
            if gu * dx + gv * dy - dz <= 0.0:
                continue
            arrival, way, slope, own = np.inf, 0, 0.0, 0.0
            if not far:
                shift_u, shift_v = _newton(pull_u, stiff_u, 0.6 * g), _newton(pull_v, stiff_v, 0.6 * g)
                miss = np.hypot(pull_u + stiff_u * shift_u, pull_v + stiff_v * shift_v) / rho
                if miss < OFF_MIRROR:
                    fx, fy = dx + shift_u, dy + shift_v
                    fz = dz + gu * shift_u + gv * shift_v + 0.5 * (ku * shift_u * shift_u + kv * shift_v * shift_v)
                    foot = np.sqrt(fx * fx + fy * fy + fz * fz)
                    if foot < best:
                        # A convex facet spreads its echo, a concave one gathers it.
                        focus = np.sqrt(abs(stiff_u * stiff_v)) / n
                        cos_foot = (fx * ax + fy * ay + fz * az) / foot
                        beam = lookup(mirror, np.arccos(min(1.0, max(0.0, cos_foot))) / angle_step)
                        # Beside a rim part of the first Fresnel zone is missing.
                        strength = (0.64 if at_rim else 1.0) * beam / max(focus, 0.7)
                        delay = rim_delay(strength, threshold, rise)
                        # Speckle of the same strength hides it, at first by chance, then as a rule.
                        hidden = min(1.0, (murmur / max(strength, 1e-6)) ** 2)
                        arrival, way, slope = foot + delay + 0.5 * hidden * rise, 1, -1.0 / n
                        own = 0.2 * delay + hidden * grain
            if at_rim:
                # The rim itself is half a cell towards the drop.
                ex, ey = dx + rim[j, i, 0], dy + rim[j, i, 1]
                ez = dz + gu * rim[j, i, 0] + gv * rim[j, i, 1]
                rho = np.sqrt(ex * ex + ey * ey + ez * ez)
                if rho < min(best, arrival):
                    cos_theta = min(1.0, max(0.0, (ex * ax + ey * ay + ez * az) / rho))
                    normal = (gu * ex + gv * ey - ez) / n
                    off = np.sqrt(max(0.0, rho * rho - normal * normal))
                    wave = lookup(diffraction, 2.0 * off / np.sqrt(wavelength * rho) / diffraction_step)
                    delay = rim_delay(lookup(rim_wave, np.arccos(cos_theta) / angle_step) * wave, threshold, rise)
                    # A rim weaker than the speckle of the patch around it is heard only where that speckle is silent.
                    drowned = min(1.0, (diffuse / max(wave, 1e-6)) ** 2)
                    edge = rho + delay + 0.5 * drowned * rise
                    if edge < arrival:
                        # Where in its cell the rim is, is not known.
                        sideways = np.sqrt(1.0 - cos_theta * cos_theta)
                        own = 0.2 * delay + drowned * grain + 0.3 * g * sideways + 0.0003
                        arrival, way, slope = edge, 2, ez / rho
            if arrival < best:
                best, kind, bj, bi, gain, spread = arrival, way, j, i, slope, own
    return best, kind, bj, bi, gain, spread


@compiled
def predict(
    rows: IntArray, station: FloatArray, range_m: FloatArray, level: FloatArray,
    height: FloatArray, slope_u: FloatArray, slope_v: FloatArray, bend_u: FloatArray, bend_v: FloatArray,
    domain: BoolArray, rim: FloatArray, u0: float, v0: float, g: float,
    mirror: FloatArray, rim_wave: FloatArray, diffraction: FloatArray, angle_step: float, diffraction_step: float,
    tilts: FloatArray, levels: FloatArray, speckle: FloatArray, scatter: FloatArray,
    threshold: float, rise: float, wavelength: float, reach: float,
    diffuse: float, murmur: float, grain: float, optical: bool,
    out: FloatArray, cell: IntArray,
) -> None:  # fmt: skip
    """First arrivals at the stations `rows`, into out (M, 3: range, d range / d height, scatter) and cell (M, 3).

    `station` (M, 6) holds positions and axes, `cell` kind, row and column.
    """
    for q in rows:
        best, kind, j, i, gain, spread = predict_one(
            station[q], range_m[q], level[q], height, slope_u, slope_v, bend_u, bend_v, domain, rim, u0, v0, g,
            mirror, rim_wave, diffraction, angle_step, diffraction_step, tilts, levels, speckle, scatter,
            threshold, rise, wavelength, reach, diffuse, murmur, grain, optical,
        )  # fmt: skip
        out[q, 0], out[q, 1], out[q, 2] = best, gain, spread
        cell[q, 0], cell[q, 1], cell[q, 2] = kind, j, i
