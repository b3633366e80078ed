"""The raster on which the surface is estimated: nodes, domain, slopes, rims, and its relation to the map's grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, MapGrid

# Cells around a rim cell that say where its edge runs, and how much of their drops must point the same way.
AROUND_RIM, STRAIGHT = 2, 0.85


@dataclass(frozen=True)
class Raster:
    """Square cells of side `g_m` centred on nodes (u0 + i g, v0 + j g); `domain` (R, C) marks cells of the part.

    (`u0_m`, `v0_m`) is the node of row 0 and column 0, in the part frame; cell (j, i) is row j along v, column i along
    u.
    """

    u0_m: float
    v0_m: float
    g_m: float
    domain: BoolArray

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C)."""
        return self.domain.shape[0], self.domain.shape[1]

    def nodes(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates u (C,) and v (R,) of the nodes."""
        rows, cols = self.shape
        u = self.u0_m + self.g_m * np.arange(cols, dtype=np.float64)
        v = self.v0_m + self.g_m * np.arange(rows, dtype=np.float64)
        return np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)

    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest node, each (u, v)."""
        rows, cols = self.shape
        low = np.array([self.u0_m, self.v0_m])
        return low, low + self.g_m * np.array([cols - 1, rows - 1])

    def holds(self, points_m: FloatArray) -> BoolArray:
        """Which points (M, 2 or 3) stand over a cell of the domain.

        A mask (M,); points are (u, v) or (u, v, w) in m in the part frame.
        """
        i = np.floor((points_m[:, 0] - self.u0_m) / self.g_m + 0.5).astype(np.int64)
        j = np.floor((points_m[:, 1] - self.v0_m) / self.g_m + 0.5).astype(np.int64)
        rows, cols = self.shape
        ok = (i >= 0) & (j >= 0) & (i < cols) & (j < rows)
        ok[ok] = self.domain[j[ok], i[ok]]
        return np.asarray(ok, dtype=np.bool_)

    def sample(self, layer: FloatArray, grid: MapGrid) -> FloatArray:
        """Values of a layer at the nearest node of each node of the map's grid (nan outside).

        `layer` (R, C) of any quantity; the result has the shape of the map. The nearest node is that of the raster's
        cell in which the map's node lies.
        """
        i = np.floor((grid.u_m - self.u0_m) / self.g_m + 0.5).astype(np.int64)
        j = np.floor((grid.v_m - self.v0_m) / self.g_m + 0.5).astype(np.int64)
        rows, cols = self.shape
        inside = ((j >= 0) & (j < rows))[:, None] & ((i >= 0) & (i < cols))[None, :]
        values = layer[np.clip(j, 0, rows - 1)[:, None], np.clip(i, 0, cols - 1)[None, :]]
        return np.where(inside, values, np.nan)


@compiled
def slopes(
    height: FloatArray, domain: BoolArray, g: float, crease: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Slopes and curvatures along u and v that do not reach across an edge, and the rim cells.

    A rim cell lies next to a drop or to the outside. The last result (R, C, 2) is where the rim is, relative to the
    node along u and v: half a cell towards the drop; nan for cells that are none.

    All (R, C). `height` is in m, `domain` marks the cells that have one, `g` is the side of a cell in m, `crease` the
    bend (m) from which on three cells in a row are an edge. At an edge the slope is the flatter of the two sides, and
    the curvature is 0.
    """
    rows, cols = height.shape
    su = np.zeros((rows, cols))
    sv = np.zeros((rows, cols))
    cu = np.zeros((rows, cols))
    cv = np.zeros((rows, cols))
    rim = np.full((rows, cols, 2), np.nan)
    for j in range(rows):
        for i in range(cols):
            if not domain[j, i]:
                continue
            for along in range(2):
                dj, di = (0, 1) if along == 0 else (1, 0)
                ja, ia, jb, ib = j - dj, i - di, j + dj, i + di
                has_a = ja >= 0 and ia >= 0 and domain[ja, ia]
                has_b = jb < rows and ib < cols and domain[jb, ib]
                back = (height[j, i] - height[ja, ia]) if has_a else 0.0
                ahead = (height[jb, ib] - height[j, i]) if has_b else 0.0
                bend = ahead - back
                smooth = has_a and has_b and abs(bend) < crease
                if has_a and has_b:
                    slope = 0.5 * (back + ahead) if smooth else (back if abs(back) < abs(ahead) else ahead)
                else:
                    slope = back if has_a else ahead
                # A drop is what remains after the slope of this side is taken off.
                before = not has_a or back - slope > crease
                behind = not has_b or slope - ahead > crease
                if before or behind:
                    if np.isnan(rim[j, i, 0]):
                        rim[j, i, 0] = rim[j, i, 1] = 0.0
                    rim[j, i, along] = 0.5 * g * ((1.0 if behind else 0.0) - (1.0 if before else 0.0))
                if along == 0:
                    su[j, i] = slope / g
                    cu[j, i] = bend / (g * g) if smooth else 0.0
                else:
                    sv[j, i] = slope / g
                    cv[j, i] = bend / (g * g) if smooth else 0.0
    return su, sv, cu, cv, rim


@compiled
def tangents(rim: FloatArray) -> FloatArray:
    """Direction (R, C, 2) along u and v of the edge through each rim cell, nan where it has none: corners, spots.

    `rim` (R, C, 2) is that of `slopes`. The drops of the rim cells around are averaged: their mean is across the edge.
    """
    rows, cols = rim.shape[0], rim.shape[1]
    along = np.full((rows, cols, 2), np.nan)
    for j in range(rows):
        for i in range(cols):
            if np.isnan(rim[j, i, 0]):
                continue
            across_u, across_v, total = 0.0, 0.0, 0.0
            for jj in range(max(0, j - AROUND_RIM), min(rows, j + AROUND_RIM + 1)):
                for ii in range(max(0, i - AROUND_RIM), min(cols, i + AROUND_RIM + 1)):
                    if np.isnan(rim[jj, ii, 0]):
                        continue
                    du, dv = rim[jj, ii, 0], rim[jj, ii, 1]
                    across_u += du
                    across_v += dv
                    total += np.sqrt(du * du + dv * dv)
            size = np.sqrt(across_u * across_u + across_v * across_v)
            if total > 0.0 and size > STRAIGHT * total:
                along[j, i, 0], along[j, i, 1] = -across_v / size, across_u / size
    return along
