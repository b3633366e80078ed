"""From readings to the finished map: stations, domain, explanation, layers on the map's grid."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from surfuse.fusion.beam_model.domain import heard_extent, inside_outline, raster_over
from surfuse.fusion.beam_model.echo import SPEED_OF_SOUND_M_S, BeamTable, DetectorModel, beam_table
from surfuse.fusion.beam_model.estimate import explore, on_raster, refine, surfels_of
from surfuse.fusion.beam_model.layers import Layers, layers
from surfuse.fusion.beam_model.problem import Problem, problem
from surfuse.fusion.beam_model.raster import Raster, slopes
from surfuse.fusion.beam_model.stations import Stations, gather, isolated, kinds, spacing
from surfuse.records import BoolArray, FloatArray, FusionScene, MapGrid, Readings, Regime, SurfaceMap

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
    """Cells of the part that a reading could have heard."""
    level = float(np.median(heard_m[:, 2]))
    if scene.outline is not None:
        inside = inside_outline(raster, grid, scene.outline, level)
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
    heard = stations.foot_m
    typical = float(np.median(stations.range_m))
    reach_m = max(2.0 * g, typical * float(np.tan(max(t.half_angle_rad for t in tables))))
    coarse = _problem(scene, stations, tables, grid, g, heard, reach_m, step)
    if coarse.plate.size == 0:
        return empty_map(grid)
    found = explore(coarse, surfels_of(coarse), edge)
    fine_raster = raster_over(grid, 0.5 * g)
    fine_domain = domain_of(scene, fine_raster, grid, heard, reach_m)
    fine = on_raster(coarse, Raster(fine_raster.u0_m, fine_raster.v0_m, 0.5 * g, fine_domain))
    solution = refine(coarse, fine, found[0])
    return _on_grid(fine, solution.height_m, solution.crease_m, layers(fine, solution), grid)


def _problem(
    scene: FusionScene, stations: Stations, tables: tuple[BeamTable, ...], grid: MapGrid, g: float,
    heard: FloatArray, reach_m: float, step: float,
) -> Problem:  # fmt: skip
    raster = raster_over(grid, g)
    domain = domain_of(scene, raster, grid, heard, reach_m)
    return problem(stations, tables, Raster(raster.u0_m, raster.v0_m, g, domain), step)


def _on_grid(p: Problem, height: FloatArray, crease: float, rest: Layers, grid: MapGrid) -> SurfaceMap:
    """Layers at the nodes of the map: each node on the facet of the cell that contains it."""
    r = p.raster
    su, sv, _, _, _ = slopes(height, r.domain, r.g_m, crease)
    rows, cols = r.shape
    i = np.floor((grid.u_m - r.u0_m) / r.g_m + 0.5).astype(np.int64)
    j = np.floor((grid.v_m - r.v0_m) / r.g_m + 0.5).astype(np.int64)
    ii, jj = np.clip(i, 0, cols - 1)[None, :], np.clip(j, 0, rows - 1)[:, None]
    mask = r.domain[jj, ii] & ((i >= 0) & (i < cols))[None, :] & ((j >= 0) & (j < rows))[:, None]
    du, dv = grid.u_m - (r.u0_m + ii[0] * r.g_m), grid.v_m - (r.v0_m + jj[:, 0] * r.g_m)
    surface = height[jj, ii] + su[jj, ii] * du[None, :] + sv[jj, ii] * dv[:, None]
    return SurfaceMap(
        grid=grid,
        height_m=np.where(mask, surface, np.nan),
        sigma_m=np.where(mask, rest.sigma_m[jj, ii], np.nan),
        confidence=np.where(mask, rest.confidence[jj, ii], 0.0),
        count=np.where(mask, rest.count[jj, ii], 0),
        mask=mask,
        regime=np.where(mask, rest.regime[jj, ii], int(Regime.EMPTY)).astype(np.uint8),
        method="beam",
    )
