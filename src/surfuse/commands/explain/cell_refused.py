"""Fusing the readings behind one cell again, and nothing else, to see whether the cell comes back."""

from __future__ import annotations

import math

from surfuse.commands.explain.cell_evidence import Evidence
from surfuse.commands.explain.map_source import MapSource
from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.commands.fuse.methods import create_method
from surfuse.errors import SurfuseError


def refused_height_mm(source: MapSource, found: Evidence) -> float:
    """Height (mm) of the cell when the method of the map sees the readings of the evidence alone; nan without one."""
    if len(found.rows) == 0:
        return math.nan
    try:
        method = create_method(source.fusion, source.surface.method)
        result = method.replay(source.scene, source.readings.select(found.rows), source.surface.grid)
    except SurfuseError:
        # A map from elsewhere, or too few readings for the method: then nothing comes back.
        return math.nan
    surface = surface_of(result, source.surface.grid, method.name, source.scene.outline)
    at = (found.row, found.column)
    return 1e3 * float(surface.height_m[at]) if surface.mask[at] else math.nan
