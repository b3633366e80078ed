"""Simple polygons (P, 2) as vertex arrays, not repeated: area, inside, distance, chords.

The polygon is closed by the edge from its last vertex to its first. Points are (x, y) or (u, v), any unit.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from surfuse.geometry.compiled import compiled

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def signed_area(polygon: npt.ArrayLike) -> float:
    """Area of a polygon (P, 2), positive when counter-clockwise (the shoelace formula)."""
    vertices = np.asarray(polygon, dtype=np.float64)
    # Relative to the first vertex: far from the origin the plain formula loses digits.
    x, y = (vertices - vertices[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def perimeter(polygon: npt.ArrayLike) -> float:
    """Length of the closed boundary of a polygon (P, 2)."""
    vertices = np.asarray(polygon, dtype=np.float64)
    return float(np.sum(np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)))


def counter_clockwise(polygon: npt.ArrayLike) -> FloatArray:
    """The same polygon (P, 2) with its vertices in counter-clockwise order."""
    vertices = np.array(polygon, dtype=np.float64)
    return vertices if signed_area(vertices) >= 0.0 else vertices[::-1].copy()


@compiled
def signed_distance_at(x: float, y: float, vertices: FloatArray) -> float:
    """Distance of one point to the boundary of a polygon (P, 2): positive inside, negative outside.

    Inside is decided by the parity of the crossings of a ray, so both orientations give the same sign.
    """
    nearest_squared = np.inf
    inside = False
    ax, ay = vertices[-1, 0], vertices[-1, 1]
    for i in range(vertices.shape[0]):
        bx, by = vertices[i, 0], vertices[i, 1]
        ex, ey = bx - ax, by - ay
        px, py = x - ax, y - ay
        length_squared = ex * ex + ey * ey
        t = 0.0
        if length_squared > 0.0:
            t = min(1.0, max(0.0, (px * ex + py * ey) / length_squared))
        dx, dy = px - t * ex, py - t * ey
        nearest_squared = min(nearest_squared, dx * dx + dy * dy)
        if (ay > y) != (by > y) and px < ex * (py / ey):
            inside = not inside
        ax, ay = bx, by
    distance = math.sqrt(nearest_squared)
    return distance if inside else -distance


@compiled
def signed_distances_into(x: FloatArray, y: FloatArray, vertices: FloatArray, distance: FloatArray) -> None:
    """`signed_distance_at` of many points (N,), bit for bit, into `distance` (N,).

    Edge after edge over all points, without branches: the processor then takes several points at a time.
    """
    n = x.shape[0]
    sign = np.full(n, -1.0)
    distance[:n] = np.inf
    ax, ay = vertices[-1, 0], vertices[-1, 1]
    for i in range(vertices.shape[0]):
        bx, by = vertices[i, 0], vertices[i, 1]
        ex, ey = bx - ax, by - ay
        length_squared = ex * ex + ey * ey
        # Of an edge without length only its end counts: 0 / 1 leaves the end.
        divisor = length_squared if length_squared > 0.0 else 1.0
        for k in range(n):
            px, py = x[k] - ax, y[k] - ay
            t = (px * ex + py * ey) / divisor
            t = t if t > 0.0 else 0.0
            t = t if t < 1.0 else 1.0
            dx, dy = px - t * ex, py - t * ey
            squared = dx * dx + dy * dy
            distance[k] = squared if squared < distance[k] else distance[k]
        if ay != by:
            for k in range(n):
                px, py = x[k] - ax, y[k] - ay
                crossed = ((ay > y[k]) != (by > y[k])) & (px < ex * (py / ey))
                sign[k] = -sign[k] if crossed else sign[k]
        ax, ay = bx, by
    for k in range(n):
        distance[k] = sign[k] * math.sqrt(distance[k])


@compiled
def _signed_distances(points: FloatArray, vertices: FloatArray) -> FloatArray:
    distances = np.empty(points.shape[0])
    signed_distances_into(points[:, 0].copy(), points[:, 1].copy(), vertices, distances)
    return distances


def signed_distance(points: npt.ArrayLike, polygon: npt.ArrayLike) -> FloatArray:
    """Distances (N,) of points (N, 2) to the boundary of a polygon (P, 2): positive inside, negative outside."""
    flat = np.array(points, dtype=np.float64, order="C").reshape(-1, 2)
    # A copy of one's own: a kernel is compiled anew for arrays that are read-only.
    return _signed_distances(flat, np.array(polygon, dtype=np.float64, order="C"))


def contains(points: npt.ArrayLike, polygon: npt.ArrayLike) -> BoolArray:
    """Which of the points (N, 2) lie inside a polygon (P, 2) or on its boundary."""
    result: BoolArray = signed_distance(points, polygon) >= 0.0
    return result


def is_simple(polygon: npt.ArrayLike) -> bool:
    """Whether no two edges of a polygon (P, 2) cross or touch, except neighbours in their common vertex."""
    start = np.asarray(polygon, dtype=np.float64)
    end = np.roll(start, -1, axis=0)
    n = len(start)
    if n < 3 or not np.all(np.isfinite(start)) or np.any(np.all(start == end, axis=1)):
        return False
    for i in range(n - 1):
        others = np.arange(i + 2, n if i > 0 else n - 1)
        if np.any(segments_meet(start[i], end[i], start[others], end[others])):
            return False
    return not bool(np.any(_folds_back(start)))


def _folds_back(start: FloatArray) -> BoolArray:
    """Which vertices are spikes of no width: the next edge goes straight back along the last one."""
    into, out = start - np.roll(start, 1, axis=0), np.roll(start, -1, axis=0) - start
    result: BoolArray = (into[:, 0] * out[:, 1] == into[:, 1] * out[:, 0]) & (np.sum(into * out, axis=1) < 0.0)
    return result


def segments_meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the segment from a to b (2,) meets each segment from c to d (M, 2), touching included."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        pq, pr = q - p, r - p
        return np.asarray(np.sign(pq[..., 0] * pr[..., 1] - pq[..., 1] * pr[..., 0]))

    boxes = np.all((np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b)), axis=-1)
    straddle = (side(a, b, c) * side(a, b, d) <= 0.0) & (side(c, d, a) * side(c, d, b) <= 0.0)
    result: BoolArray = boxes & straddle
    return result


def spans(polygon: npt.ArrayLike, v: float) -> FloatArray:
    """Intervals (K, 2) of u where the horizontal line at v runs inside a polygon (P, 2), in increasing order.

    An edge that lies in the line counts as inside, so the lowest and highest edge of a box give its full width.
    """
    vertices = np.asarray(polygon, dtype=np.float64)
    (u0, v0), (u1, v1) = vertices.T, np.roll(vertices, -1, axis=0).T
    crossing = (v0 > v) != (v1 > v)
    t = (v - v0[crossing]) / (v1[crossing] - v0[crossing])
    at = np.sort(u0[crossing] + t * (u1[crossing] - u0[crossing]))
    level = (v0 == v) & (v1 == v)
    flat = np.sort(np.column_stack([u0[level], u1[level]]), axis=1)
    return _merged(np.vstack([at.reshape(-1, 2), flat]))


def _merged(intervals: FloatArray) -> FloatArray:
    """Unite intervals (K, 2) that overlap or touch."""
    kept: list[list[float]] = []
    for low, high in intervals[np.argsort(intervals[:, 0], kind="stable")].tolist():
        if kept and low <= kept[-1][1]:
            kept[-1][1] = max(kept[-1][1], high)
        else:
            kept.append([low, high])
    return np.array(kept, dtype=np.float64).reshape(-1, 2)
