"""Columns of voxels over the nodes of a map: from the lowest to the highest height that was heard."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.fusing.survey import Survey
from surfuse.records import MapGrid

MOST_VOXELS = 60_000_000
"""Of a whole map; beyond, the voxels become higher: half a gigabyte of doubles."""


class Columns(NamedTuple):
    """`levels` voxels of `height_m` each over every node of a map; the centre of voxel 0 is at `bottom_m` (w, in m).

    Kernels take it as it is.
    """

    bottom_m: float
    height_m: float
    levels: int

    def centre(self, voxel: int) -> float:
        """Height (m) of the centre of a voxel."""
        return self.bottom_m + voxel * self.height_m


def columns_over(heard: Survey, grid: MapGrid, voxel_m: float, margin_m: float) -> Columns:
    """Columns that hold all own-axis hits and `margin_m` more at both ends, with voxels of `voxel_m`.

    The voxels are higher where the map would need more than `MOST_VOXELS`. `heard` has at least one reading.
    """
    low, high = float(np.min(heard.foot_m[:, 2])) - margin_m, float(np.max(heard.foot_m[:, 2])) + margin_m
    most = max(8, MOST_VOXELS // (grid.shape[0] * grid.shape[1]))
    size = max(voxel_m, (high - low) / most)
    return Columns(low, size, int(np.ceil((high - low) / size)) + 1)
