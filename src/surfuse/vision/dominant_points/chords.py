"""What a chord between two contour points costs: squared error from running sums, farthest point, fitted slope.

Contour points are numbered along the traversal; on a closed curve the number of a point may be any integer, point
i and point i + n being the same. Arrays of a closed curve are stored twice over, so that every chord is one run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


class Curve(NamedTuple):
    """A contour of `n` points, as kernels take it: `points` centred and `sums` over them, twice over when `closed`.

    `points` (n or 2 n, 2) in columns, `sums` (n + 1 or 2 n + 1, 5) are `running_sums` of them.
    """

    points: FloatArray
    sums: FloatArray
    n: int
    closed: bool


def running_sums(points: FloatArray) -> FloatArray:
    """Running sums (N + 1, 5) of x, y, xx, yy, xy over points (N, 2) that should be centred, for the precision."""
    x, y = points[:, 0], points[:, 1]
    terms = np.column_stack([x, y, x * x, y * y, x * y])
    return np.concatenate([np.zeros((1, 5)), np.cumsum(terms, axis=0)])


@compiled
def chord_error(curve: Curve, i: int, j: int) -> float:
    """Sum of squared distances of the points strictly between i and j to the line through both (or to the point).

    i < j, which may run on beyond `n` on a closed curve; in squared columns.
    """
    count = j - i - 1
    if count <= 0:
        return 0.0
    points, sums = curve.points, curve.sums
    i = i % curve.n
    j = i + count + 1
    px, py = points[i, 0], points[i, 1]
    dx, dy = points[j, 0] - px, points[j, 1] - py
    sx, sy = sums[j, 0] - sums[i + 1, 0], sums[j, 1] - sums[i + 1, 1]
    xx = sums[j, 2] - sums[i + 1, 2] - 2.0 * px * sx + count * px * px
    yy = sums[j, 3] - sums[i + 1, 3] - 2.0 * py * sy + count * py * py
    xy = sums[j, 4] - sums[i + 1, 4] - px * sy - py * sx + count * px * py
    length2 = dx * dx + dy * dy
    if length2 == 0.0:
        return float(max(xx + yy, 0.0))
    # Written so that a turn by 90 degrees changes no rounding.
    return float(max(((dx * dx * yy + dy * dy * xx) - 2.0 * dx * dy * xy) / length2, 0.0))


@compiled
def farthest(curve: Curve, i: int, j: int, slack: float) -> tuple[int, float]:
    """The point strictly between i and j that is farthest from the chord (as a segment), and its distance.

    A later point must be farther by more than `slack`: ties go to the first. Without points between: (i, 0).
    """
    points, start = curve.points, i % curve.n
    px, py = points[start, 0], points[start, 1]
    dx, dy = points[start + j - i, 0] - px, points[start + j - i, 1] - py
    length2 = dx * dx + dy * dy
    best, where = 0.0, i
    for k in range(start + 1, start + j - i):
        x, y = points[k, 0] - px, points[k, 1] - py
        along = 0.0 if length2 == 0.0 else min(max((x * dx + y * dy) / length2, 0.0), 1.0)
        x, y = x - along * dx, y - along * dy
        distance = math.sqrt(x * x + y * y)
        if distance > best + slack:
            best, where = distance, i + k - start
    return where, best


@compiled
def slope(curve: Curve, i: int, j: int) -> float:
    """Direction (rad) of the total-least-squares line through the points i to j inclusive, pointing from i to j."""
    count = j - i + 1
    points, sums = curve.points, curve.sums
    i = i % curve.n
    j = i + count - 1
    sx, sy = sums[j + 1, 0] - sums[i, 0], sums[j + 1, 1] - sums[i, 1]
    xx = sums[j + 1, 2] - sums[i, 2] - sx * sx / count
    yy = sums[j + 1, 3] - sums[i, 3] - sy * sy / count
    xy = sums[j + 1, 4] - sums[i, 4] - sx * sy / count
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    if dx * math.cos(angle) + dy * math.sin(angle) < 0.0:
        angle += math.pi
    return angle


@compiled
def turn(curve: Curve, before: int, here: int, after: int) -> float:
    """Absolute change of the fitted slope at a vertex, in [0, pi]."""
    change = slope(curve, here, after) - slope(curve, before, here)
    return abs((change + math.pi) % (2.0 * math.pi) - math.pi)
