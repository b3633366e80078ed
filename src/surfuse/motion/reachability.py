"""How fast a given path may be run: reachability analysis of the path's speed (Pham and Pham 2018, TOPP-RA).

Along the path parameter s, u is the acceleration of s and x the square of its speed. Limits of accelerations and
torques are linear in both: `|a u + b x + c| <= most`. From one grid point to the next x grows by 2 u ds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import FloatArray

_FLAT = 1e-12  # a row with a smaller factor of u says nothing about u


@dataclass(frozen=True)
class PathLimits:
    """Limits at grid points: `a`, `b`, `c` (G, M), `most` (M,) of `|a u + b x + c| <= most`; `square_max` (G,) of x."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    most: FloatArray
    square_max: FloatArray


def fastest_speeds(grid: FloatArray, limits: PathLimits) -> FloatArray | None:
    """Highest speed (G,) of the path parameter at grid points (G,), from rest to rest; None when there is no way.

    The limits of a grid point hold at the next one too, for the acceleration that leads there. Backwards, every point
    gets the squares of speed from which the end can be reached; forwards, the fastest of them is taken.
    """
    count, step = len(grid), np.diff(grid)
    reachable = np.zeros((count, 2))
    rows = [_rows(limits, i, float(step[i])) for i in range(count - 1)]
    for i in range(count - 2, -1, -1):
        found = _squares(_with_next(rows[i], float(step[i]), reachable[i + 1]), float(limits.square_max[i]))
        if found is None:
            return None
        reachable[i] = found
    if reachable[0, 0] > 0.0:
        return None
    square = np.zeros(count)
    for i in range(count - 1):
        push = _largest_push(_with_next(rows[i], float(step[i]), reachable[i + 1]), float(square[i]))
        square[i + 1] = np.clip(square[i] + 2.0 * step[i] * push, *reachable[i + 1])
    return np.sqrt(square)


def _rows(limits: PathLimits, i: int, step: float) -> FloatArray:
    """Rows (R, 3) of `p u + q x <= r` at grid point i: its own limits, and those of the next point."""
    a = np.concatenate([limits.a[i], limits.a[i + 1] + 2.0 * step * limits.b[i + 1]])
    b = np.concatenate([limits.b[i], limits.b[i + 1]])
    c = np.concatenate([limits.c[i], limits.c[i + 1]])
    most = np.concatenate([limits.most, limits.most])
    upper, lower = np.column_stack([a, b, most - c]), np.column_stack([-a, -b, most + c])
    return np.concatenate([upper, lower])


def _with_next(rows: FloatArray, step: float, reachable: FloatArray) -> FloatArray:
    """The rows, and that the next square lies among those that are reachable (2,) there."""
    low, high = reachable
    return np.concatenate([rows, [[2.0 * step, 1.0, high], [-2.0 * step, -1.0, -low]]])


def _squares(rows: FloatArray, square_max: float) -> tuple[float, float] | None:
    """Least and largest x, from 0 to `square_max`, for which some u keeps all rows; None when there is none.

    Each row bounds u from above, from below, or bounds x alone. Every pair of an upper and a lower bound that must
    leave room for u bounds x, too (Fourier and Motzkin's elimination of u).
    """
    p, q, r = rows.T
    up, down, flat = p > _FLAT, p < -_FLAT, np.abs(p) <= _FLAT
    slope_up, at_up = q[up] / p[up], r[up] / p[up]  # u <= at - slope x
    slope_down, at_down = q[down] / p[down], r[down] / p[down]  # u >= at - slope x
    factor = np.concatenate([(slope_up[:, None] - slope_down[None]).ravel(), q[flat]])
    room = np.concatenate([(at_up[:, None] - at_down[None]).ravel(), r[flat]])
    if np.any((np.abs(factor) <= _FLAT) & (room < -_FLAT)):
        return None
    rising, falling = factor > _FLAT, factor < -_FLAT
    high = min(square_max, float(np.min(room[rising] / factor[rising], initial=np.inf)))
    low = max(0.0, float(np.max(room[falling] / factor[falling], initial=-np.inf)))
    return (low, high) if low <= high else None


def _largest_push(rows: FloatArray, square: float) -> float:
    """The largest u that keeps all rows at this x; rounding may leave no room, then the middle of what is wanted."""
    p, q, r = rows.T
    bound = (r - q * square)[np.abs(p) > _FLAT] / p[np.abs(p) > _FLAT]
    up = p[np.abs(p) > _FLAT] > 0.0
    high, low = float(np.min(bound[up])), float(np.max(bound[~up]))
    return high if low <= high else 0.5 * (low + high)
