"""Selection by slope: which candidates are dominant points.

A candidate is dominant where the slopes fitted to the contour on both sides differ like those of a corner, or where
the polygon without it would leave the tolerance. Candidates go one by one, the straightest first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.vision.dominant_points.chords import Curve, farthest, turn
from surfuse.vision.dominant_points.order import first_least, take_out
from surfuse.vision.dominant_points.splitting import neighbours

_ANGLE_SLACK = 1e-9


class Corner(NamedTuple):
    """What keeps a vertex: `tolerance` of the polygon, a turn of `least_rad` with neighbours at `spacing` or more.

    Lengths are in columns; `slack` is the length below which two are the same.
    """

    tolerance: float
    least_rad: float
    spacing: float
    slack: float


@compiled
def selected(
    curve: Curve,
    vertices: IntArray,
    corner: Corner,
) -> IntArray:
    """Remove candidates that are neither corners nor needed, and the blunter of two that stand too close.

    `vertices` (K,) and the result are increasing indices into the curve; the ends of an open curve always stay.
    """
    vertices = vertices.copy()
    k = len(vertices)
    change = np.empty(k)
    for a in range(k):
        change[a] = _removal_order(curve, vertices, k, a, corner)
    while k > (3 if curve.closed else 2):
        best = first_least(change, k, _ANGLE_SLACK)
        if not math.isfinite(change[best]):
            break
        take_out(vertices, change, best, k)
        k -= 1
        for step in range(-1, 1):
            a = (best + step) % k
            change[a] = _removal_order(curve, vertices, k, a, corner)
    return vertices[:k].copy()


@compiled
def repaired(curve: Curve, vertices: IntArray, tolerance: float, slack: float) -> IntArray:
    """Add the farthest point of every chord that leaves the tolerance, until none does.

    `vertices` (K,) and the result are increasing indices into the curve; `tolerance` is in columns.
    """
    n = curve.n
    marked = np.zeros(n, dtype=np.bool_)
    for vertex in vertices:
        marked[vertex % n] = True
    stack = np.empty((n + 2, 2), dtype=np.int64)
    depth = 0
    k = len(vertices)
    for a in range(k if curve.closed else k - 1):
        stack[depth, 0] = vertices[a]
        stack[depth, 1] = vertices[a + 1] if a < k - 1 else vertices[0] + n
        depth += 1
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        where, distance = farthest(curve, i, j, slack)
        if distance > tolerance + slack:
            marked[where % n] = True
            stack[depth, 0], stack[depth, 1] = i, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, j
            depth += 2
    return np.flatnonzero(marked)


@compiled
def turns(curve: Curve, vertices: IntArray) -> FloatArray:
    """Change of the fitted slope at every vertex (rad); 0 at the ends of an open curve.

    `vertices` (K,) are indices into the curve, increasing; the result is (K,), without sign.
    """
    k = len(vertices)
    result = np.zeros(k)
    for a in range(k):
        if curve.closed or 0 < a < k - 1:
            before, after = neighbours(vertices, k, a, curve.n)
            result[a] = turn(curve, before, vertices[a], after)
    return result


@compiled
def _removal_order(
    curve: Curve,
    vertices: IntArray,
    k: int,
    a: int,
    corner: Corner,
) -> float:
    """The turn of a vertex that may go (rad), inf for one that stays."""
    if not curve.closed and (a == 0 or a == k - 1):
        return math.inf
    before, after = neighbours(vertices, k, a, curve.n)
    here = vertices[a]
    angle = turn(curve, before, here, after)
    near = min(_distance(curve, before, here), _distance(curve, here, after))
    if angle >= corner.least_rad - _ANGLE_SLACK and near >= corner.spacing - corner.slack:
        return math.inf
    if farthest(curve, before, after, corner.slack)[1] > corner.tolerance + corner.slack:
        return math.inf
    return angle


@compiled
def _distance(curve: Curve, i: int, j: int) -> float:
    points, n = curve.points, curve.n
    return math.hypot(points[j % n, 0] - points[i % n, 0], points[j % n, 1] - points[i % n, 1])
