"""The outline as the array will see it, along w, from the outline as the camera saw it, from one place.

The camera's rays spread, and a part has depth. But it stands on the table: where its lowest points are seen says how
far in front of or behind the plane w = 0 its foot is, and sides that stand upright are as far away as their foot.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surfuse.geometry.polygons import counter_clockwise
from surfuse.geometry.untangling import untangled
from surfuse.records import BoolArray, FloatArray, Outline

_SPACING_M = 0.004
_POINTS_MAX = 1500
_DEEPEST_M = 0.15
_STEEPEST_FOOT = 6.0
_HEIGHT_MIN_M = 0.02
_STRAIGHT_M = 0.0005


@dataclass(frozen=True)
class FrontView:
    """The part as seen along w: `vertices_m` (Q, 2) u, v, and `relief_m`, the spread of its foot around w = 0."""

    vertices_m: FloatArray
    relief_m: float


def front_view(outline: Outline) -> FrontView:
    """The outline as the array will see it.

    Each boundary point moves along its ray to where the foot below it stands; where nothing stands on the table within
    0.15 m of the plane (an overhang), to where the nearest foot beside it does. Without a viewpoint, or with a camera
    that is not above the table, nothing moves.
    """
    eye = outline.viewpoint_m
    if eye is None or eye[1] < _HEIGHT_MIN_M or eye[2] <= 0.0:
        return FrontView(outline.vertices_m, 0.0)
    points, foot = _densified(outline.vertices_m)
    # A ray through height v of the plane meets the table v = 0 at this multiple of its length to the plane.
    to_table = eye[1] / np.maximum(eye[1] - points[:, 1], 0.1 * eye[1])
    stands = foot & (np.abs(eye[2] * (to_table - 1.0)) <= _DEEPEST_M)
    if not np.any(stands):
        return FrontView(outline.vertices_m, 0.0)
    order = np.argsort(points[stands, 0], kind="stable")
    beside = np.interp(points[:, 0], points[stands, 0][order], to_table[stands][order])
    reach = np.where(stands, to_table, beside)
    moved = _simplified(eye[:2] + reach[:, None] * (points - eye[:2]))
    relief = float(np.std(eye[2] * (1.0 - to_table[stands])))
    return FrontView(moved, relief) if len(moved) >= 3 else FrontView(outline.vertices_m, 0.0)


def _simplified(points: FloatArray) -> FloatArray:
    """A simple polygon with few vertices, within half a millimetre of the points."""
    few = cv2.approxPolyDP(points.astype(np.float32).reshape(-1, 1, 2), _STRAIGHT_M, True)
    polygon = np.asarray(few, dtype=np.float64).reshape(-1, 2)
    return polygon[untangled(polygon)]


def _densified(vertices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Points (M, 2) along all edges, the vertices among them, and which may be the foot (M,)."""
    polygon = counter_clockwise(vertices)
    after = np.roll(polygon, -1, axis=0)
    length = np.linalg.norm(after - polygon, axis=1)
    spacing = max(_SPACING_M, float(length.sum()) / _POINTS_MAX)
    points, foot = [], []
    for start, end, pieces in zip(polygon, after, np.ceil(length / spacing).astype(int).tolist(), strict=True):
        # Both ends: a corner belongs to the foot and to the side that stands on it.
        share = np.linspace(0.0, 1.0, max(pieces, 1) + 1)[:, None]
        points.append(start + share * (end - start))
        foot.append(np.full(len(share), _may_be_foot(start, end, polygon, after)))
    return np.concatenate(points), np.concatenate(foot)


def _may_be_foot(start: FloatArray, end: FloatArray, polygon: FloatArray, after: FloatArray) -> bool:
    """Whether an edge of a counter-clockwise polygon runs along its underside, not too steeply, with nothing below."""
    along, up = (end - start).tolist()
    if along <= 0.0 or abs(up) > _STEEPEST_FOOT * along:
        return False
    u, v = (0.5 * (start + end)).tolist()
    over = (np.minimum(polygon[:, 0], after[:, 0]) <= u) & (np.maximum(polygon[:, 0], after[:, 0]) > u)
    a, b = polygon[over], after[over]
    heights = a[:, 1] + (b[:, 1] - a[:, 1]) * (u - a[:, 0]) / (b[:, 0] - a[:, 0])
    return bool(heights.min(initial=np.inf) >= v - 1e-9)
