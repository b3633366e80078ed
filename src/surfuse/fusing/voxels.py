"""Columns of voxels over the nodes of a map: from the lowest to the highest height that was heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.fusing.survey import Survey
from surfuse.records import MapGrid

MOST_VOXELS = 60_000_000
"""Of a whole map; beyond, the voxels become higher: half a gigabyte of doubles."""


@dataclass(frozen=True)
class Columns:
    """Voxels of `height_m` each in every column; the centre of voxel 0 is at `bottom_m`."""

    bottom_m: float
    height_m: float
    count: int

    def centre(self, voxel: int) -> float:
        """Height (m) of the centre of a voxel."""
        return self.bottom_m + voxel * self.height_m


def columns_over(heard: Survey, grid: MapGrid, voxel_m: float, margin_m: float) -> Columns:
    """Columns that hold all own-axis hits with a margin, in voxels of `voxel_m` or of what the memory allows."""
    low, high = float(np.min(heard.foot_m[:, 2])) - margin_m, float(np.max(heard.foot_m[:, 2])) + margin_m
    most = max(8, MOST_VOXELS // (grid.shape[0] * grid.shape[1]))
    size = max(voxel_m, (high - low) / most)
    return Columns(low, size, int(np.ceil((high - low) / size)) + 1)
