"""A map at the nodes of another grid in the same part frame, as two estimates of one part need it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from surfuse.records import ByteArray, FloatArray, IntArray, MapGrid, Regime, SurfaceMap

WHOLE = 0.999


def at_nodes(surface: SurfaceMap, grid: MapGrid) -> SurfaceMap:
    """Heights and sigma bilinear, the rest from the nearest node; a node needs a value at all that it leans on.

    Errors of neighbours count as fully correlated. A map on these nodes stays as it is.
    """
    own = surface.grid
    same = own.shape == grid.shape and np.allclose(own.u_m, grid.u_m) and np.allclose(own.v_m, grid.v_m)
    if same or not np.any(surface.mask):
        return surface
    i = np.interp(grid.u_m, own.u_m, np.arange(len(own.u_m), dtype=np.float64), left=-1.0, right=-1.0)
    j = np.interp(grid.v_m, own.v_m, np.arange(len(own.v_m), dtype=np.float64), left=-1.0, right=-1.0)
    at = np.meshgrid(j, i, indexing="ij")
    inside = (at[0] >= 0.0) & (at[1] >= 0.0)
    _, nearest = distance_transform_edt(~surface.mask, return_indices=True)

    def mixed(layer: FloatArray) -> FloatArray:
        whole = np.asarray(layer, dtype=np.float64)[nearest[0], nearest[1]]
        return np.asarray(map_coordinates(whole, at, order=1, mode="nearest"), dtype=np.float64)

    mask = inside & (map_coordinates(surface.mask.astype(np.float64), at, order=1, mode="nearest") > WHOLE)
    row = np.clip(np.rint(at[0]), 0, own.shape[0] - 1).astype(np.int64)
    column = np.clip(np.rint(at[1]), 0, own.shape[1] - 1).astype(np.int64)
    count: IntArray = np.where(mask, surface.count[row, column], 0)
    regime: ByteArray = np.where(mask, surface.regime[row, column], int(Regime.EMPTY)).astype(np.uint8)
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, mixed(surface.height_m), np.nan),
        sigma_m=np.where(mask, mixed(surface.sigma_m), np.nan),
        confidence=np.where(mask, mixed(surface.confidence), 0.0),
        count=count,
        mask=mask,
        regime=regime,
        method=surface.method,
        decisions=surface.decisions,
    )
