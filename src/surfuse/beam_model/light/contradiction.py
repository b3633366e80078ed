"""How far readings of light contradict a map that they had no part in, cell by cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from surfuse.beam_model.light.scatter import sensor_scatter
from surfuse.records import FloatArray, FusionScene, Readings, SurfaceMap

# Readings around a node; the share of their scatter that they have in common; and what is averaged, in spots.
AROUND = 40
SHARED = 0.15
SPOTS = 2.0


@dataclass(frozen=True)
class Contradiction:
    """Mean squares (R, C) in m^2 at the nodes of the map: of the misses around a node, and of what chance makes."""

    square: FloatArray
    noise: FloatArray


def contradiction(
    scene: FusionScene, readings: Readings, surface: SurfaceMap, scatter_m: float, spot_m: float
) -> Contradiction:
    """What zones read of a surface, mean over their solid angle, against what they should have read.

    `readings` are of light alone, `scatter_m` is theirs about a map of their own; offsets of sensors are taken out.
    """
    shape = surface.grid.shape
    found = sensor_scatter(scene, readings, surface)
    count = min(AROUND, len(found.left_m))
    noise = np.full(shape, scatter_m**2 * (1.0 / max(count, 1) + SHARED**2))
    if count < 3:
        return Contradiction(np.zeros(shape), noise)
    uu, vv = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    _, near = cKDTree(found.foot_m).query(np.column_stack([uu.ravel(), vv.ravel()]), k=count)
    # The median of normal errors is less sharp than their mean, and deaf to late echoes.
    middle = np.median(found.left_m[near], axis=1).reshape(shape)
    step = float(np.median(np.diff(surface.grid.u_m)))
    width = 2 * round(SPOTS * spot_m / step) + 1
    square = np.maximum(uniform_filter(middle**2, width, mode="nearest"), 0.0)
    return Contradiction(square, 0.5 * np.pi * noise)
