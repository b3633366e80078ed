"""Selection by slope: which candidates are dominant points.

A candidate is dominant where the slopes fitted to the contour on both sides differ like those of a corner, or where
the polygon without it would leave the tolerance. Candidates go one by one, the straightest first.
"""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray
from surfuse.vision.dominant_points.chords import farthest, turn
from surfuse.vision.dominant_points.order import first_least
from surfuse.vision.dominant_points.splitting import neighbours

_ANGLE_SLACK = 1e-9


@compiled
def selected(
    points: FloatArray,
    sums: FloatArray,
    n: int,
    closed: bool,
    vertices: IntArray,
    tolerance: float,
    corner_rad: float,
    spacing: float,
    slack: float,
) -> IntArray:
    """Remove candidates that are neither corners nor needed, and the blunter of two that stand too close."""
    vertices = vertices.copy()
    k = len(vertices)
    change = np.empty(k)
    for a in range(k):
        change[a] = _removal_order(points, sums, n, closed, vertices, k, a, tolerance, corner_rad, spacing, slack)
    while k > (3 if closed else 2):
        best = first_least(change, k, _ANGLE_SLACK)
        if not math.isfinite(change[best]):
            break
        vertices[best : k - 1] = vertices[best + 1 : k].copy()
        change[best : k - 1] = change[best + 1 : k].copy()
        k -= 1
        for step in range(-1, 1):
            a = (best + step) % k
            change[a] = _removal_order(points, sums, n, closed, vertices, k, a, tolerance, corner_rad, spacing, slack)
    return vertices[:k].copy()


@compiled
def repaired(points: FloatArray, n: int, closed: bool, vertices: IntArray, tolerance: float, slack: float) -> IntArray:
    """Add the farthest point of every chord that leaves the tolerance, until none does."""
    marked = np.zeros(n, dtype=np.bool_)
    for vertex in vertices:
        marked[vertex % n] = True
    stack = np.empty((n + 2, 2), dtype=np.int64)
    depth = 0
    k = len(vertices)
    for a in range(k if closed else k - 1):
        stack[depth, 0] = vertices[a]
        stack[depth, 1] = vertices[a + 1] if a < k - 1 else vertices[0] + n
        depth += 1
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        where, distance = farthest(points, n, i, j, slack)
        if distance > tolerance + slack:
            marked[where % n] = True
            stack[depth, 0], stack[depth, 1] = i, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, j
            depth += 2
    return np.flatnonzero(marked)


@compiled
def turns(points: FloatArray, sums: FloatArray, n: int, closed: bool, vertices: IntArray) -> FloatArray:
    """Change of the fitted slope at every vertex (rad); 0 at the ends of an open curve."""
    k = len(vertices)
    result = np.zeros(k)
    for a in range(k):
        if closed or 0 < a < k - 1:
            before, after = neighbours(vertices, k, a, n)
            result[a] = turn(points, sums, n, before, vertices[a], after)
    return result


@compiled
def _removal_order(
    points: FloatArray,
    sums: FloatArray,
    n: int,
    closed: bool,
    vertices: IntArray,
    k: int,
    a: int,
    tolerance: float,
    corner_rad: float,
    spacing: float,
    slack: float,
) -> float:
    """The turn of a vertex that may go (rad), inf for one that stays."""
    if not closed and (a == 0 or a == k - 1):
        return math.inf
    before, after = neighbours(vertices, k, a, n)
    here = vertices[a]
    angle = turn(points, sums, n, before, here, after)
    near = min(_distance(points, n, before, here), _distance(points, n, here, after))
    if angle >= corner_rad - _ANGLE_SLACK and near >= spacing - slack:
        return math.inf
    if farthest(points, n, before, after, slack)[1] > tolerance + slack:
        return math.inf
    return angle


@compiled
def _distance(points: FloatArray, n: int, i: int, j: int) -> float:
    return math.hypot(points[j % n, 0] - points[i % n, 0], points[j % n, 1] - points[i % n, 1])
