"""Fusing the readings behind one cell again, and nothing else, to see whether the cell comes back."""

from __future__ import annotations

import math

import numpy as np

from surfuse.commands.explain.cell_evidence import Evidence
from surfuse.commands.explain.map_source import MapSource
from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.commands.fuse.methods import create_method
from surfuse.errors import SurfuseError
from surfuse.records import IntArray, Readings


def readings_of(readings: Readings, rows: IntArray) -> Readings:
    """The readings of some rows, in their sweeps; sweeps without one are left out."""
    kept = np.sort(rows)
    sweep = np.searchsorted(readings.start, kept, side="right") - 1
    sweeps, sizes = np.unique(sweep, return_counts=True)
    return Readings(
        specs=readings.specs,
        t_s=readings.t_s[kept],
        sensor=readings.sensor[kept],
        position_m=readings.position_m[kept],
        axis=readings.axis[kept],
        range_m=readings.range_m[kept],
        status=readings.status[kept],
        amplitude=readings.amplitude[kept],
        sigma_m=readings.sigma_m[kept],
        spread_m=readings.spread_m[kept],
        count=readings.count[kept],
        start=np.concatenate([[0], np.cumsum(sizes)]),
        stop=readings.stop[sweeps],
        row=readings.row[sweeps],
        world_from_grip=readings.world_from_grip[sweeps],
    )


def refused_height_mm(source: MapSource, found: Evidence) -> float:
    """Height (mm) of the cell when the method of the map sees the readings of the evidence alone; nan without one."""
    if len(found.rows) == 0:
        return math.nan
    try:
        method = create_method(source.fusion, source.surface.method)
        result = method.replay(source.scene, readings_of(source.readings, found.rows), source.surface.grid)
    except SurfuseError:
        # A map from elsewhere, or too few readings for the method: then nothing comes back.
        return math.nan
    surface = surface_of(result, source.surface.grid, method.name, source.scene.outline)
    at = (found.row, found.column)
    return 1e3 * float(surface.height_m[at]) if surface.mask[at] else math.nan
