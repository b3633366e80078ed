"""Pieces of a surface that no reading holds: found and put back onto the piece beside them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from surfuse.beam_model.echo.arrivals import MIRROR, SPECKLE
from surfuse.beam_model.prior.raster import slopes
from surfuse.beam_model.search.estimation import Arrivals, Estimation
from surfuse.records import BoolArray, FloatArray, IntArray

SMALLEST_PIECE_M = 0.021
MARGIN_M = 0.03


def pieces(height: FloatArray, domain: BoolArray, g_m: float, crease_m: float) -> IntArray:
    """Number (R, C) of the smooth piece of each cell (-1 outside); neighbours share one unless they break apart.

    `height` (R, C) in m, cells of `g_m` within `domain` (R, C); two neighbours break apart where the step between them,
    less what their slopes explain, is above `crease_m`.
    """
    su, sv, _, _, _ = slopes(height, domain, g_m, crease_m)
    cells = np.arange(height.size).reshape(height.shape)
    first, second = [], []
    for slope, near, far in (
        (su, np.s_[:, :-1], np.s_[:, 1:]),
        (sv, np.s_[:-1, :], np.s_[1:, :]),
    ):
        rise = height[far] - height[near]
        lean = 0.5 * g_m * (slope[near] + slope[far])
        joined = domain[near] & domain[far] & (np.abs(rise - lean) < crease_m)
        first.append(cells[near][joined])
        second.append(cells[far][joined])
    a, b = np.concatenate(first), np.concatenate(second)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(height.size, height.size))
    _, number = connected_components(graph, directed=False)
    return np.where(domain, number.reshape(height.shape), -1)


def reattached(p: Estimation, height: FloatArray, heard: Arrivals, crease_m: float) -> FloatArray:
    """The surface (R, C) with every piece that no echo of its own holds laid onto the nearest held facet."""
    r = p.raster
    number = pieces(height, r.domain, r.g_m, crease_m)
    direct = (heard.kind == MIRROR) | (heard.kind == SPECKLE)
    holders = number[heard.row[direct], heard.column[direct]]
    votes = np.bincount(holders[holders >= 0], minlength=height.size)
    # One stray reading does not hold a piece up.
    held = (number >= 0) & (votes[np.maximum(number, 0)] >= 2)
    # Nothing smaller than the echo's own footprint can be told from its surroundings.
    sizes = np.bincount(number[number >= 0], minlength=height.size)
    held &= sizes[np.maximum(number, 0)] * r.g_m**2 >= SMALLEST_PIECE_M**2
    low, high = np.quantile(p.stations.foot_m[:, 2], (0.01, 0.99))
    held &= (height > low - MARGIN_M) & (height < high + MARGIN_M)
    if not np.any(held) or np.all(held == r.domain):
        return height
    return laid_onto(height, np.asarray(held), r.domain & ~held, r.g_m, crease_m)


def laid_onto(height: FloatArray, holder: BoolArray, piece: BoolArray, g_m: float, crease_m: float) -> FloatArray:
    """The surface (R, C) with the cells of a piece on the nearest facets of the cells that hold.

    `height` (R, C) in m, `holder` and `piece` (R, C) mark cells of `g_m`; all other cells stay as they are. Facets have
    the slopes of their cells, edges being bends above `crease_m`.
    """
    su, sv, _, _, _ = slopes(height, holder, g_m, crease_m)
    _, parent = distance_transform_edt(~holder, return_indices=True)
    jj, ii = parent[0], parent[1]
    j, i = np.indices(height.shape)
    laid = height[jj, ii] + g_m * (su[jj, ii] * (i - ii) + sv[jj, ii] * (j - jj))
    return np.where(piece, laid, height)
