"""An independent maker of scans: physical optics of a matte part, shared with neither the twin nor any fusion method.

The echo is the coherent sum over patches of one millimetre: a mirror-like part (Kirchhoff) and a diffuse part whose
complex amplitude belongs to the patch, so that speckle moves with the surface. Patches behind others are in shadow. The
sum is weighted with the piston's directivity, convolved with a burst of sixteen cycles and the transducer's rise, and
read at the first crossing of a threshold.
"""

from __future__ import annotations

import numpy as np
from judged_scenes import STEP_M, Array, JudgedScene
from numba import njit
from scipy.special import j1

WAVELENGTH_M = 343.2 / 63e3
CYCLES, RISE_M, THRESHOLD, DIFFUSE_M = 16, 0.011, 0.0145, 0.65e-3
NEAREST_M, BIN_M, BINS = 0.15, 0.0002, 4250
WIDEST_RAD = np.radians(40.0)


@njit(cache=True, nogil=True)
def in_shadow(
    height: Array, u0: float, v0: float, g: float, sx: float, sy: float, sz: float, x: float, y: float, z: float
) -> bool:
    """Whether the part stands between a sensor and a patch."""
    rows, columns = height.shape
    steps = int(np.sqrt((x - sx) ** 2 + (y - sy) ** 2) / (1.5 * g)) + 1
    for k in range(1, steps):
        f = k / steps
        level = sz + (z - sz) * f
        i, j = int((sx + (x - sx) * f - u0) / g + 0.5), int((sy + (y - sy) * f - v0) / g + 0.5)
        if 0 <= i < columns and 0 <= j < rows and height[j, i] > level + 0.0015:
            return True
    return False


@njit(cache=True, nogil=True)
def first_echoes(
    position: Array, axis: Array, patch: Array, normal: Array, area: Array, grain: Array, directivity: Array,
    height: Array, u0: float, v0: float, g: float, shaded: bool,
) -> tuple[Array, Array]:  # fmt: skip
    """Range (M,) of the first crossing (inf: none) and peak amplitude (M,; 1: a facing plate)."""
    count, half_circle = len(position), np.pi / 2
    pole = 1.0 - np.exp(-BIN_M / RISE_M)
    burst = int(CYCLES * WAVELENGTH_M / 2 / BIN_M)
    whole = 1.0 - np.exp(-burst * BIN_M / RISE_M)
    calibration = -np.log(1.0 - THRESHOLD) * RISE_M + 0.00013
    range_m, amplitude = np.full(count, np.inf), np.full(count, np.nan)
    real, imag = np.zeros(BINS), np.zeros(BINS)
    widest = np.cos(WIDEST_RAD)
    for q in range(count):
        real[:] = 0.0
        imag[:] = 0.0
        for p in range(len(patch)):
            dx, dy, dz = patch[p, 0] - position[q, 0], patch[p, 1] - position[q, 1], patch[p, 2] - position[q, 2]
            r = np.sqrt(dx * dx + dy * dy + dz * dz)
            ahead = (dx * axis[q, 0] + dy * axis[q, 1] + dz * axis[q, 2]) / r
            facing = -(dx * normal[p, 0] + dy * normal[p, 1] + dz * normal[p, 2]) / r
            b = int((r - NEAREST_M) / BIN_M)
            if ahead < widest or facing <= 0.02 or b < 0 or b >= BINS:
                continue
            if shaded and in_shadow(
                height, u0, v0, g, position[q, 0], position[q, 1], position[q, 2], patch[p, 0], patch[p, 1], patch[p, 2]
            ):
                continue
            beam = directivity[int(np.arccos(min(1.0, ahead)) / half_circle * (len(directivity) - 1))]
            share = beam * 2.0 / (WAVELENGTH_M * r) * area[p]
            ar, ai = share * (facing + np.sqrt(facing) * grain[p, 0]), share * np.sqrt(facing) * grain[p, 1]
            c, s = np.cos(4.0 * np.pi * r / WAVELENGTH_M), np.sin(4.0 * np.pi * r / WAVELENGTH_M)
            real[b] += ar * c - ai * s
            imag[b] += ar * s + ai * c
        box_r = box_i = out_r = out_i = peak = last = 0.0
        first = -1.0
        for b in range(BINS):
            box_r += real[b]
            box_i += imag[b]
            if b >= burst:
                box_r -= real[b - burst]
                box_i -= imag[b - burst]
            out_r += pole * (box_r - out_r)
            out_i += pole * (box_i - out_i)
            envelope = np.sqrt(out_r * out_r + out_i * out_i)
            if first < 0.0 and envelope >= THRESHOLD * whole:
                first = NEAREST_M + (b + (THRESHOLD * whole - last) / (envelope - last + 1e-15)) * BIN_M
            peak = max(peak, envelope)
            last = envelope
        if first > 0.0:
            range_m[q], amplitude[q] = first - calibration, peak / whole
    return range_m, amplitude


def scan_by_optics(scene: JudgedScene, position: Array, axis: Array, aperture_m: float, seed: int
                   ) -> tuple[Array, Array]:  # fmt: skip
    """Noise-free ranges and amplitudes of one surface, whose roughness depends on the seed."""
    d = 0.5 * STEP_M if scene.wrist_deg > 30.0 else STEP_M
    u, v = (np.arange(-h + d / 2, h, d) for h in scene.half_m)
    uu, vv = np.meshgrid(u, v)
    e = 1e-5
    slope_u = (scene.height(uu + e, vv) - scene.height(uu - e, vv)) / (2.0 * e)
    slope_v = (scene.height(uu, vv + e) - scene.height(uu, vv - e)) / (2.0 * e)
    wall = (np.abs(slope_u) > 3.0) | (np.abs(slope_v) > 3.0)
    slope_u, slope_v = np.where(wall, 0.0, slope_u), np.where(wall, 0.0, slope_v)
    on = scene.within(uu, vv)
    height = scene.height(uu, vv)
    stretch = np.sqrt(1.0 + slope_u**2 + slope_v**2)
    normal = np.stack([-slope_u / stretch, -slope_v / stretch, 1.0 / stretch], axis=-1)[on]
    area = (d * d * stretch)[on]
    rng = np.random.default_rng([seed, sum(map(ord, scene.name))])
    grain = rng.normal(size=(len(area), 2)) * (DIFFUSE_M / np.sqrt(area))[:, None]
    x = np.pi * aperture_m / WAVELENGTH_M * np.sin(np.linspace(0.0, np.pi / 2, 4000))
    beam = np.ones(len(x))
    beam[1:] = 2.0 * j1(x[1:]) / x[1:]
    patch = np.column_stack([uu[on], vv[on], height[on]])
    shaded = bool(np.any(wall)) or scene.group in ("step", "other")
    return first_echoes(position, axis, patch, normal, area, grain, beam**2, np.where(on, height, -9.0),
                        float(u[0]), float(v[0]), d, shaded)  # fmt: skip
