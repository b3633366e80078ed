"""Closed polygons that cross themselves, made simple by leaving out the small loops."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from surfuse.geometry.polygons import segments_meet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def untangled(polygon: FloatArray) -> IntArray:
    """Indices (Q,) of the vertices of a closed polygon (P, 2) that remain when every crossing loses its shorter loop.

    Edges that touch count as crossing; repeated vertices and spikes of no width go, too. A polygon that is simple
    keeps all its vertices. Fewer than 3 remain when there is no simple polygon in it.
    """
    kept = np.arange(len(polygon))
    while len(kept) >= 3:
        drop = _first_loop(polygon[kept])
        if drop is None:
            return kept
        kept = np.delete(kept, drop)
    return kept


def _first_loop(points: FloatArray) -> IntArray | None:
    """Positions of the vertices of the shorter of the two loops that the first crossing makes; None without one."""
    n = len(points)
    after = np.roll(points, -1, axis=0)
    into = points - np.roll(points, 1, axis=0)
    out = after - points
    lone = np.all(out == 0.0, axis=1)
    lone |= (into[:, 0] * out[:, 1] == into[:, 1] * out[:, 0]) & (np.sum(into * out, axis=1) < 0.0)
    if np.any(lone):
        return np.flatnonzero(lone)[:1]
    for i in range(n - 2):
        # The last edge is a neighbour of the first one.
        others = np.arange(i + 2, n - (1 if i == 0 else 0))
        meets = others[segments_meet(points[i], after[i], points[others], after[others])]
        if len(meets):
            inside = np.arange(i + 1, int(meets[0]) + 1)
            outside = np.setdiff1d(np.arange(n), inside)
            return inside if _length(points[inside]) <= _length(points[outside]) else outside
    return None


def _length(chain: FloatArray) -> float:
    return float(np.sum(np.linalg.norm(np.diff(chain, axis=0), axis=1)))
