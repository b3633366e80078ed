"""What belongs to the part: the outline as the camera saw it, one rule for validation, methods and maps.

A point off the plane w = 0 of the outline's frame is seen from the camera's place: perspective draws the part too small
or too large. Where that place is unknown, the point is seen along w.
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, FloatArray, Outline

ON_TABLE_M = -1e-9
"""Points above this v stand on the table."""


def eye_of(outline: Outline | None) -> FloatArray:
    """Where the outline was seen from, in its frame, and its lowest v, the foot (4,); w = 0: the place is unknown."""
    if outline is None or outline.viewpoint_m is None or not outline.viewpoint_m[2] > 0.0:
        return np.zeros(4)
    return np.array([*outline.viewpoint_m, outline.vertices_m[:, 1].min() + outline.margin_m], dtype=np.float64)


@compiled
def seen_at(u: float, v: float, w: float, eye_m: FloatArray) -> tuple[float, float]:
    """Where the camera saw a point of the outline's frame, on the plane w = 0; `eye_m` (4,) as from `eye_of`."""
    if not eye_m[2] > 0.0:
        return u, v
    # At or behind the camera nothing is seen: the share of the way to the plane w = 0 is without bound.
    share = eye_m[2] / max(eye_m[2] - w, 1e-9)
    across, up = eye_m[0] + share * (u - eye_m[0]), eye_m[1] + share * (v - eye_m[1])
    # The part stands on the table (v = 0): above its foot nothing can be seen below it.
    return across, max(up, eye_m[3]) if v >= ON_TABLE_M else up


@compiled
def _seen(points_m: FloatArray, eye_m: FloatArray) -> FloatArray:
    seen = np.empty((points_m.shape[0], 2))
    for k in range(points_m.shape[0]):
        seen[k, 0], seen[k, 1] = seen_at(points_m[k, 0], points_m[k, 1], points_m[k, 2], eye_m)
    return seen


def on_part(points_m: FloatArray, world_from_points: FloatArray, outline: Outline) -> BoolArray:
    """Which points (N, 3) of a frame belong to the part: inside the outline before its margin, outside of its holes.

    A point belongs to the part up to the median standard deviation of the outline outside of it: the rim belongs to the
    part, and a node on it must not fall off by rounding. A mask (N,); `world_from_points` (4, 4) is the pose of the
    points' frame, points in m.
    """
    placed = transform_points(inverse(outline.world_from_part) @ world_from_points, points_m)
    seen = _seen(np.ascontiguousarray(placed), eye_of(outline))
    slack = float(np.median(outline.sigma_m)) + 1e-9
    inside = signed_distance(seen, outline.vertices_m) >= outline.margin_m - slack
    for hole in outline.holes_m:
        inside &= signed_distance(seen, hole) <= slack
    return np.asarray(inside, dtype=np.bool_)
