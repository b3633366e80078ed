"""Validation: which readings take part in the average, and why the others do not (paper, section 3.2).

The tests, in this order: the sensor's own word (no echo, too close, fault); the range that the sensor can
physically give; inside or outside of the part; consistency with the cell. No reading is changed or dropped: each
keeps the first reason for which it failed, as a `Gate` code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfuse.confidence.columns import ScanColumns
from surfuse.confidence.parameters import check_within
from surfuse.geometry.compiled import compiled
from surfuse.geometry.polygons import signed_distance_at
from surfuse.geometry.poses import inverse
from surfuse.records import FloatArray, FusionScene, Gap, Gate, IntArray, Outline, Status

NO_ECHO, TOO_CLOSE, FAULT = int(Status.NO_ECHO), int(Status.TOO_CLOSE), int(Status.FAULT)
PASSED, GATE_NO_ECHO, GATE_TOO_CLOSE, GATE_FAULT = (
    int(Gate.PASSED),
    int(Gate.NO_ECHO),
    int(Gate.TOO_CLOSE),
    int(Gate.FAULT),
)
GATE_RANGE, GATE_OUTSIDE, GATE_BEHIND = int(Gate.OUT_OF_RANGE), int(Gate.OUTSIDE_PART), int(Gate.BEHIND_CELL)
NO_VALID_READING, OUTSIDE_PART = int(Gap.NO_VALID_READING), int(Gap.OUTSIDE_PART)


@dataclass(frozen=True)
class GateParameters:
    """What validation allows.

    gate_footprints : how many beam radii the footprint's centre may lie outside the outline. With 1 a reading is
        refused only when no part of the beam meets the part, so rim readings stay and dc3 weighs them. No unit.
    gate_allowance_m : added to it, for the errors of the camera's outline (perspective, calibration; the margin
        of the paper's figure 6). Default 10 mm. Unit m.
    """

    gate_footprints: float = 1.0
    gate_allowance_m: float = 0.010

    def __post_init__(self) -> None:
        check_within("validation", "gate_footprints", self.gate_footprints, 0.0, float("inf"))
        check_within("validation", "gate_allowance_m", self.gate_allowance_m, 0.0, float("inf"))


class Limits(NamedTuple):
    """What is known before the first reading, in columns: S sensors, the outline's rings, the cell.

    `spread` (S,) is the tangent of half the beam angle; ring k of the outline is `vertices[ring[k]:ring[k + 1]]`,
    the first the boundary, the others holes.
    """

    range_min_m: FloatArray
    range_max_m: FloatArray
    sigma_m: FloatArray
    spread: FloatArray
    depth_max_m: float
    vertices: FloatArray
    ring: IntArray
    margin_m: float
    outline_from_world: FloatArray
    part_from_world: FloatArray
    footprints: float
    allowance_m: float


def _rings(outline: Outline | None) -> tuple[FloatArray, IntArray]:
    if outline is None:
        return np.zeros((0, 2)), np.zeros(1, dtype=np.int64)
    rings = [outline.vertices_m, *outline.holes_m]
    ends = np.cumsum([len(ring) for ring in rings], dtype=np.int64)
    return np.ascontiguousarray(np.concatenate(rings)), np.concatenate([np.zeros(1, dtype=np.int64), ends])


def limits_of(scene: FusionScene, parameters: GateParameters) -> Limits:
    """The scene and the parameters of validation as the kernels take them."""
    specs = scene.specs
    vertices, ring = _rings(scene.outline)
    outline_frame = scene.world_from_part if scene.outline is None else scene.outline.world_from_part
    # A full angle of 180 degrees has no finite footprint; 170 degrees is outside of every outline as well.
    half = np.minimum([spec.beam_full_angle_rad / 2.0 for spec in specs], np.radians(85.0))
    return Limits(
        range_min_m=np.array([spec.range_min_m for spec in specs], dtype=np.float64),
        range_max_m=np.array([spec.range_max_m for spec in specs], dtype=np.float64),
        sigma_m=np.array([spec.sigma_m for spec in specs], dtype=np.float64),
        spread=np.tan(np.asarray(half, dtype=np.float64)),
        depth_max_m=float(scene.depth_max_m),
        vertices=vertices,
        ring=ring,
        margin_m=0.0 if scene.outline is None else float(scene.outline.margin_m),
        outline_from_world=inverse(outline_frame),
        part_from_world=inverse(scene.world_from_part),
        footprints=float(parameters.gate_footprints),
        allowance_m=float(parameters.gate_allowance_m),
    )


@compiled
def inside_outline(u: float, v: float, limits: Limits) -> float:
    """Signed distance in m of (u, v) to the boundary of the part: positive on it, +inf when no outline is known."""
    if limits.ring.shape[0] < 2:
        return np.inf
    nearest = signed_distance_at(u, v, limits.vertices[: limits.ring[1]]) - limits.margin_m
    for k in range(1, limits.ring.shape[0] - 1):
        hole = signed_distance_at(u, v, limits.vertices[limits.ring[k] : limits.ring[k + 1]])
        nearest = min(nearest, -hole)
    return nearest


@compiled
def _own_word(reading_m: float, status: int) -> int:
    """Gate code of what the sensor itself says; the range and the status must both be good (REP-117)."""
    if reading_m == np.inf or status == NO_ECHO:
        return GATE_NO_ECHO
    if reading_m == -np.inf or status == TOO_CLOSE:
        return GATE_TOO_CLOSE
    if math.isnan(reading_m) or status != 0:
        return GATE_FAULT
    return PASSED


@compiled
def validate(
    scan: ScanColumns,
    limits: Limits,
    j: int,
    gate: IntArray,
    value_m: FloatArray,
    sigma_m: FloatArray,
    inside_m: FloatArray,
) -> int:
    """Validate the readings of stop j and express each as a range along the grip axis; returns how many passed.

    Writes the `Gate` codes into the rows of the stop in `gate` (N,), and for the s-th reading of the stop into
    `value_m[s]` the place of its hit point on the grip axis, `sigma_m[s]` its standard deviation there and
    `inside_m[s]` the signed distance of its footprint to the outline (nan where it failed earlier).

    The hit point p + r a is projected onto the grip axis (origin o, direction g): m = r (a.g) + (p - o).g. With
    sensors in the grip plane and axes parallel to the grip axis this is m = r, the measurement of the paper's
    equation 1. The footprint is the hit point seen along w: for axes along w it does not depend on the range, and
    for turned wrists it is where the surface was met, not where the axis would pierce some reference plane.
    """
    passed = 0
    pose, outline = scan.world_from_grip[j], limits.outline_from_world
    first = scan.start[j]
    for i in range(first, scan.start[j + 1]):
        s = i - first
        value_m[s], sigma_m[s], inside_m[s] = np.nan, np.nan, np.nan
        r, sensor = scan.range_m[i], scan.sensor[i]
        code = _own_word(r, scan.status[i])
        if code == PASSED:
            ax, ay, az = scan.axis[i, 0], scan.axis[i, 1], scan.axis[i, 2]
            px, py, pz = scan.position_m[i, 0], scan.position_m[i, 1], scan.position_m[i, 2]
            along = ax * pose[0, 2] + ay * pose[1, 2] + az * pose[2, 2]
            ahead = (px - pose[0, 3]) * pose[0, 2] + (py - pose[1, 3]) * pose[1, 2] + (pz - pose[2, 3]) * pose[2, 2]
            value = r * along + ahead
            x, y, z = px + r * ax, py + r * ay, pz + r * az
            u = outline[0, 0] * x + outline[0, 1] * y + outline[0, 2] * z + outline[0, 3]
            v = outline[1, 0] * x + outline[1, 1] * y + outline[1, 2] * z + outline[1, 3]
            if not math.isfinite(value + u + v):
                code = GATE_FAULT
            elif not limits.range_min_m[sensor] <= r <= limits.range_max_m[sensor]:
                code = GATE_RANGE
            else:
                inside = inside_outline(u, v, limits)
                value_m[s], inside_m[s] = value, inside
                own = scan.sigma_m[i]
                sigma_m[s] = (own if 0.0 < own < np.inf else limits.sigma_m[sensor]) * abs(along)
                if inside < -(limits.footprints * r * limits.spread[sensor] + limits.allowance_m):
                    code = GATE_OUTSIDE
                elif value > limits.depth_max_m or value <= 0.0:
                    code = GATE_BEHIND
                else:
                    passed += 1
        gate[i] = code
    return passed


@compiled
def gap_reason(gate: IntArray, first: int, last: int) -> int:
    """Why a stop without a valid reading is a gap: everything that was heard lay outside the part, or nothing was."""
    outside = False
    for i in range(first, last):
        if gate[i] == GATE_OUTSIDE:
            outside = True
    return OUTSIDE_PART if outside else NO_VALID_READING
