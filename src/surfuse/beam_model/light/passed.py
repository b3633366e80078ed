"""Readings that light itself contradicts: where many rays passed, and sensors stood, there is no surface.

Rays are counted in boxes of space by how many places they came from, so that a sensor that rested long counts once; a
single late echo drills no hole, because more readings end on the surface than pass through it.
"""

from __future__ import annotations

import numpy as np

from surfuse.beam_model.light.scatter import usable_rows
from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.records import BoolArray, FloatArray, FusionScene, IntArray, Readings

# Side of the boxes, in spots, in sigmas, and at least; and what is one place of a sensor.
BOX_SPOTS, BOX_SIGMAS, LEAST_BOX_M = 1.0, 4.0, 0.03
PLACE_M = 0.03
# A reading goes when so many more places saw through it than saw it.
MORE = 2.0
LEAST_PLACES = 3
MOST_STEPS = 400


def seen_through(scene: FusionScene, readings: Readings) -> BoolArray:
    """Readings (N,) that end where many rays of others passed below."""
    rows = np.flatnonzero(usable_rows(readings))
    gone = np.zeros(len(readings.range_m), dtype=np.bool_)
    if len(rows) < 2 * LEAST_PLACES:
        return gone
    part_from_world = inverse(scene.world_from_part)
    place = transform_points(part_from_world, readings.position_m[rows])
    axis = rotate_vectors(part_from_world, readings.axis[rows])
    range_m = readings.range_m[rows]
    half = 0.5 * np.array([spec.beam_full_angle_rad for spec in readings.specs])[readings.sensor[rows]]
    sigma = np.array([spec.sigma_m for spec in readings.specs])[readings.sensor[rows]]
    spot = float(np.median(range_m * np.tan(np.minimum(half, 1.0))))
    box = max(LEAST_BOX_M, BOX_SPOTS * spot, BOX_SIGMAS * float(np.median(sigma)))
    _, station = np.unique(np.floor(place / PLACE_M).astype(np.int64), axis=0, return_inverse=True)
    foot = np.floor((place + axis * range_m[:, None]) / box).astype(np.int64)
    through = _boxes_passed(place, axis, range_m - 1.5 * box, box, np.asarray(station.ravel(), dtype=np.int64))
    ends = np.unique(np.column_stack([foot, station.ravel()]), axis=0)
    gone[rows] = _outvoted(foot, _counted(ends[:, :3]), _counted(through))
    return gone


def _boxes_passed(place: FloatArray, axis: FloatArray, length_m: FloatArray, box_m: float, station: IntArray
                  ) -> IntArray:  # fmt: skip
    """Boxes (K, 3) that rays pass, once for each place of a sensor."""
    found = []
    longest = float(np.max(length_m, initial=0.0))
    for k in range(min(MOST_STEPS, int(longest / box_m) + 1)):
        on = length_m >= k * box_m
        at = np.floor((place[on] + axis[on] * (k * box_m)) / box_m).astype(np.int64)
        found.append(np.unique(np.column_stack([at, station[on]]), axis=0))
    if not found:
        return np.zeros((0, 3), dtype=np.int64)
    return np.asarray(np.unique(np.concatenate(found), axis=0)[:, :3], dtype=np.int64)


def _counted(boxes: IntArray) -> dict[tuple[int, int], dict[int, int]]:
    """How often each box comes, by column (u, v) and level."""
    unique, count = np.unique(boxes, axis=0, return_counts=True) if len(boxes) else (boxes, np.zeros(0, dtype=int))
    columns: dict[tuple[int, int], dict[int, int]] = {}
    for (i, j, k), n in zip(unique.tolist(), count.tolist(), strict=True):
        columns.setdefault((i, j), {})[k] = n
    return columns


def _outvoted(
    foot: IntArray, ends: dict[tuple[int, int], dict[int, int]], passed: dict[tuple[int, int], dict[int, int]]
) -> BoolArray:
    """Which feet (N, 3) lie above a level that more places saw through than saw the foot."""
    boxes, back = np.unique(foot, axis=0, return_inverse=True)
    verdict = np.zeros(len(boxes), dtype=np.bool_)
    for n, (i, j, k) in enumerate(boxes.tolist()):
        hits = sum(ends.get((i, j), {}).get(k + d, 0) for d in (-1, 0, 1))
        below = max((count for level, count in passed.get((i, j), {}).items() if level < k - 1), default=0)
        verdict[n] = below >= LEAST_PLACES and below > MORE * hits
    return np.asarray(verdict[back.ravel()], dtype=np.bool_)
