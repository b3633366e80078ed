"""Each echo put where the arcs of other echoes cross its own, by the median of the crossings.

Choset, Nagatani and Lazar, The Arc-Transversal Median Algorithm, IEEE Trans. Robotics and Automation 19(3) (2003)
513-521: an echo lies somewhere on an arc of equal range within the beam; arcs heard from other places cross it;
crossings at a large enough angle are kept, and their median along the arc is where the echo came from. The median is
not moved by a few stray readings. Here an arc is cut in two vertical slices, along u and along v, by the readings of
the same slice; the two bearings make the direction. An arc that nothing crosses keeps its middle (the modified variant)
or is left out (the original one). On a facing plate smaller than the reach of the beams most crossings lie towards its
middle, so that its rims come out too near: there the arcs touch the surface and do not cross on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.agreement import median_of_sorted
from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered
from surfuse.fusing.sites import at_least_scatter, between, median_sites
from surfuse.fusing.survey import Survey
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import BoolArray, FloatArray, IntArray, MapGrid

SUMMARY = "each echo where other arcs cross its own: arc-transversal median (Choset et al. 2003)"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the crossings.

    transversal_rad : least angle at which two arcs must cross. Default 30 degrees, as for the wide beams of mobile
        robots. Unit rad.
    transversal_share : the same as a share of the full beam angle; the smaller of the two holds. Default 1/4: a narrow
        beam has no crossings at 30 degrees. No unit.
    keep_lonely : whether an arc that nothing crosses keeps its middle.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    transversal_rad: float = math.pi / 6.0
    transversal_share: float = 0.25
    keep_lonely: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("arc_median", "transversal_rad", self.transversal_rad, 0.0, math.pi / 2.0)
        check_within("arc_median", "transversal_share", self.transversal_share, 0.0, 1.0)


class Arc(NamedTuple):
    """A reading in a vertical plane: start (x, z) and range r in m, unit axis (ax, az), half angle `spread` in rad."""

    x: float
    z: float
    ax: float
    az: float
    r: float
    spread: float


class Arcs(NamedTuple):
    """N arcs, each in the plane of its slice: the fields of `Arc` as arrays (N,)."""

    x: FloatArray
    z: FloatArray
    ax: FloatArray
    az: FloatArray
    r: FloatArray
    spread: FloatArray


@compiled
def crossing_bearing(arc: Arc, other: Arc, least: float) -> float:
    """Bearing off its axis (rad, positive towards +x for an axis along -z) where an arc is crossed by another.

    nan where the two, which lie in one plane, do not cross within both beams at an angle of at least `least` (rad).
    The angle between two circles is that between their radii.
    """
    r, other_r = arc.r, other.r
    dx, dz = other.x - arc.x, other.z - arc.z
    d = math.sqrt(dx * dx + dz * dz)
    if d <= 1e-9 or d >= r + other_r or d <= abs(r - other_r):
        return np.nan
    along = (d * d + r * r - other_r * other_r) / (2.0 * d)
    across = math.sqrt(max(r * r - along * along, 0.0))
    for side in (-1.0, 1.0):
        px = (along * dx - side * across * dz) / d
        pz = (along * dz + side * across * dx) / d
        qx, qz = px - dx, pz - dz
        bearing = math.atan2(arc.ax * pz - arc.az * px, arc.ax * px + arc.az * pz)
        from_other = math.atan2(other.ax * qz - other.az * qx, other.ax * qx + other.az * qz)
        between_radii = abs(math.atan2(px * qz - pz * qx, px * qx + pz * qz))
        transversal = least <= between_radii <= math.pi - least
        if transversal and abs(bearing) <= arc.spread and abs(from_other) <= other.spread:
            return bearing
    return np.nan


@compiled
def bearings(slice_of: IntArray, order: IntArray, arcs: Arcs, least: FloatArray) -> FloatArray:
    """Median bearing (N,) of the transversal crossings of each arc with those of its slice; nan where nothing crosses.

    `slice_of` (N,) is the number of each arc's slice; `order` (N,) sorts the arcs by slice, then by x. Two arcs must
    cross at the smaller of their `least` (N,) angles (rad). Bearings in rad, as in `crossing_bearing`.
    """
    x, z, ax, az, r, spread = arcs
    n = order.shape[0]
    result, found, widest = np.full(n, np.nan), np.empty(n), 0.0
    for i in range(n):
        widest = max(widest, r[i] * math.sin(min(spread[i], 1.5)))
    first = 0
    for place in range(n):
        i = order[place]
        if slice_of[order[first]] != slice_of[i]:
            first = place
        count, foot = 0, x[i] + r[i] * ax[i]
        arc = Arc(x[i], z[i], ax[i], az[i], r[i], spread[i])
        for step in (-1, 1):
            other = place + step
            while 0 <= other < n and slice_of[order[other]] == slice_of[i]:
                k = order[other]
                # Where the axes end, caps further apart than both radii cannot touch.
                if abs(x[k] - x[i]) > 2.0 * widest + abs(foot - x[i]) + abs(r[k] * ax[k]):
                    break
                crossed = Arc(x[k], z[k], ax[k], az[k], r[k], spread[k])
                bearing = crossing_bearing(arc, crossed, min(least[i], least[k]))
                if bearing == bearing:
                    found[count] = bearing
                    count += 1
                other += step
        if count > 0:
            found[:count] = np.sort(found[:count])
            result[i] = median_of_sorted(found, count)
    return result


def slice_bearings(heard: Survey, across: int, least_rad: FloatArray) -> FloatArray:
    """Median bearing (N,) in the vertical slice along u (`across` = 1: slices by v) or along v (`across` = 0).

    A slice is as thick as the distance between stops. In it an arc has its start, its axis laid into the slice, and the
    part of its range that lies in it. nan where nothing crosses; positive towards +u or +v.
    """
    along = 1 - across
    pitch = heard.spacing_m if np.isfinite(heard.spacing_m) and heard.spacing_m > 0.0 else 1.0
    position = heard.aim_m[:, across]
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * position / pitch)))) * pitch / (2.0 * np.pi)
    slice_of = np.round((position - phase) / pitch).astype(np.int64)
    start, axis = heard.start_m[:, along], heard.axis[:, along]
    in_slice = np.hypot(axis, heard.axis[:, 2])
    order = np.lexsort((start, slice_of)).astype(np.int64)
    arcs = Arcs(
        x=np.ascontiguousarray(start),
        z=np.ascontiguousarray(heard.start_m[:, 2]),
        ax=axis / in_slice,
        az=heard.axis[:, 2] / in_slice,
        r=heard.range_m * in_slice,
        spread=heard.spread_rad,
    )
    return bearings(slice_of, order, arcs, least_rad)


def moved(heard: Survey, bearing_u: FloatArray, bearing_v: FloatArray) -> FloatArray:
    """Points (N, 3) at the range of each reading, turned off its axis by bearings (N,) towards u and v."""
    turned = heard.axis.copy()
    for k, bearing in ((0, bearing_u), (1, bearing_v)):
        side = np.zeros(3)
        side[k] = 1.0
        direction = side - heard.axis[:, [k]] * heard.axis
        length = np.linalg.norm(direction, axis=1, keepdims=True)
        turned += np.tan(bearing)[:, None] * direction / np.maximum(length, 1e-9)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(heard.start_m + heard.range_m[:, None] * turned, dtype=np.float64)


def placed(heard: Survey, parameters: Parameters) -> tuple[FloatArray, BoolArray]:
    """Where each echo came from (N, 3), and which readings have such a place (N,)."""
    full = 2.0 * heard.spread_rad
    least = np.minimum(parameters.transversal_rad, parameters.transversal_share * full)
    along_u, along_v = slice_bearings(heard, 1, least), slice_bearings(heard, 0, least)
    lonely = np.isnan(along_u) & np.isnan(along_v) & (heard.spread_rad > 0.0)
    points = moved(heard, np.nan_to_num(along_u), np.nan_to_num(along_v))
    return points, ~lonely if not parameters.keep_lonely else np.ones(len(heard), dtype=np.bool_)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid)
        kept, nothing = heard.select(used), np.full(grid.shape, np.nan)
        points, have = placed(kept, parameters)
        used[np.flatnonzero(used)[~have]] = False
        if not np.any(have):
            return Estimate(nothing, nothing, used)
        sites = at_least_scatter(median_sites(points[have], kept.sigma_m[have], kept.spacing_m))
        wanted = covered(kept, grid)
        height, sigma = between(sites, grid, wanted)
        # How far an echo was moved along its arc is a doubt that all echoes of a place share.
        shift = np.abs(points[:, 2] - kept.foot_m[:, 2])[have]
        shifts = median_sites(np.column_stack([points[have, :2], shift]), kept.sigma_m[have], kept.spacing_m)
        return Estimate(height, np.hypot(sigma, between(shifts, grid, wanted)[0]), used)

    return mapwise("arc_median", parameters, estimate)
