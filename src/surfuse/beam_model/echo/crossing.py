"""First crossing of a threshold by the envelope of a burst echo."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


@compiled
def first_crossings(impulse: FloatArray, burst: int, pole: float, threshold: float) -> tuple[FloatArray, FloatArray]:
    """First crossing (K,) of a threshold, in bins, and peak (K,) of the filtered envelope of each of K echoes.

    `impulse` (K, B, 2) is the complex echo by range bin; the burst is a boxcar of `burst` bins, the transducer a single
    pole that takes up the share `pole` of the difference at every bin. `threshold` and peaks are in units of the sum.
    Crossings lie between bins, by linear interpolation; nan where the envelope stays below.
    """
    rows, bins, _ = impulse.shape
    crossing = np.full(rows, np.nan)
    peak = np.zeros(rows)
    for k in range(rows):
        box_re = box_im = re = im = last = 0.0
        for b in range(bins):
            box_re += impulse[k, b, 0]
            box_im += impulse[k, b, 1]
            if b >= burst:
                box_re -= impulse[k, b - burst, 0]
                box_im -= impulse[k, b - burst, 1]
            re += pole * (box_re - re)
            im += pole * (box_im - im)
            envelope = np.sqrt(re * re + im * im)
            if envelope >= threshold and np.isnan(crossing[k]):
                crossing[k] = b + (threshold - last) / (envelope - last)
            peak[k] = max(peak[k], envelope)
            last = envelope
    return crossing, peak


class Beam(NamedTuple):
    """Sound of one `wavelength` (m); two-way `directivity` (K,) at equal steps of `angle_step` (rad) off the axis."""

    wavelength: float
    directivity: FloatArray
    angle_step: float


class RangeBins(NamedTuple):
    """`bins` steps of `bin_m` each by range; the first one begins at `origin_m`."""

    origin_m: float
    bin_m: float
    bins: int


@compiled
def plane_impulse(
    tilt: float, edge_m: float, range_m: float, beam: Beam, patch_m: float, half_m: float, by_range: RangeBins
) -> FloatArray:
    """Coherent echo (1, bins, 2), real and imaginary part by range, of a smooth plane.

    The plane crosses the axis at `range_m` and is turned by `tilt` (rad) about a line across it. It begins at `edge_m`
    beside the axis and reaches `half_m` to all sides, cut in patches of `patch_m`. Physical optics: each patch sends
    cos(incidence) D^2 area 2 / (wavelength range) with the phase of its path; an infinite facing plane then has
    amplitude 1.
    """
    wavelength, directivity, angle_step = beam
    origin_m, bin_m, bins = by_range
    echo = np.zeros((1, bins, 2))
    cos_tilt, sin_tilt = np.cos(tilt), np.sin(tilt)
    count = int(2.0 * half_m / patch_m)
    for a in range(count):
        along = -half_m + (a + 0.5) * patch_m
        x = along * cos_tilt
        if x < edge_m:
            continue
        depth = range_m - along * sin_tilt
        for b in range(count // 2):
            y = (b + 0.5) * patch_m
            rho = np.sqrt(x * x + y * y + depth * depth)
            theta = np.arccos(depth / rho) / angle_step
            k = int(theta)
            if k >= directivity.shape[0] - 1:
                continue
            two_way = directivity[k] + (theta - k) * (directivity[k + 1] - directivity[k])
            incidence = (depth * cos_tilt + x * sin_tilt) / rho
            amplitude = 2.0 * two_way * incidence * patch_m * patch_m * 2.0 / (wavelength * rho)
            place = int((rho - origin_m) / bin_m)
            if 0 <= place < bins:
                phase = 4.0 * np.pi * rho / wavelength
                echo[0, place, 0] += amplitude * np.cos(phase)
                echo[0, place, 1] += amplitude * np.sin(phase)
    return echo
