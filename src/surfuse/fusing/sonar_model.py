"""What one reading says about the cells of a column: likelihood ratio of occupied to empty, as log-odds.

The model is written out, with its sources, in `surfuse.fusion.occupancy`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.fusing.cones import shell
from surfuse.fusing.voxels import Columns
from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray

FAR = 4.0
"""Deviations from a reading beyond which a cell is empty, or says nothing."""

ENTRIES = 1024
"""Of the table of what an empty cell is worth; linear between them it is right to 1e-6."""


@compiled
def table_of_empty(detection: float) -> FloatArray:
    """ln(1 - alpha) for 1 - (angle / half angle)^2 = k / ENTRIES: most cells are far in front of the reading.

    (ENTRIES + 2,), the last two equal, so that an interpolation may reach one too far. `detection` is alpha.
    """
    return np.log1p(-detection * np.minimum(np.arange(ENTRIES + 2) / ENTRIES, 1.0))


@compiled
def evidence(z_m: float, range_m: float, alpha: float, share: float, delta_m: float, other_per_m: float) -> float:
    """Log likelihood ratio of occupied to empty for a cell at range z from a reading r (see the module).

    `share` is one over the cells of the cap, `other_per_m` is F in 1/m, all ranges in m. Deviations beyond `FAR` are
    cut: 0 behind the reading, ln(1 - alpha) in front of it.
    """
    x = (range_m - z_m) / delta_m
    if x < -FAR:
        return 0.0
    if x > FAR:
        return math.log1p(-alpha)
    density = math.exp(-0.5 * x * x) / (2.5066282746310002 * delta_m)
    before = 0.5 * math.erfc(-x / 1.4142135623730951)
    return math.log1p(alpha * share * density / other_per_m) + math.log1p(-alpha * before)


@compiled
def squared_angle(cosine: float) -> float:
    """Square of an angle from its cosine, by the series in 2 (1 - cosine): to 0.2 % up to 60 degrees, without asin."""
    c = 2.0 - 2.0 * cosine
    return c * (1.0 + c * (1.0 / 12.0 + c / 90.0))


@compiled
def share_of(
    s: FloatArray, a: FloatArray, r: float, spread: float, box: tuple[int, int, int, int], u: FloatArray, v: FloatArray
) -> float:
    """One over the columns of the cone's cap, each weighted by 1 - (angle / half angle)^2.

    `s` and `a` (3,) are start (m) and unit axis of the cone in the part frame, `r` its range (m), `spread` its half
    angle (rad); `box` bounds columns and rows as `columns_within` gives them. At most 1: a cap smaller than a cell is
    one cell.
    """
    total, (c0, c1, r0, r1) = 0.0, box
    for k in range(r0, r1):
        for c in range(c0, c1):
            _, angle = shell(u[c] - s[0], v[k] - s[1], a, r, spread)
            if angle < 1.0:
                total += 1.0 - angle * angle
    return 1.0 / max(total, 1.0)


class SonarModel(NamedTuple):
    """Sonar model of one reading: delta (m), F (1/m), alpha, share, and ln(1 - alpha) by 1 - (angle / half angle)^2.

    `empty` (ENTRIES + 2,) is `table_of_empty(detection)`; it is the same for all readings.
    """

    delta_m: float
    other_per_m: float
    detection: float
    share: float
    empty: FloatArray


@compiled
def along_axis(column: FloatArray, z: Columns, foot: float, slant: float, r: float, m: SonarModel) -> None:
    """Add to the log-odds of a column (Z,) what a sensor says that measures along its axis, range r (m).

    Its axis meets the column at height `foot` (m); `slant` is the axis' share along w.
    """
    for q in range(column.shape[0]):
        # Along a slanted axis a height of h is h / |a_w| of range.
        cell = r + (foot - z.bottom_m - q * z.height_m) / abs(slant)
        column[q] += evidence(cell, r, m.detection, 1.0, m.delta_m, m.other_per_m)


class Beside(NamedTuple):
    """Where a column stands seen from the start of a beam: (du, dv) beside it, the start at this height over w = 0."""

    du_m: float
    dv_m: float
    height_m: float


@compiled
def in_cone(
    column: FloatArray, voxels: Columns, beside: Beside, a: FloatArray, r: float, spread: float, m: SonarModel
) -> None:
    """Add to the log-odds of a column (Z,) what a cone says: unit axis a (3,), range r (m), half angle `spread` (rad).

    Voxels outside of the cone, behind its start, or far beyond the range are left as they are.
    """
    bottom, size = voxels.bottom_m, voxels.height_m
    du, dv, height = beside.du_m, beside.dv_m, beside.height_m
    side, behind = du * du + dv * dv, r + FAR * m.delta_m
    if side >= behind * behind:
        return
    cos_edge, per_square = math.cos(spread), 1.0 / (spread * spread)
    lowest = height - math.sqrt(behind * behind - side)
    for q in range(max(0, int(np.ceil((lowest - bottom) / size))), column.shape[0]):
        drop = height - bottom - q * size
        z = math.sqrt(side + drop * drop)
        cosine = (du * a[0] + dv * a[1] - drop * a[2]) / max(z, 1e-9)
        if drop <= 0.0 or cosine < cos_edge:
            continue
        across = 1.0 - squared_angle(cosine) * per_square
        if across <= 0.0:
            continue
        if r - z > FAR * m.delta_m:
            place = across * ENTRIES
            entry = int(place)
            column[q] += m.empty[entry] + (place - entry) * (m.empty[entry + 1] - m.empty[entry])
        else:
            column[q] += evidence(z, r, m.detection * across, m.share, m.delta_m, m.other_per_m)
