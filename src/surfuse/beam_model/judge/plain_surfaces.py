"""Surfaces without a model of the echo, for comparison: average, own-axis median, carving."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surfuse.beam_model.search.estimation import Estimation, free_space
from surfuse.beam_model.search.first_surfaces import trusted
from surfuse.records import FloatArray

NAMES = ("average", "own_axis_median", "carving")
# Stations of a cell: so many at most, the nearest; the average takes those within a reach of the array's size.
MEDIAN_OF = 5
MEAN_OF = 12
MEAN_REACH_M = 0.025


def simple_surfaces(p: Estimation) -> dict[str, FloatArray]:
    """Heights (R, C) by name; each holds a value in every cell of the domain."""
    foot = p.stations.foot_m
    foot = foot[p.raster.holds(foot)] if np.any(p.raster.holds(foot)) else foot
    u, v = p.raster.nodes()
    uu, vv = np.meshgrid(u, v)
    cells = np.column_stack([uu[p.raster.domain], vv[p.raster.domain]])
    distance, index = cKDTree(foot[:, :2]).query(cells, k=min(MEAN_OF, len(foot)))
    distance, index = distance.reshape(len(cells), -1), index.reshape(len(cells), -1)
    heights = foot[index, 2]
    near = (distance <= MEAN_REACH_M) | (np.arange(distance.shape[1]) == 0)[None, :]
    mean = np.sum(near * heights, axis=1) / np.sum(near, axis=1)
    median = np.median(heights[:, :MEDIAN_OF], axis=1)
    bound = free_space(p, trusted(p, p.surfels))[p.raster.domain]
    return {
        name: as_layer(p, values)
        for name, values in zip(NAMES, (mean, median, np.where(np.isfinite(bound), bound, median)), strict=True)
    }


def as_layer(p: Estimation, values: FloatArray) -> FloatArray:
    """Values of the cells of the domain as a layer (R, C)."""
    layer = np.zeros(p.raster.shape)
    layer[p.raster.domain] = values
    return layer
