"""The map of a fusion result: the method's own, or its points on the grid; of both, the cells on the part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.records import BoolArray, FusionResult, MapGrid, Outline, Regime, SurfaceMap
from surfuse.surface.gridding import cells_inside, grid_points


def surface_of(result: FusionResult, grid: MapGrid, method: str, outline: Outline | None) -> SurfaceMap:
    """The map that the method made itself, or its points on the grid; of both, the cells on the part as it was seen."""
    if result.surface is None:
        return grid_points(result.points, grid, method, outline)
    if outline is None or outline.viewpoint_m is None:
        return result.surface
    return masked(result.surface, cells_inside(result.surface.grid, outline, result.surface.height_m))


def masked(surface: SurfaceMap, keep: BoolArray) -> SurfaceMap:
    """A map without the values outside of `keep` (R, C)."""
    mask = surface.mask & keep
    second, weight = surface.alternative_height_m, surface.alternative_weight
    return replace(
        surface,
        height_m=np.where(mask, surface.height_m, np.nan),
        sigma_m=np.where(mask, surface.sigma_m, np.nan),
        confidence=np.where(mask, surface.confidence, 0.0),
        count=np.where(mask, surface.count, 0),
        mask=mask,
        regime=np.where(mask, surface.regime, int(Regime.EMPTY)).astype(np.uint8),
        alternative_height_m=None if second is None else np.where(mask, second, np.nan),
        alternative_weight=None if weight is None else np.where(mask, weight, 0.0),
    )
