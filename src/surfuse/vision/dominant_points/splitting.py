"""Candidates for dominant points: Duda and Hart's iterative end-point fit, improved in three ways.

R. O. Duda, P. E. Hart, Pattern Classification and Scene Analysis, 1973, section 9.2. The improvements: a closed curve
is cut at points that are corners for sure; a deviation counts against the length of its chord, so that small sharp
features survive beside long smooth ones; needless splits, left over from earlier and worse chords, are merged.
"""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import IntArray
from surfuse.vision.dominant_points.chords import Curve, chord_error, farthest
from surfuse.vision.dominant_points.order import first_least, take_out

_CHORD_SHARE = 0.05
_TOLERANCE_SHARE_MIN = 0.5
_TOLERANCE_SHARE_MAX = 0.7


@compiled
def split_limit(curve: Curve, i: int, j: int, tolerance: float) -> float:
    """The deviation that splits a chord: a twentieth of its length, within 50 and 70 % of the tolerance."""
    points, a = curve.points, i % curve.n
    dx, dy = points[a + j - i, 0] - points[a, 0], points[a + j - i, 1] - points[a, 1]
    limit = _CHORD_SHARE * math.sqrt(dx * dx + dy * dy)
    return min(max(limit, _TOLERANCE_SHARE_MIN * tolerance), _TOLERANCE_SHARE_MAX * tolerance)


@compiled
def candidates(curve: Curve, tolerance: float, slack: float) -> IntArray:
    """Candidate vertices, increasing: of an open curve with both ends, of a closed one at least 3.

    Points are in shape order: point 0 of a closed curve is the farthest from its centroid, hence on its convex hull.

    Indices (K,) into the curve. `tolerance` is the largest distance (columns) of a point from its chord, `slack` the
    one below which two are the same.
    """
    n = curve.n
    marked = np.zeros(n, dtype=np.bool_)
    marked[0] = True
    stack = np.empty((n + 2, 2), dtype=np.int64)
    if curve.closed:
        opposite = _farthest_from_start(curve, slack)
        marked[opposite] = True
        stack[0, 0], stack[0, 1] = 0, opposite
        stack[1, 0], stack[1, 1] = opposite, n
        depth = 2
    else:
        marked[n - 1] = True
        stack[0, 0], stack[0, 1] = 0, n - 1
        depth = 1
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        where, distance = farthest(curve, i, j, slack)
        if distance > split_limit(curve, i, j, tolerance) + slack:
            marked[where] = True
            stack[depth, 0], stack[depth, 1] = i, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, j
            depth += 2
    return _merged(curve, tolerance, slack, np.flatnonzero(marked))


@compiled
def _farthest_from_start(curve: Curve, slack: float) -> int:
    best, where = -1.0, 1
    points = curve.points
    for k in range(1, curve.n):
        distance = math.hypot(points[k, 0] - points[0, 0], points[k, 1] - points[0, 1])
        if distance > best + slack:
            best, where = distance, k
    return where


@compiled
def _merged(curve: Curve, tolerance: float, slack: float, vertices: IntArray) -> IntArray:
    """Remove vertices whose neighbours see each other within the limit, the cheapest first."""
    k = len(vertices)
    rise = np.empty(k)
    for a in range(k):
        rise[a] = merge_rise(curve, vertices, k, a, tolerance, slack)
    while k > (3 if curve.closed else 2):
        best = first_least(rise, k, slack)
        if not math.isfinite(rise[best]):
            break
        take_out(vertices, rise, best, k)
        k -= 1
        for a in ((best - 1) % k, best % k):
            rise[a] = merge_rise(curve, vertices, k, a, tolerance, slack)
    return vertices[:k].copy()


@compiled
def merge_rise(
    curve: Curve,
    vertices: IntArray,
    k: int,
    a: int,
    tolerance: float,
    slack: float,
) -> float:
    """By how much the squared error rises when vertex a goes; inf where it must stay.

    `vertices` (k or more,) are indices into the curve; in squared columns.
    """
    if not curve.closed and (a == 0 or a == k - 1):
        return math.inf
    before, after = neighbours(vertices, k, a, curve.n)
    if farthest(curve, before, after, slack)[1] > split_limit(curve, before, after, tolerance) + slack:
        return math.inf
    here = vertices[a]
    split = chord_error(curve, before, here) + chord_error(curve, here, after)
    return chord_error(curve, before, after) - split


@compiled
def neighbours(vertices: IntArray, k: int, a: int, n: int) -> tuple[int, int]:
    """Vertices before and after vertex a of k, numbered so that before < vertex a < after.

    `vertices` (k or more,) are indices, increasing, of a closed curve of n points; the numbers may lie below 0 or
    beyond n.
    """
    before = vertices[a - 1] if a > 0 else vertices[k - 1] - n
    after = vertices[a + 1] if a < k - 1 else vertices[0] + n
    return before, after
