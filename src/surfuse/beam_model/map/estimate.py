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
from surfuse.beam_model.map.tiles import RasterLayers, Tile, blank, pasted, sheet_of, sparse, tiles
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.search.estimation import problem
from surfuse.beam_model.search.explanations import FULL, LEAN, Effort, completed, explore, refine
from surfuse.records import (
    BoolArray,
    FloatArray,
    FusionScene,
    IntArray,
    MapGrid,
    Readings,
    Regime,
    RegionDecision,
    SurfaceMap,
)
from surfuse.surface.grids import refined

# Stations a coarse cell that take part in the search; the last refinement uses all.
MOST_A_CELL = 6
SMALLEST_CELL_M = 0.002
CELLS_A_WAVELENGTH = 1.8
NODES_AT_EDGES = 3
MOST_NODES = 200_000


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


def finer_grid(sheet: RasterLayers, grid: MapGrid) -> MapGrid:
    """The map's grid with nodes as close as the cells of the estimate, closer where an edge lies inside of a cell.

    Nodes of the given grid stay nodes. A third of a cell leaves no node on the border of two cells.
    """
    steps = np.concatenate([np.diff(grid.u_m), np.diff(grid.v_m)])
    if len(steps) == 0 or not np.allclose(steps, steps[0], rtol=1e-6):
        return grid
    cells = max(1, round(float(steps[0]) / sheet.raster.g_m))
    edges = bool(np.any(sheet.edge_u != 0.0) or np.any(sheet.edge_v != 0.0))
    factor = cells * (NODES_AT_EDGES if edges else 1)
    if factor == 1 or grid.shape[0] * grid.shape[1] * factor**2 > MOST_NODES:
        return grid
    return refined(grid, factor)


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


def on_grid(sheet: RasterLayers, grid: MapGrid) -> SurfaceMap:
    """Layers at the nodes of the map: each node on the facet of the cell that contains it.

    Beside an edge that lies inside of a cell, nodes beyond it are on the facet of the next cell.
    """
    r = sheet.raster
    rows, cols = r.shape
    at_u, at_v = (grid.u_m - r.u0_m) / r.g_m, (grid.v_m - r.v0_m) / r.g_m
    i, j = np.floor(at_u + 0.5).astype(np.int64), np.floor(at_v + 0.5).astype(np.int64)
    inside = ((i >= 0) & (i < cols))[None, :] & ((j >= 0) & (j < rows))[:, None]
    ii, jj = np.meshgrid(np.clip(i, 0, cols - 1), np.clip(j, 0, rows - 1))
    mask = sheet.known[jj, ii] & inside
    ii = _beside(sheet.edge_u, jj, ii, at_u[None, :] - ii, 1)
    jj = _beside(sheet.edge_v, jj, ii, at_v[:, None] - jj, 0)
    du, dv = grid.u_m[None, :] - (r.u0_m + ii * r.g_m), grid.v_m[:, None] - (r.v0_m + jj * r.g_m)
    surface = sheet.height_m[jj, ii] + sheet.slope_u[jj, ii] * du + sheet.slope_v[jj, ii] * dv
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, surface, np.nan),
        sigma_m=np.where(mask, sheet.sigma_m[jj, ii], np.nan),
        confidence=np.where(mask, sheet.confidence[jj, ii], 0.0),
        count=np.where(mask, sheet.count[jj, ii], 0),
        mask=mask,
        regime=np.where(mask, sheet.regime[jj, ii], int(Regime.EMPTY)).astype(np.uint8),
        method="beam",
        alternative_height_m=np.where(mask, sheet.second_m[jj, ii], np.nan),
        alternative_weight=np.where(mask, sheet.second_weight[jj, ii], 0.0),
    )


def _beside(edge: FloatArray, row: IntArray, column: IntArray, share: FloatArray, axis: int) -> IntArray:
    """Row or column (axis 0 or 1) of the cell on whose facet a node lies, one beside its own where an edge is between.

    `edge` (R, C) is `edge_u` or `edge_v`; `share` (in cells, from -1/2 to 1/2) is where the node lies in its cell.
    """
    own = (row, column)[axis]
    last = edge.shape[axis] - 1
    before = (row, np.maximum(column - 1, 0)) if axis else (np.maximum(row - 1, 0), column)
    ahead = (edge[row, column] < 0.0) & (share > 0.5 + edge[row, column]) & (own < last)
    behind = (edge[before] > 0.0) & (share < -0.5 + edge[before]) & (own > 0)
    return np.asarray(own + ahead.astype(np.int64) - behind.astype(np.int64))
