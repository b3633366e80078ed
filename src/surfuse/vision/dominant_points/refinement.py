"""Placement: where a given number of vertices makes the squared error smallest.

Dynamic programming finds the best polygon through a pool of points with one vertex held (J. C. Perez, E. Vidal,
Optimum polygonal approximation of digitized curves, Pattern Recognition Letters 15, 1994); then every vertex moves to
its best place between its neighbours; then the same again with another vertex held.
"""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, IntArray
from surfuse.vision.dominant_points.chords import Curve, chord_error
from surfuse.vision.dominant_points.order import first_least, take_out
from surfuse.vision.dominant_points.splitting import neighbours

# Up to so many points the pool is the whole contour; of a longer one it is the best candidates and the vertices.
_WHOLE_MAX = 120
_POOL_MAX = 80


@compiled
def resized(curve: Curve, vertices: IntArray, count: int, slack: float) -> IntArray:
    """Take away the cheapest vertices, or add the most useful, until there are `count`.

    `vertices` (K,) and the result (count,) are increasing indices into the curve; `slack` is the difference of errors
    below which two are the same.
    """
    k = len(vertices)
    room = np.empty(max(count, k), dtype=np.int64)
    for a in range(k):
        room[a] = vertices[a]
    if k > count:
        _thin(curve, room, k, count, slack)
    while k < count:
        where = _most_useful(curve, room, k, slack)
        b = k
        while b > 0 and room[b - 1] > where:
            room[b] = room[b - 1]
            b -= 1
        room[b] = where
        k += 1
    return room[:count].copy()


@compiled
def refined(
    curve: Curve,
    vertices: IntArray,
    found: IntArray,
    slack: float,
    rounds: int,
) -> IntArray:
    """Vertices (K,) in [0, n), along the curve, of a polygon with a total error not above that of the given ones.

    `found` are the candidates of the pool; `rounds` says how often another vertex is held.
    """
    best = vertices.copy()
    k = len(best)
    error = _settled(curve, best, slack)
    kept = _reduced(curve, found, k, slack) if rounds > 0 else vertices
    held, failed = 0, 0
    for _ in range(rounds):
        pool = _pool(curve, best, kept, best[held] % curve.n)
        trial = _best_polygon(curve, pool, k, slack)
        lower = _settled(curve, trial, slack)
        failed += 1
        if lower < error - slack:
            best, error, failed = trial, lower, 0
        if failed == 2 or not curve.closed:
            break
        held = (held + k // 2) % k if failed == 0 else (held + (k + 2) // 3) % k
    return best % curve.n


@compiled
def total_error(curve: Curve, vertices: IntArray) -> float:
    """Integral square error of the polygon through the vertices.

    `vertices` (K,) are indices into the curve, increasing. In squared columns: the sum of `chord_error` over all sides.
    """
    k = len(vertices)
    total = 0.0
    for a in range(k - 1):
        total += chord_error(curve, vertices[a], vertices[a + 1])
    return total + chord_error(curve, vertices[k - 1], vertices[0] + curve.n) if curve.closed else total


@compiled
def _settled(curve: Curve, vertices: IntArray, slack: float) -> float:
    """Move vertices in place, one after the other, until none improves; returns the total error."""
    k = len(vertices)
    restless = np.ones(k, dtype=np.bool_)
    while _any(restless):
        for a in range(k):
            if not restless[a]:
                continue
            restless[a] = False
            if not curve.closed and (a == 0 or a == k - 1):
                continue
            before, after = neighbours(vertices, k, a, curve.n)
            place = vertices[a]
            error = chord_error(curve, before, place) + chord_error(curve, place, after)
            for p in range(before + 1, after):
                left = chord_error(curve, before, p)
                if left < error - slack:
                    trial = left + chord_error(curve, p, after)
                    if trial < error - slack:
                        error, place = trial, p
            if place != vertices[a]:
                vertices[a] = place
                restless[(a - 1) % k] = True
                restless[(a + 1) % k] = True
    return total_error(curve, vertices)


@compiled
def _any(marked: BoolArray) -> bool:
    for one in marked:  # noqa: SIM110, a kernel has no generators
        if one:
            return True
    return False


@compiled
def _reduced(curve: Curve, found: IntArray, k: int, slack: float) -> IntArray:
    """Points that the pool offers beside the vertices: all of a short contour, else the candidates that count most."""
    if curve.n <= _WHOLE_MAX:
        return np.arange(curve.n)
    room = found.copy()
    count = min(len(room), max(_POOL_MAX - k, 3))
    _thin(curve, room, len(room), count, slack)
    return room[:count].copy()


@compiled
def _pool(curve: Curve, vertices: IntArray, kept: IntArray, start: int) -> IntArray:
    """Points among which vertices are chosen, from the held one on; a closed pool ends with the held one plus n."""
    n = curve.n
    marked = np.zeros(n, dtype=np.bool_)
    for vertex in kept:
        marked[vertex] = True
    for vertex in vertices:
        marked[vertex % n] = True
    pool = np.flatnonzero(marked)
    if not curve.closed:
        return pool
    first = 0
    while pool[first] < start:
        first += 1
    turned = np.empty(len(pool) + 1, dtype=np.int64)
    for a in range(len(pool) + 1):
        b = first + a
        turned[a] = pool[b] if b < len(pool) else pool[b - len(pool)] + n
    return turned


@compiled
def _best_polygon(curve: Curve, pool: IntArray, count: int, slack: float) -> IntArray:
    """The `count` vertices of the pool, first and last of it held, with the smallest squared error."""
    size = len(pool)
    chords = count if curve.closed else count - 1
    cost = np.empty((size, size))
    for b in range(size):
        for a in range(b):
            cost[b, a] = chord_error(curve, pool[a], pool[b])
    least = np.full((chords + 1, size), np.inf)
    came = np.zeros((chords + 1, size), dtype=np.int64)
    least[0, 0] = 0.0
    for m in range(1, chords + 1):
        # The chords that follow each need a point of their own.
        for b in range(m, size - chords + m):
            best, where = np.inf, m - 1
            for a in range(m - 1, b):
                error = least[m - 1, a] + cost[b, a]
                if error < best - slack:
                    best, where = error, a
            least[m, b], came[m, b] = best, where
    vertices = np.empty(chords + 1, dtype=np.int64)
    b = size - 1
    for m in range(chords, -1, -1):
        vertices[m] = pool[b]
        b = came[m, b]
    return vertices[:count].copy()


@compiled
def _thin(curve: Curve, vertices: IntArray, k: int, count: int, slack: float) -> None:
    """Keep, in place, the first `count` of k vertices after taking away the one whose loss costs least, repeatedly."""
    rise = np.empty(k)
    for a in range(k):
        rise[a] = _loss(curve, vertices, k, a)
    while k > count:
        best = first_least(rise, k, slack)
        take_out(vertices, rise, best, k)
        k -= 1
        for a in ((best - 1) % k, best % k):
            rise[a] = _loss(curve, vertices, k, a)


@compiled
def _loss(curve: Curve, vertices: IntArray, k: int, a: int) -> float:
    """By how much the error rises when vertex a of k goes; inf for the ends of an open curve."""
    if not curve.closed and (a == 0 or a == k - 1):
        return np.inf
    before, after = neighbours(vertices, k, a, curve.n)
    here = vertices[a]
    kept = chord_error(curve, before, here) + chord_error(curve, here, after)
    return chord_error(curve, before, after) - kept


@compiled
def _most_useful(curve: Curve, vertices: IntArray, k: int, slack: float) -> int:
    """The new vertex that lowers the error most; where none does, the middle of the longest chord."""
    best, where = 0.0, -1
    longest, middle = 1, -1
    for a in range(k if curve.closed else k - 1):
        i = vertices[a]
        j = vertices[a + 1] if a < k - 1 else vertices[0] + curve.n
        if j - i > longest:
            longest, middle = j - i, (i + j) // 2
        whole = chord_error(curve, i, j)
        if whole <= best + slack:
            continue
        for p in range(i + 1, j):
            gain = whole - chord_error(curve, i, p) - chord_error(curve, p, j)
            if gain > best + slack:
                best, where = gain, p
    return where if where >= 0 else middle
