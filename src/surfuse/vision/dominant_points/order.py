"""A starting point and a direction that depend on the shape alone, so that all that follows does so too."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray

# Distances equal to this share of the largest count as equal: far above rounding, far below a pixel.
_RESOLUTION = 1e-7


def shape_order(points: FloatArray, closed: bool) -> IntArray:
    """Indices (N,) which read a contour from the point farthest from the centroid, in the direction of the shape.

    Among equally far points, and for the direction, the sequence of distances to the centroid decides (the largest in
    dictionary order). An open curve keeps its ends and only gets its direction.

    `points` (N, 2). The order does not depend on where the contour begins, on its direction, or on a turn of the
    picture.
    """
    offset = points - points.mean(axis=0)
    distance = np.hypot(offset[:, 0], offset[:, 1])
    scale = float(distance.max())
    signature = np.round(distance / (scale if scale > 0.0 else 1.0) / _RESOLUTION).astype(np.int64)
    n = len(points)
    forward = np.arange(n)
    backward = forward[::-1].copy()
    if closed:
        forward = np.roll(forward, -_largest_rotation(signature))
        backward = np.roll(backward, -_largest_rotation(signature[::-1].copy()))
    differs = np.flatnonzero(signature[forward] != signature[backward])
    if len(differs) and signature[backward[differs[0]]] > signature[forward[differs[0]]]:
        return backward
    return forward


@compiled
def _largest_rotation(signature: IntArray) -> int:
    """Start of the rotation that comes last in dictionary order (two competing starts, linear time)."""
    n = len(signature)
    i, j, k = 0, 1, 0
    while i < n and j < n and k < n:
        a, b = signature[(i + k) % n], signature[(j + k) % n]
        if a == b:
            k += 1
            continue
        if a > b:
            j += k + 1
        else:
            i += k + 1
        if i == j:
            j += 1
        k = 0
    return min(i, j)


@compiled
def take_out(vertices: IntArray, costs: FloatArray, at: int, count: int) -> None:
    """Close the gap that one of the first `count` vertices leaves, in place; the costs move with them.

    `vertices` and `costs` (count or more,); `at` is the place of the one that goes.
    """
    for a in range(at, count - 1):
        vertices[a] = vertices[a + 1]
        costs[a] = costs[a + 1]


@compiled
def first_least(values: FloatArray, count: int, slack: float) -> int:
    """Index of the least of the first `count` values; of values equal within `slack` the first.

    `values` (count or more,).
    """
    best, where = np.inf, 0
    for a in range(count):
        if values[a] < best - slack:
            best, where = values[a], a
    return where
