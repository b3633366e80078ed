"""Which point of a surface a sensor hears first, and when: the forward model of the beam-aware method.

Three kinds of arrival compete: the mirror-like echo of a facet whose normal passes near the sensor, the wave that a rim
scatters, and the speckle of the patch around the axis. The earliest is the prediction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled, inlined
from surfuse.records import BoolArray, FloatArray, IntArray

NONE, MIRROR, RIM, SPECKLE = 0, 1, 2, 3
# A facet further than this from the foot of the perpendicular sends its echo past the sensor (tangent of 1.5 degrees).
OFF_MIRROR = 0.026
# Steps from the axis to the patch that answers first.
NEAR_STEPS = 4
BENT_AWAY_M = 0.002
HELP = 0.6


class Cells(NamedTuple):
    """The raster as kernels take it: `domain` (R, C), node (u0 + i g, v0 + j g) of cell (j, i), side `g` (m)."""

    domain: BoolArray
    u0: float
    v0: float
    g: float


class Surface(NamedTuple):
    """A height raster (R, C) in m over its cells, with what the arrivals need of it.

    `slope_u`, `slope_v` (R, C) are dw/du and dw/dv, `bend_u`, `bend_v` (R, C) the curvatures in 1/m, `rim` (R, C, 2) is
    where a rim lies beside its node in m; see `slopes`. `along` (R, C, 2) is the direction of its edge; see `tangents`.
    """

    height: FloatArray
    slope_u: FloatArray
    slope_v: FloatArray
    bend_u: FloatArray
    bend_v: FloatArray
    rim: FloatArray
    along: FloatArray
    cells: Cells


class Hearing(NamedTuple):
    """What one sensor hears, as kernels take it (see `BeamTable`); lengths in metres, angles in radians.

    `mirror` and `rim_wave` over multiples of `angle_step`, `diffraction` over multiples of `diffraction_step`;
    `speckle` and `scatter` over `tilts` and `levels`. `reach` is the tangent of the largest off-axis angle at which a
    mirror-like echo or a rim is heard; `diffuse`, `murmur` and `grain` say how speckle hides them.
    """

    mirror: FloatArray
    rim_wave: FloatArray
    diffraction: FloatArray
    angle_step: float
    diffraction_step: float
    tilts: FloatArray
    levels: FloatArray
    speckle: FloatArray
    scatter: FloatArray
    threshold: float
    rise: float
    wavelength: float
    reach: float
    diffuse: float
    murmur: float
    grain: float
    optical: bool


class Facet(NamedTuple):
    """One cell as a station sees it.

    (`x`, `y`, `z`) is the way from the station to the node in m, along u, v and w. `pull` (m) and `stiff` (no unit) are
    half the first and second derivative of the squared distance at the node, along u and along v.
    """

    x: float
    y: float
    z: float
    slope_u: float
    slope_v: float
    pull_u: float
    pull_v: float
    stiff_u: float
    stiff_v: float


@compiled
def lookup(table: FloatArray, x: float) -> float:
    """Linear interpolation in a table over 0, 1, 2, ... (held at both ends; inf where a neighbour is inf).

    `table` (K,); `x` is a place in it, in entries.
    """
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
def held_step(pull: float, stiff: float, limit: float) -> float:
    """Step to where the derivative of the squared distance vanishes, held inside the cell."""
    if abs(pull) >= abs(stiff) * limit:
        return -limit if (pull > 0.0) == (stiff > 0.0) else limit
    return -pull / stiff


@inlined
def window(station: FloatArray, rng: float, wide: float, cells: Cells) -> tuple[int, int, int, int]:
    """First and last row, first and last column of the cells within `wide` of where the axis is at a range.

    `station` (6,) is position (m) and unit axis in the part frame; `rng` and `wide` are in m. The rows and columns are
    held within the raster; the last one is part of the window.
    """
    rows, cols = cells.domain.shape
    u0, v0, g = cells.u0, cells.v0, cells.g
    cx, cy = station[0] + station[3] * rng, station[1] + station[4] * rng
    i0, i1 = max(0, int(np.ceil((cx - wide - u0) / g))), min(cols - 1, int(np.floor((cx + wide - u0) / g)))
    j0, j1 = max(0, int(np.ceil((cy - wide - v0) / g))), min(rows - 1, int(np.floor((cy + wide - v0) / g)))
    return j0, j1, i0, i1


@inlined
def _cell_at(x: float, y: float, cells: Cells) -> tuple[int, int]:
    """Row and column of the cell of the domain under a point; -1, -1 where there is none."""
    j, i = int(np.floor((y - cells.v0) / cells.g + 0.5)), int(np.floor((x - cells.u0) / cells.g + 0.5))
    rows, cols = cells.domain.shape
    if j < 0 or i < 0 or j >= rows or i >= cols or not cells.domain[j, i]:
        return -1, -1
    return j, i


@compiled
def _nearest_patch(station: FloatArray, t: float, late: float, tilt: float, at: tuple[int, int], surface: Surface
                   ) -> float:  # fmt: skip
    """Range of the nearest patch that answers before the axis: uphill in the plane of incidence, on the part.

    At the off-axis angle d a plane of this tilt is at t cos(tilt) / cos(tilt - d); the surface there may be farther.

    `station` (6,) is position and axis; `t` is the range of the axis, which meets the cell `at`, `late` (m) how much
    earlier than it the echo is.
    """
    cells, slope_u, slope_v = surface.cells, surface.slope_u[at], surface.slope_v[at]
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
        j, i = _cell_at(x, y, cells)
        if j < 0:
            break
        du, dv = x - cells.u0 - i * cells.g, y - cells.v0 - j * cells.g
        z = surface.height[j, i] + surface.slope_u[j, i] * du + surface.slope_v[j, i] * dv - station[2]
        x, y = x - station[0], y - station[1]
        found = min(found, np.sqrt(x * x + y * y + z * z))
    return float(found)


@inlined
def _interval(nodes: FloatArray, x: float) -> int:
    """The last interval of increasing nodes that begins below x, the first one below all of them."""
    k = 0
    while k < nodes.shape[0] - 2 and nodes[k + 1] < x:
        k += 1
    return k


@inlined
def _speckle(tilt: float, level: float, ear: Hearing) -> tuple[float, float]:
    """Location and scale of range minus axis range at a tilt; `level` nan: those of readings without amplitude."""
    tilts, levels, speckle, scatter = ear.tilts, ear.levels, ear.speckle, ear.scatter
    k = _interval(tilts, tilt)
    f = min(1.0, max(0.0, (tilt - tilts[k]) / (tilts[k + 1] - tilts[k])))
    m, other, w = speckle.shape[1] - 1, speckle.shape[1] - 1, 0.0
    if not np.isnan(level):
        m = _interval(levels, level)
        w = min(1.0, max(0.0, (level - levels[m]) / (levels[m + 1] - levels[m])))
        other = m + 1
    late = (1.0 - f) * ((1.0 - w) * speckle[k, m] + w * speckle[k, other])
    late += f * ((1.0 - w) * speckle[k + 1, m] + w * speckle[k + 1, other])
    spread = (1.0 - f) * ((1.0 - w) * scatter[k, m] + w * scatter[k, other])
    spread += f * ((1.0 - w) * scatter[k + 1, m] + w * scatter[k + 1, other])
    return late, spread


@compiled
def at_axis(
    station: FloatArray, rng: float, level: float, surface: Surface, ear: Hearing
) -> tuple[float, int, int, float, float]:
    """Speckle of the patch around the axis: range (inf: the axis misses the part), row, column, gain, scatter.

    `station` (6,) is position and axis; the intersection is found by a few steps along the axis.
    """
    sx, sy, sz, ax, ay, az = station[0], station[1], station[2], station[3], station[4], station[5]
    cells, u0, v0, g = surface.cells, surface.cells.u0, surface.cells.v0, surface.cells.g
    height, slope_u, slope_v = surface.height, surface.slope_u, surface.slope_v
    t, j, i = rng, -1, -1
    for _ in range(6):
        j, i = _cell_at(sx + ax * t, sy + ay * t, cells)
        if j < 0:
            return np.inf, -1, -1, 0.0, 0.0
        gu, gv = slope_u[j, i], slope_v[j, i]
        there = height[j, i] + gu * (sx + ax * t - u0 - i * g) + gv * (sy + ay * t - v0 - j * g)
        t += (there - sz - az * t) / min(-0.05, az - gu * ax - gv * ay)
    if t <= 0.0:
        return np.inf, -1, -1, 0.0, 0.0
    gu, gv = slope_u[j, i], slope_v[j, i]
    towards = az - gu * ax - gv * ay
    tilt = np.arccos(min(1.0, max(0.0, -towards / np.sqrt(1.0 + gu * gu + gv * gv))))
    late, spread = _speckle(tilt, level, ear)
    if late < 0.0 and tilt > 0.0:
        nearest = _nearest_patch(station, t, late, tilt, (j, i), surface) - t
        # The nearest point of a surface that bends away is a point: its echo grows only behind it.
        late = max(late, nearest + min(nearest - late, BENT_AWAY_M))
    return t + late, j, i, 1.0 / min(-0.05, towards), spread


@inlined
def _normal(facet: Facet) -> float:
    """Length of the normal (-slope_u, -slope_v, 1)."""
    return float(np.sqrt(1.0 + facet.slope_u * facet.slope_u + facet.slope_v * facet.slope_v))


@inlined
def _mirror(
    axis: tuple[float, float, float],
    facet: Facet,
    bend: tuple[float, float],
    limit: float,
    best: float,
    share: float,
    ear: Hearing,
) -> tuple[float, float, float]:
    """Mirror-like echo of a facet with curvatures `bend`: range (inf: none before `best`), gain, scatter.

    The foot of the perpendicular on the curved cell is found by one Newton step of the squared distance along each
    side, held within `limit`. `share` is that of the first Fresnel zone which the facet fills.
    """
    f = facet
    rho = np.sqrt(f.x * f.x + f.y * f.y + f.z * f.z)
    shift_u, shift_v = held_step(f.pull_u, f.stiff_u, limit), held_step(f.pull_v, f.stiff_v, limit)
    miss = np.hypot(f.pull_u + f.stiff_u * shift_u, f.pull_v + f.stiff_v * shift_v) / rho
    if miss >= OFF_MIRROR:
        return np.inf, 0.0, 0.0
    fx, fy = f.x + shift_u, f.y + shift_v
    curved = bend[0] * shift_u * shift_u + bend[1] * shift_v * shift_v
    fz = f.z + f.slope_u * shift_u + f.slope_v * shift_v + 0.5 * curved
    foot = np.sqrt(fx * fx + fy * fy + fz * fz)
    if foot >= best:
        return np.inf, 0.0, 0.0
    n = _normal(f)
    # A convex facet spreads its echo, a concave one gathers it.
    focus = np.sqrt(abs(f.stiff_u * f.stiff_v)) / n
    cos_foot = (fx * axis[0] + fy * axis[1] + fz * axis[2]) / foot
    beam = lookup(ear.mirror, np.arccos(min(1.0, max(0.0, cos_foot))) / ear.angle_step)
    strength = share * beam / max(focus, 0.7)
    delay = rim_delay(strength, ear.threshold, ear.rise)
    # Speckle of the same strength hides it, at first by chance, then as a rule.
    hidden = min(1.0, (ear.murmur / max(strength, 1e-6)) ** 2)
    return foot + delay + 0.5 * hidden * ear.rise, -1.0 / n, 0.2 * delay + hidden * ear.grain


@inlined
def _from_rim(
    axis: tuple[float, float, float], facet: Facet, off: tuple[float, float], g: float, best: float, ear: Hearing
) -> tuple[float, float, float]:
    """Wave of a rim that lies `off` the node: range (inf: none before `best`), gain, scatter."""
    f = facet
    # The rim itself is half a cell towards the drop.
    ex, ey = f.x + off[0], f.y + off[1]
    ez = f.z + f.slope_u * off[0] + f.slope_v * off[1]
    rho = np.sqrt(ex * ex + ey * ey + ez * ez)
    if rho >= best:
        return np.inf, 0.0, 0.0
    cos_theta = min(1.0, max(0.0, (ex * axis[0] + ey * axis[1] + ez * axis[2]) / rho))
    normal = (f.slope_u * ex + f.slope_v * ey - ez) / _normal(f)
    across = np.sqrt(max(0.0, rho * rho - normal * normal))
    wave = lookup(ear.diffraction, 2.0 * across / np.sqrt(ear.wavelength * rho) / ear.diffraction_step)
    # The speckle of the patch around it helps a weak rim over the threshold.
    helped = np.hypot(wave, HELP * ear.diffuse)
    strength = lookup(ear.rim_wave, np.arccos(cos_theta) / ear.angle_step) * helped
    delay = rim_delay(strength, ear.threshold, ear.rise)
    # A rim weaker than the speckle of the patch around it is heard only where that speckle is silent.
    drowned = min(1.0, (ear.diffuse / max(wave, 1e-6)) ** 2)
    # Where in its cell the rim is, is not known.
    sideways = np.sqrt(1.0 - cos_theta * cos_theta)
    return (
        rho + delay,
        ez / rho,
        0.2 * delay + drowned * ear.grain + 0.3 * g * sideways + 0.0003,
    )


@compiled
def predict_one(
    station: FloatArray, rng: float, level: float, surface: Surface, ear: Hearing
) -> tuple[float, int, int, int, float, float]:
    """First arrival at one station: range (m; inf: nothing heard), kind, row, column, d range / d height, scatter.

    `station` (6,) is position (m) and unit axis in the part frame. `rng` (m) is what was measured: only cells about
    that range are looked at. `level` is the logarithm of amplitude over threshold, nan for readings without amplitude.
    `kind` is NONE, SPECKLE, MIRROR or RIM; row and column, that of the cell that is heard, are -1 where there is none.
    The scatter (m) is that of the model alone.
    """
    best, bj, bi, gain, spread = at_axis(station, rng, level, surface, ear)
    kind = SPECKLE if bj >= 0 else NONE
    if ear.optical:
        return best, kind, bj, bi, gain, spread
    sx, sy, sz, ax, ay, az = station[0], station[1], station[2], station[3], station[4], station[5]
    height, slope_u, slope_v = surface.height, surface.slope_u, surface.slope_v
    bend_u, bend_v, rim, cells = surface.bend_u, surface.bend_v, surface.rim, surface.cells
    along = surface.along
    domain, u0, v0, g = cells.domain, cells.u0, cells.v0, cells.g
    cos_reach = 1.0 / np.sqrt(1.0 + ear.reach * ear.reach)
    slack, axis = OFF_MIRROR * 1.2 * rng, (ax, ay, az)
    j0, j1, i0, i1 = window(station, rng, ear.reach * rng / max(0.2, -az), cells)
    for j in range(j0, j1 + 1):
        y = v0 + j * g - sy
        for i in range(i0, i1 + 1):
            if not domain[j, i]:
                continue
            x, z, gu, gv = u0 + i * g - sx, height[j, i] - sz, slope_u[j, i], slope_v[j, i]
            stiff_u, stiff_v = 1.0 + gu * gu + z * bend_u[j, i], 1.0 + gv * gv + z * bend_v[j, i]
            pull_u, pull_v = x + z * gu, y + z * gv
            far = abs(pull_u) > 0.6 * g * abs(stiff_u) + slack or abs(pull_v) > 0.6 * g * abs(stiff_v) + slack
            if far and np.isnan(rim[j, i, 0]):
                continue
            rho = np.sqrt(x * x + y * y + z * z)
            # Nothing that starts later than the best can be earlier.
            if rho - 1.5 * g >= best or x * ax + y * ay + z * az < cos_reach * rho or gu * x + gv * y - z <= 0.0:
                continue
            facet = Facet(x, y, z, gu, gv, pull_u, pull_v, stiff_u, stiff_v)
            at_rim = not np.isnan(rim[j, i, 0])
            if not far:
                share = 0.64 if at_rim else 1.0
                arrival, slope, own = _mirror(axis, facet, (bend_u[j, i], bend_v[j, i]), 0.6 * g, best, share, ear)
                if arrival < best:
                    best, kind, bj, bi, gain, spread = arrival, MIRROR, j, i, slope, own
            # An edge answers where it runs across the way to the sensor, and nowhere else.
            askew = abs(pull_u * along[j, i, 0] + pull_v * along[j, i, 1]) > 0.6 * g + slack
            if at_rim and not askew:
                arrival, slope, own = _from_rim(axis, facet, (rim[j, i, 0], rim[j, i, 1]), g, best, ear)
                if arrival < best:
                    best, kind, bj, bi, gain, spread = arrival, RIM, j, i, slope, own
    return best, kind, bj, bi, gain, spread


@compiled
def predict(
    rows: IntArray, station: FloatArray, measured: tuple[FloatArray, FloatArray], surface: Surface, ear: Hearing,
    out: FloatArray, cell: IntArray,
) -> None:  # fmt: skip
    """First arrivals at the stations `rows`, into out (M, 3: range, d range / d height, scatter) and cell (M, 3).

    `station` (M, 6) holds positions and axes, `measured` ranges and levels (M,), `cell` kind, row and column.
    """
    range_m, level = measured
    for q in rows:
        best, kind, j, i, gain, spread = predict_one(station[q], range_m[q], level[q], surface, ear)
        out[q, 0], out[q, 1], out[q, 2] = best, gain, spread
        cell[q, 0], cell[q, 1], cell[q, 2] = kind, j, i
