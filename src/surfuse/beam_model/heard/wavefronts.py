"""Oriented points straight from the readings: how the range changes with the place says where the foot is.

The gradient of a first arrival with respect to the position of the sensor is minus the unit vector towards the point
that was heard (eikonal equation; Born and Wolf, Principles of Optics, 3.1). So neighbouring places that hear the same
facet or rim tell where it is, without any model of the surface. In speckle neighbours disagree, and nothing is claimed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from surfuse.beam_model.heard.stations import Stations
from surfuse.confidence.agreement import median_of_sorted
from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray

NEIGHBOURS = 13
SMOOTH_FLOOR_M = 0.0004


@dataclass(frozen=True)
class Surfels:
    """What each station heard: `point_m`, `towards` (M, 3) unit vector from sensor to point, `scatter_m` (M,) of its
    neighbours about a common wavefront, `coherent` (M,) whether they share one.
    """

    point_m: FloatArray
    towards: FloatArray
    scatter_m: FloatArray
    coherent: BoolArray


class Heard(NamedTuple):
    """The stations as kernels take them: `position`, `axis` (M, 3), `range_m`, `sigma` (M,)."""

    position: FloatArray
    axis: FloatArray
    range_m: FloatArray
    sigma: FloatArray


class Neighbourhood(NamedTuple):
    """Room for the neighbours of one station: (K, 3) places across the axis and 1, (K,) later ranges, tolerances."""

    place: FloatArray
    later: FloatArray
    tolerance: FloatArray


@compiled
def _across(ax: float, ay: float, az: float) -> tuple[float, float, float, float, float, float]:
    """Two directions across an axis, and across each other."""
    if abs(ax) < 0.7:
        ex, ey, ez = 1.0 - ax * ax, -ax * ay, -ax * az
    else:
        ex, ey, ez = -ay * ax, 1.0 - ay * ay, -ay * az
    n = np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / n, ey / n, ez / n
    return ex, ey, ez, ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex


@compiled
def _gather(
    heard: Heard, q: int, neighbours: IntArray, across: tuple[float, float, float, float, float, float], floor: float,
    room: Neighbourhood,
) -> int:  # fmt: skip
    """Put the neighbours of station q (-1: none) into the room; returns how many there are."""
    position, axis = heard.position, heard.axis
    ex, ey, ez, fx, fy, fz = across
    m = 0
    for p in neighbours:
        if p < 0:
            continue
        dx, dy = position[p, 0] - position[q, 0], position[p, 1] - position[q, 1]
        dz = position[p, 2] - position[q, 2]
        room.place[m, 0] = dx * ex + dy * ey + dz * ez
        room.place[m, 1] = dx * fx + dy * fy + dz * fz
        room.place[m, 2] = 1.0
        along = dx * axis[q, 0] + dy * axis[q, 1] + dz * axis[q, 2]
        room.later[m] = heard.range_m[p] - heard.range_m[q] + along
        room.tolerance[m] = max(2.0 * heard.sigma[p], floor)
        m += 1
    return m


@compiled
def _plane(room: Neighbourhood, m: int) -> tuple[float, float, float]:
    """Slopes and offset of a plane through the first m neighbours: least squares with a redescending loss."""
    a, y, tol = room.place, room.later, room.tolerance
    gu = gv = g0 = 0.0
    for it in range(12):
        s00 = s01 = s02 = s11 = s12 = s22 = b0 = b1 = b2 = 0.0
        for k in range(m):
            e = y[k] - gu * a[k, 0] - gv * a[k, 1] - g0
            # Wide first, so that the first fit does not choose a side.
            scale = tol[k] * max(1.0, 16.0 / 2.0**it)
            w = 1.0 / (1.0 + (e / scale) ** 2) ** 2
            s00 += w * a[k, 0] * a[k, 0]
            s01 += w * a[k, 0] * a[k, 1]
            s02 += w * a[k, 0]
            s11 += w * a[k, 1] * a[k, 1]
            s12 += w * a[k, 1]
            s22 += w
            b0 += w * a[k, 0] * y[k]
            b1 += w * a[k, 1] * y[k]
            b2 += w * y[k]
        small = 1e-6 * (s00 + s11) + 1e-18
        s00 += small
        s11 += small
        d = s00 * (s11 * s22 - s12 * s12) - s01 * (s01 * s22 - s12 * s02) + s02 * (s01 * s12 - s11 * s02)
        if abs(d) < 1e-30:
            break
        gu = (b0 * (s11 * s22 - s12 * s12) - s01 * (b1 * s22 - s12 * b2) + s02 * (b1 * s12 - s11 * b2)) / d
        gv = (s00 * (b1 * s22 - s12 * b2) - b0 * (s01 * s22 - s12 * s02) + s02 * (s01 * b2 - b1 * s02)) / d
        g0 = (s00 * (s11 * b2 - s12 * b1) - s01 * (s01 * b2 - b1 * s02) + b0 * (s01 * s12 - s11 * s02)) / d
    return gu, gv, g0


@compiled
def _agreeing(room: Neighbourhood, m: int, plane: tuple[float, float, float], ordered: FloatArray) -> tuple[int, float]:
    """How many of the first m neighbours agree with a plane, and the median of their deviations."""
    gu, gv, g0 = plane
    agree = 0
    for k in range(m):
        deviation = abs(room.later[k] - gu * room.place[k, 0] - gv * room.place[k, 1] - g0)
        if deviation < 3.0 * room.tolerance[k]:
            agree += 1
        at = k
        while at > 0 and ordered[at - 1] > deviation:
            ordered[at] = ordered[at - 1]
            at -= 1
        ordered[at] = deviation
    return agree, median_of_sorted(ordered, m)


@compiled
def wavefronts(
    heard: Heard, neighbour: IntArray, floor: float, steepest: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Local robust fits of a plane wavefront; `neighbour` (M, K) of every station, -1 for none.

    Returns the direction towards the foot (M, 3), the scatter (M,) and the number of neighbours that agree (M,).
    """
    count, width = neighbour.shape
    towards = heard.axis.copy()
    scatter = np.full(count, np.inf)
    agree = np.zeros(count, dtype=np.int64)
    room = Neighbourhood(np.zeros((width, 3)), np.zeros(width), np.zeros(width))
    ordered = np.zeros(width)
    for q in range(count):
        ax, ay, az = heard.axis[q, 0], heard.axis[q, 1], heard.axis[q, 2]
        across = _across(ax, ay, az)
        m = _gather(heard, q, neighbour[q], across, floor, room)
        if m < 5:
            continue
        gu, gv, g0 = _plane(room, m)
        agree[q], median = _agreeing(room, m, (gu, gv, g0), ordered)
        scatter[q] = 1.4826 * median
        side = np.sqrt(gu * gu + gv * gv)
        # The station itself must lie on the wavefront that its neighbours draw.
        if agree[q] < 0.6 * m or abs(g0) > 3.0 * room.tolerance[0] or side > steepest[q]:
            agree[q] = 0
            continue
        along = np.sqrt(1.0 - side * side)
        ex, ey, ez, fx, fy, fz = across
        towards[q, 0] = along * ax - gu * ex - gv * fx
        towards[q, 1] = along * ay - gu * ey - gv * fy
        towards[q, 2] = along * az - gu * ez - gv * fz
    return towards, scatter, agree


def find_surfels(stations: Stations, spacing_m: float, steepest: FloatArray) -> Surfels:
    """Wavefronts of all stations; `steepest` (M,) is the sine of the largest off-axis angle at which they hear."""
    count = len(stations)
    if count < 6 or not np.isfinite(spacing_m):
        return Surfels(stations.foot_m, stations.axis, np.full(count, np.inf), np.zeros(count, dtype=bool))
    width = min(NEIGHBOURS, count)
    tree = cKDTree(stations.position_m)
    distance, index = tree.query(stations.position_m, k=width, distance_upper_bound=2.3 * spacing_m)
    neighbour = np.where(np.isfinite(distance), index, -1).astype(np.int64)
    other = stations.spec[np.maximum(neighbour, 0)]
    neighbour = np.where(other == stations.spec[:, None], neighbour, -1)
    heard = Heard(stations.position_m, stations.axis, stations.range_m, stations.sigma_m)
    towards, scatter, agree = wavefronts(heard, neighbour, SMOOTH_FLOOR_M, steepest)
    point = stations.position_m + towards * stations.range_m[:, None]
    return Surfels(point, towards, scatter, agree >= 4)
