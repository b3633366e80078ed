"""Error of a map against truth, node by node, for drawing; the scored figures come from outside."""

from __future__ import annotations

import numpy as np

from surfuse.records import FloatArray, SurfaceMap

# Nodes of two grids within this share of a cell of each other are the same place.
SLACK = 1e-6


def _positions(nodes: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower node index and share towards the next node, nan outside of the nodes."""
    index = np.arange(len(nodes), dtype=np.float64)
    slack = SLACK * float(np.ptp(nodes)) + 1e-12
    inside = (at >= nodes[0] - slack) & (at <= nodes[-1] + slack)
    exact = np.where(inside, np.interp(at, nodes, index), np.nan)
    near = np.round(exact)
    exact = np.where(np.abs(exact - near) < SLACK, near, exact)
    lower = np.clip(np.floor(np.where(inside, exact, 0.0)), 0, max(len(nodes) - 2, 0))
    return lower, exact - lower


def sample(surface: SurfaceMap, u_m: FloatArray, v_m: FloatArray) -> FloatArray:
    """Heights (R, C) of a map at other nodes, bilinear; nan where a needed node has no value or lies outside.

    `u_m` (C,) and `v_m` (R,) are in the part frame of the map, in m as the heights are.
    """
    low_u, share_u = _positions(surface.grid.u_m, u_m)
    low_v, share_v = _positions(surface.grid.v_m, v_m)
    total = np.zeros((len(v_m), len(u_m)))
    for dv in (0, 1):
        for du in (0, 1):
            weight = np.outer(share_v if dv else 1.0 - share_v, share_u if du else 1.0 - share_u)
            rows = np.clip(low_v.astype(np.int64) + dv, 0, len(surface.grid.v_m) - 1)
            columns = np.clip(low_u.astype(np.int64) + du, 0, len(surface.grid.u_m) - 1)
            # A neighbour without a value must not spoil a node that it has no part in.
            total += np.where(weight == 0.0, 0.0, weight * surface.height_m[np.ix_(rows, columns)])
    return total


def deviation(surface: SurfaceMap, truth: SurfaceMap) -> FloatArray:
    """Map minus truth (R, C) in metres at the nodes of the map; nan where either has no value."""
    return np.where(surface.mask, surface.height_m, np.nan) - sample(truth, surface.grid.u_m, surface.grid.v_m)
