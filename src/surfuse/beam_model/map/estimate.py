"""From readings to the finished map: stations, domain, explanation, layers on the map's grid."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from surfuse.beam_model.echo.detector import SPEED_OF_SOUND_M_S, BeamTable, DetectorModel, beam_table
from surfuse.beam_model.heard.domain import heard_extent, inside_outline, raster_over
from surfuse.beam_model.heard.stations import Stations, gather, isolated, kinds, spacing
from surfuse.beam_model.judge.held_out import fallen_back, held_out, judged
from surfuse.beam_model.judge.rivals import laid_on, rival_spread
from surfuse.beam_model.map.nodes import finer_grid, on_grid
from surfuse.beam_model.map.tiles import RasterLayers, Tile, blank, pasted, sheet_of, sparse, tiles
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.search.estimation import problem
from surfuse.beam_model.search.explanations import FULL, LEAN, Effort, completed, explore, refine
from surfuse.records import (
    BoolArray,
    FloatArray,
    FusionScene,
    MapGrid,
    Readings,
    RegionDecision,
    SurfaceMap,
)

# Stations a coarse cell that take part in the search; the last refinement uses all.
MOST_A_CELL = 6
SMALLEST_CELL_M = 0.002
CELLS_A_WAVELENGTH = 1.8


def empty_map(grid: MapGrid) -> SurfaceMap:
    """A map without a value anywhere."""
    nothing = np.full(grid.shape, np.nan)
    zero = np.zeros(grid.shape)
    return SurfaceMap(grid, nothing, nothing, zero, zero.astype(np.int64), zero > 1.0, zero.astype(np.uint8), "beam")


def tables_of(scene: FusionScene, stations: Stations, detector: DetectorModel) -> tuple[BeamTable, ...]:
    """One table a kind of sensor, at the typical range of the scan (to 2 cm, so that scans share tables)."""
    typical = 20 * max(1, round(float(np.median(stations.range_m)) * 50.0))
    return tuple(beam_table(spec, typical, detector) for spec in kinds(scene.specs))


def cell_size(scene: FusionScene, grid: MapGrid, step_m: float) -> float:
    """Side (m) of the coarse cells: the stations' spacing, not below what the waves resolve."""
    wave = [SPEED_OF_SOUND_M_S / (s.frequency_hz or 50e3) for s in scene.specs]
    finest = max(SMALLEST_CELL_M, CELLS_A_WAVELENGTH * float(np.median(wave)))
    wanted = max(finest, step_m) if np.isfinite(step_m) else finest
    steps = np.concatenate([np.diff(grid.u_m), np.diff(grid.v_m)])
    node = float(np.median(steps)) if len(steps) else wanted
    # Cells that share their nodes with the map need no resampling.
    return node * max(1, round(wanted / node)) if wanted > 0.75 * node else node / max(1, round(node / wanted))


def domain_of(scene: FusionScene, raster: Raster, grid: MapGrid, heard_m: FloatArray, reach_m: float) -> BoolArray:
    """Cells of the part that a reading could have heard.

    A mask (R, C) of the raster. `heard_m` (M, 3) are points in the part frame in m where something was heard; cells
    farther than `reach_m` from all of them are left out, and so are cells outside of the outline where the scene has
    one.
    """
    if scene.outline is not None:
        inside = inside_outline(raster, grid, scene.outline, np.quantile(heard_m[:, 2], (0.05, 0.5, 0.95)))
    else:
        inside = heard_extent(raster, heard_m, reach_m)
    within = Raster(raster.u0_m, raster.v0_m, raster.g_m, inside)
    return inside & _covered(within, heard_m, reach_m)


def _covered(raster: Raster, heard_m: FloatArray, reach_m: float) -> BoolArray:
    """Cells (R, C) within reach of an own-axis point."""
    rows, cols = raster.shape
    pad = max(1, round(reach_m / raster.g_m))
    hit = np.zeros((rows + 2 * pad, cols + 2 * pad), dtype=bool)
    i = np.floor((heard_m[:, 0] - raster.u0_m) / raster.g_m + 0.5).astype(np.int64) + pad
    j = np.floor((heard_m[:, 1] - raster.v0_m) / raster.g_m + 0.5).astype(np.int64) + pad
    ok = (i >= 0) & (j >= 0) & (i < cols + 2 * pad) & (j < rows + 2 * pad)
    hit[j[ok], i[ok]] = True
    span = np.arange(-pad, pad + 1)
    disc = span[:, None] ** 2 + span[None, :] ** 2 <= pad * pad + 0.5
    return np.asarray(binary_dilation(hit, disc)[pad:-pad, pad:-pad], dtype=bool)


def estimate_map(
    scene: FusionScene, readings: Readings, grid: MapGrid, detector: DetectorModel, edge: float
) -> SurfaceMap:
    """Estimate the surface on the map's grid."""
    stations = gather(readings, scene)
    step = spacing(stations)
    stations = stations.select(~isolated(stations, step))
    if len(stations) == 0:
        return empty_map(grid)
    tables = tables_of(scene, stations, detector)
    g = cell_size(scene, grid, step)
    step = step if np.isfinite(step) else g
    heard = stations.foot_m
    reach_m = max(1.1 * g, float(np.median(stations.range_m)) * float(np.tan(max(t.half_angle_rad for t in tables))))
    whole = raster_over(grid, g)
    whole = replace(whole, domain=domain_of(scene, whole, grid, heard, reach_m))
    if not np.any(whole.domain):
        return empty_map(grid)
    parts = tiles(whole, int(np.ceil(reach_m / g)) + 1)
    effort = FULL if len(parts) == 1 else LEAN
    sheet = blank(whole if len(parts) > 1 else fine_raster(scene, grid, g, heard, reach_m))

    def solved(tile: Tile) -> tuple[RasterLayers, tuple[RegionDecision, ...]]:
        return _solve(stations, tables, tile, sheet.raster if effort.fine else None, step, edge, effort)

    decisions: list[RegionDecision] = []
    with ThreadPoolExecutor(min(len(parts), os.cpu_count() or 1)) as pool:
        # The order of the tiles, not that in which they finish, decides: the map is the same on every machine.
        for tile, (piece, own) in zip(parts, pool.map(solved, parts), strict=True):
            sheet = pasted(sheet, piece, tile)
            decisions.extend(own)
    return replace(on_grid(sheet, finer_grid(sheet, grid)), decisions=tuple(decisions))


def fine_raster(scene: FusionScene, grid: MapGrid, g: float, heard_m: FloatArray, reach_m: float) -> Raster:
    """The raster of half the cell size over the same part.

    `g` is the coarse cell in m; `heard_m` and `reach_m` as in `domain_of`.
    """
    fine = raster_over(grid, 0.5 * g)
    return replace(fine, domain=domain_of(scene, fine, grid, heard_m, reach_m))


def _solve(
    stations: Stations, tables: tuple[BeamTable, ...], tile: Tile, fine: Raster | None, step: float,
    edge: float, effort: Effort,
) -> tuple[RasterLayers, tuple[RegionDecision, ...]]:  # fmt: skip
    """Estimate one raster from the stations over it, and let the stations that were held out judge it."""
    coarse = tile.raster
    low, high = coarse.extent()
    middle = stations.position_m + stations.axis * stations.range_m[:, None]
    pad = 0.15 * float(np.median(stations.range_m))
    near = np.all((middle[:, :2] >= low - pad) & (middle[:, :2] <= high + pad), axis=1)
    own = stations.select(near)
    if len(own) == 0 or not np.any(coarse.domain):
        return blank(coarse if fine is None else fine), ()
    few = own.select(sparse(own, coarse, MOST_A_CELL))
    apart = held_out(few)
    shown = problem(few.select(~apart), tables, coarse, step)
    found = explore(shown, edge, effort)
    best, doubt_m = found[0], rival_spread(found)
    verdict = judged(shown, best, few.select(apart), tile if fine is None else None)
    every = problem(few, tables, coarse, step)
    final = completed(every, best, effort)
    if fine is not None:
        detailed = problem(own, tables, fine, step)
        every, final = detailed, refine(every, detailed, final)
    sheet = sheet_of(every, final, laid_on(doubt_m, coarse, every.raster))
    return fallen_back(sheet, every, verdict, coarse), verdict.decisions
