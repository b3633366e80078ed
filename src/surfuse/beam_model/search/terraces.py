"""A first surface of parallel levels: terraces, treads and steps, each where the space that was heard to be free ends.

Beside a rim every reading hears the rim, so that the free space over a tread ends on an arc that touches the tread and
rises from there. The levels are the heights at which much of the free space ends; each cell then falls to the highest
level under it. Sources: space carving (Kutulakos and Seitz, Int. J. Comput. Vis. 38 (2000)); cost-volume filtering
(Hosni and others, IEEE Trans. PAMI 35 (2013)).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

from surfuse.beam_model.search.estimation import Estimation
from surfuse.records import FloatArray

# Normals within this of each other are of one direction (slope), and points within this of one level (m).
ALIKE, LEVEL_M = 0.06, 0.001
MOST_LEVELS, LEAST_CELLS = 16, 6
# A cell may lie so far above the end of the free space, and so far below it.
ABOVE_M, BELOW_M = 0.002, 0.025
AROUND_CELLS = 3


def terraces(p: Estimation, free_m: FloatArray) -> list[FloatArray]:
    """Surfaces (R, C) in m of parallel levels under the free space (R, C): level ones, and with the slope of most."""
    leans = dict.fromkeys([(0.0, 0.0), lean(p)])
    made = [stepped(p, free_m, *slopes) for slopes in leans]
    return [one for one in made if one is not None]


def stepped(p: Estimation, free_m: FloatArray, su: float, sv: float) -> FloatArray | None:
    """Heights (R, C) in m of levels with these slopes; None where there are no two of them."""
    u, v = p.raster.nodes()
    slope = su * u[None, :] + sv * v[:, None]
    flat = free_m - slope
    levels = levels_of(p, flat)
    if len(levels) < 2:
        return None
    off = levels[:, None, None] - flat[None]
    cost = np.minimum(np.where(off > 0.0, off / ABOVE_M, -off / BELOW_M), 1.0)
    inside = p.raster.domain
    share = np.maximum(uniform_filter(inside.astype(np.float64), AROUND_CELLS, mode="constant"), 1e-9)
    around = np.stack(
        [uniform_filter(np.where(inside, one, 0.0), AROUND_CELLS, mode="constant") / share for one in cost]
    )
    mixed = np.where(cost < 1.0, 0.6 * cost + 0.4 * around, 1.0)
    best = np.argmin(mixed, axis=0)
    own = np.take_along_axis(mixed, best[None], axis=0)[0]
    return np.where(own < 1.0, levels[best] + slope, free_m)


def lean(p: Estimation) -> tuple[float, float]:
    """Slopes dw/du and dw/dv that most oriented points share; level where there are none."""
    good = p.surfels.coherent & p.raster.holds(p.surfels.point_m)
    normal = -p.surfels.towards[good]
    if len(normal) < LEAST_CELLS:
        return 0.0, 0.0
    slopes = -normal[:, :2] / np.maximum(normal[:, 2:], 0.2)
    near = np.hypot(slopes[:, None, 0] - slopes[None, :, 0], slopes[:, None, 1] - slopes[None, :, 1]) < ALIKE / 3.0
    middle = slopes[int(np.argmax(near.sum(axis=1)))]
    for _ in range(5):
        middle = slopes[np.hypot(*(slopes - middle).T) < ALIKE / 3.0].mean(axis=0)
    return (0.0, 0.0) if np.hypot(*middle) < 0.01 else (float(middle[0]), float(middle[1]))


def levels_of(p: Estimation, flat_m: FloatArray) -> FloatArray:
    """Heights (K,) in m at which at least `LEAST_CELLS` cells of a surface (R, C) are level, increasing."""
    g, inside = p.raster.g_m, p.raster.domain
    steep = np.zeros(flat_m.shape)
    for axis in (0, 1):
        rise = np.abs(np.diff(flat_m, axis=axis)) / g
        low, high = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        least = np.full(flat_m.shape, np.inf)
        least[low] = rise
        least[high] = np.minimum(least[high], rise)
        steep = np.maximum(steep, least)
    values = np.sort(flat_m[inside & (steep < 2.0 * ALIKE)])
    found: list[float] = []
    taken = np.zeros(len(values), dtype=bool)
    while len(found) < MOST_LEVELS and len(values):
        counts = np.searchsorted(values, values + 2.0 * LEVEL_M, side="right") - np.arange(len(values))
        counts = np.where(taken, 0, counts - _taken_after(values, taken))
        k = int(np.argmax(counts))
        if counts[k] < LEAST_CELLS:
            break
        members = ~taken & (values >= values[k]) & (values <= values[k] + 2.0 * LEVEL_M)
        found.append(float(np.quantile(values[members], 0.3)))
        taken |= (values >= values[k] - 2.0 * LEVEL_M) & (values <= values[k] + 4.0 * LEVEL_M)
    return np.array(sorted(found))


def _taken_after(values: FloatArray, taken: np.ndarray) -> np.ndarray:
    total = np.concatenate([[0], np.cumsum(taken)])
    end = np.searchsorted(values, values + 2.0 * LEVEL_M, side="right")
    return np.asarray(total[end] - total[np.arange(len(values))])
