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

from surfuse.confidence.outline_view import eye_of, seen_at
from surfuse.confidence.parameters import check_within
from surfuse.geometry.compiled import compiled
from surfuse.geometry.polygons import signed_distance_at, signed_distances_into
from surfuse.geometry.poses import inverse
from surfuse.records import FloatArray, FusionScene, Gap, Gate, IntArray, Outline, Status
from surfuse.records.kernel_columns import ScanColumns

NO_ECHO, TOO_CLOSE, FAULT = int(Status.NO_ECHO), int(Status.TOO_CLOSE), int(Status.FAULT)
PASSED, GATE_NO_ECHO, GATE_TOO_CLOSE, GATE_FAULT = (
    int(Gate.PASSED),
    int(Gate.NO_ECHO),
    int(Gate.TOO_CLOSE),
    int(Gate.FAULT),
)
GATE_RANGE, GATE_OUTSIDE, GATE_BEHIND = int(Gate.OUT_OF_RANGE), int(Gate.OUTSIDE_PART), int(Gate.BEHIND_CELL)
NO_VALID_READING, OUTSIDE_PART = int(Gap.NO_VALID_READING), int(Gap.OUTSIDE_PART)


OUTLINE_TOLERANCE_M = 20e-6
"""How far the outline may move when needless vertices go: a hundredth of a good camera's error."""


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
    the first the boundary, the others holes. `eye_m` (4,) is where the camera saw the outline from, in its frame
    (w = 0: the outline is seen along w), and the outline's lowest v, its foot.

    `range_min_m`, `range_max_m`, `sigma_m` (S,) are those of the specs, `depth_max_m` the deepest reading that counts.
    `vertices` (P, 2) in m lie in the frame of the outline, which has been enlarged by `margin_m`; `outline_from_world`
    and `part_from_world` are (4, 4). `footprints` and `allowance_m` are those of `GateParameters`.
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
    eye_m: FloatArray
    part_from_world: FloatArray
    footprints: float
    allowance_m: float


def without_needless_vertices(ring: FloatArray, tolerance_m: float = OUTLINE_TOLERANCE_M) -> FloatArray:
    """A ring (P, 2) without the vertices that lie within a tolerance of the chord over them (Ramer 1972).

    A camera outline with a vertex every few millimetres along straight edges becomes as cheap as its corners.
    """
    far = int(np.argmax(np.sum((ring - ring[0]) ** 2, axis=1)))
    closed = np.vstack([ring, ring[:1]])
    keep = np.zeros(len(closed), dtype=np.bool_)
    keep[[0, far, len(ring)]] = True
    pending = [(0, far), (far, len(ring))]
    while pending:
        a, b = pending.pop()
        if b - a < 2:
            continue
        chord, inner = closed[b] - closed[a], closed[a + 1 : b] - closed[a]
        length = float(np.hypot(*chord))
        beyond = np.hypot(*inner.T)
        if length > 0.0:
            t = np.clip(inner @ chord / length**2, 0.0, 1.0)
            beyond = np.hypot(*(inner - t[:, np.newaxis] * chord).T)
        k = int(np.argmax(beyond))
        if beyond[k] > tolerance_m:
            keep[a + 1 + k] = True
            pending += [(a, a + 1 + k), (a + 1 + k, b)]
    kept = closed[:-1][keep[:-1]]
    return kept if len(kept) >= 3 else ring


def _rings(outline: Outline | None) -> tuple[FloatArray, IntArray]:
    if outline is None:
        return np.zeros((0, 2)), np.zeros(1, dtype=np.int64)
    rings = [without_needless_vertices(ring) for ring in (outline.vertices_m, *outline.holes_m)]
    ends = np.cumsum([len(ring) for ring in rings], dtype=np.int64)
    return np.ascontiguousarray(np.concatenate(rings)), np.concatenate([np.zeros(1, dtype=np.int64), ends])


def limits_of(scene: FusionScene, parameters: GateParameters) -> Limits:
    """The scene and the parameters of validation as the kernels take them.

    Without an outline there are no rings, and no reading is refused for lying beside the part.
    """
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
        eye_m=eye_of(scene.outline),
        part_from_world=inverse(scene.world_from_part),
        footprints=float(parameters.gate_footprints),
        allowance_m=float(parameters.gate_allowance_m),
    )


@compiled
def outside_holes(u: float, v: float, vertices: FloatArray, ring: IntArray) -> float:
    """Signed distance of (u, v) to the nearest hole of the outline: positive outside of all holes, +inf without any."""
    nearest = np.inf
    for k in range(1, ring.shape[0] - 1):
        nearest = min(nearest, -signed_distance_at(u, v, vertices[ring[k] : ring[k + 1]]))
    return nearest


@compiled
def _inside(
    u: FloatArray, v: FloatArray, vertices: FloatArray, ring: IntArray, margin: float, inside_m: FloatArray
) -> None:
    """Signed distance of points (N,) to the outline before its margin, holes counting as outside; inf without one."""
    n, n_rings = u.shape[0], ring.shape[0] - 1
    if n_rings < 1:
        inside_m[:n] = np.inf
        return
    signed_distances_into(u, v, vertices[: ring[1]], inside_m)
    for k in range(n):
        inside_m[k] -= margin
        if n_rings > 1:
            inside_m[k] = min(inside_m[k], outside_holes(u[k], v[k], vertices, ring))


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
    stops: tuple[int, int],
    gate: IntArray,
    value_m: FloatArray,
    sigma_m: FloatArray,
    inside_m: FloatArray,
) -> None:
    """Validate the readings of a range of stops and express each as a range along the grip axis.

    Writes the `Gate` code of reading i into `gate[i]` (N,). With s = i - (first reading of the first stop), writes into
    `value_m[s]` the place of its hit point on the grip axis, `sigma_m[s]` its standard deviation there, and
    `inside_m[s]` the signed distance of its footprint to the outline (without meaning where it failed earlier).

    The hit point p + r a is projected onto the grip axis (origin o, direction g): m = r (a.g) + (p - o).g. With
    sensors in the grip plane and axes parallel to the grip axis this is m = r, the measurement of the paper's
    equation 1. The footprint is the hit point as the camera saw it: off the plane w = 0, perspective draws the part too
    small or too large. Without a known viewpoint it is the hit point seen along w: for axes along w it does not depend
    on the range, and for turned wrists it is where the surface was met, not where the axis would pierce some reference
    plane.
    """
    ranges, status, sensors, positions, axes, own_sigma, start, _, grips = scan
    range_min, range_max, spec_sigma, spread, depth_max, vertices, ring, margin, outline, eye, _, footprints, allow = (
        limits
    )
    base = start[stops[0]]
    n = start[stops[1]] - base
    foot_u, foot_v = np.zeros(n), np.zeros(n)
    for j in range(stops[0], stops[1]):
        ox, oy, oz = grips[j, 0, 3], grips[j, 1, 3], grips[j, 2, 3]
        gx, gy, gz = grips[j, 0, 2], grips[j, 1, 2], grips[j, 2, 2]
        for i in range(start[j], start[j + 1]):
            r, sensor = ranges[i], sensors[i]
            gate[i] = _own_word(r, status[i])
            if gate[i] != PASSED:
                continue
            ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
            px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
            along = ax * gx + ay * gy + az * gz
            value = r * along + ((px - ox) * gx + (py - oy) * gy + (pz - oz) * gz)
            x, y, z = px + r * ax, py + r * ay, pz + r * az
            u = outline[0, 0] * x + outline[0, 1] * y + outline[0, 2] * z + outline[0, 3]
            v = outline[1, 0] * x + outline[1, 1] * y + outline[1, 2] * z + outline[1, 3]
            if not math.isfinite(value + u + v):
                gate[i] = GATE_FAULT
                continue
            if not range_min[sensor] <= r <= range_max[sensor]:
                gate[i] = GATE_RANGE
                continue
            w = outline[2, 0] * x + outline[2, 1] * y + outline[2, 2] * z + outline[2, 3]
            u, v = seen_at(u, v, w, eye)
            own = own_sigma[i]
            value_m[i - base], foot_u[i - base], foot_v[i - base] = value, u, v
            sigma_m[i - base] = (own if 0.0 < own < np.inf else spec_sigma[sensor]) * abs(along)
    _inside(foot_u, foot_v, vertices, ring, margin, inside_m)
    for i in range(base, base + n):
        if gate[i] == PASSED:
            if inside_m[i - base] < -(footprints * ranges[i] * spread[sensors[i]] + allow):
                gate[i] = GATE_OUTSIDE
            elif value_m[i - base] > depth_max or value_m[i - base] <= 0.0:
                gate[i] = GATE_BEHIND


@compiled
def gap_reason(gate: IntArray, first: int, last: int) -> int:
    """Why a stop without a valid reading is a gap: what was heard lay outside the part, or nothing was valid.

    `gate` (N,) of all readings, of which first to last - 1 are the stop's; a value of `Gap`.
    """
    for i in range(first, last):
        if gate[i] == GATE_OUTSIDE:
            return OUTSIDE_PART
    return NO_VALID_READING
