"""The map while the scan runs: around each new sweep the surface is estimated again, from what was there before.

A window of cells about the new readings is solved with the same arrivals, prior and edges as the whole estimate, but
from one start or two and without a comparison of priors. What comes out is a preview: the map at the end is made from
all readings at once and does not depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.beam_model.echo.detector import BeamTable, DetectorModel
from surfuse.beam_model.heard.domain import raster_over
from surfuse.beam_model.heard.stations import Stations, gather, isolated, spacing
from surfuse.beam_model.map.estimate import cell_size, domain_of, empty_map, tables_of
from surfuse.beam_model.map.layers import layers
from surfuse.beam_model.map.nodes import on_grid
from surfuse.beam_model.map.tiles import RasterLayers, Tile, blank, pasted, sparse
from surfuse.beam_model.prior.raster import Raster, slopes
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.descent import Solution, crease, descend, objective
from surfuse.beam_model.search.estimation import Estimation, problem
from surfuse.beam_model.search.explanations import FREE, SHARP, surfels_of
from surfuse.beam_model.search.first_surfaces import nearest_allowed
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import BoolArray, FloatArray, FusionScene, MapGrid, SurfaceMap, Sweep, readings_from_sweeps

CORE_CELLS = 5
"""Cells to each side of a new sweep whose values are taken from its window."""

APART_CELLS = 2.5
"""Of many new sweeps, those nearer to each other than so many cells share a window."""

OVERLAP_CELLS = 3
"""Cells around them that take part, so that the border of the window does not show."""

MOST_A_CELL = 2
"""Stations a cell that take part."""

LEAST_STATIONS = 6


@dataclass
class LiveMap:
    """The sweeps so far, and what they gave.

    `grid` is the map that was asked for, `looked_m` holds a place (u, v) (2,) in m for each sweep; `sheet` are
    the layers of the last estimate (None: there was none yet). `edge` is the price of a broken difference, `tables` one
    for each kind of sensor.
    """

    scene: FusionScene
    grid: MapGrid
    detector: DetectorModel
    edge: float
    sweeps: list[Sweep] = field(default_factory=list)
    looked_m: list[FloatArray] = field(default_factory=list)
    tables: tuple[BeamTable, ...] = ()
    sheet: RasterLayers | None = None

    def update(self, sweeps: Sequence[Sweep]) -> None:
        """Take in the sweeps since the last call and estimate the surface around them, around the newest first."""
        if self.sheet is None:
            self.sheet = blank(raster_over(self.grid, cell_size(self.scene, self.grid, float("nan"))))
        places = [looked_at(sweep, self.scene) for sweep in sweeps]
        self.sweeps += sweeps
        self.looked_m += places
        done: list[FloatArray] = []
        for here in reversed(places):
            apart = [float(np.max(np.abs(here - other))) for other in done]
            if np.all(np.isfinite(here)) and min(apart, default=np.inf) > APART_CELLS * self._raster.g_m:
                self._update_around(here)
                done.append(here)

    def _update_around(self, here: FloatArray) -> None:
        assert self.sheet is not None
        side = (CORE_CELLS + OVERLAP_CELLS + 2) * self.sheet.raster.g_m
        with np.errstate(invalid="ignore"):
            near = np.flatnonzero(np.max(np.abs(np.array(self.looked_m) - here), axis=1) <= side)
        stations = gather(readings_from_sweeps(self.scene.specs, [self.sweeps[k] for k in near]), self.scene)
        step = spacing(stations)
        stations = stations.select(~isolated(stations, step))
        if len(stations) < LEAST_STATIONS:
            return
        # The tables of the first range stand for the whole scan: another one is a matter of a second.
        self.tables = self.tables or tables_of(self.scene, stations, self.detector)
        tile = _window(self.sheet.raster, here, self._domain(stations))
        if np.any(tile.raster.domain):
            self.sheet = pasted(self.sheet, self._solved(stations, tile, step), tile)

    def surface(self) -> SurfaceMap:
        """The map of the sweeps so far."""
        return empty_map(self.grid) if self.sheet is None else on_grid(self.sheet, self.grid)

    def _domain(self, stations: Stations) -> Callable[[Raster], BoolArray]:
        wide = float(np.tan(max(table.half_angle_rad for table in self.tables)))
        reach_m = max(1.1 * self._raster.g_m, float(np.median(stations.range_m)) * wide)
        return lambda raster: domain_of(self.scene, raster, self.grid, stations.foot_m, reach_m)

    @property
    def _raster(self) -> Raster:
        assert self.sheet is not None
        return self.sheet.raster

    def _solved(self, stations: Stations, tile: Tile, step_m: float) -> RasterLayers:
        """The window from its oriented points or from what was there before, whichever explains the readings better."""
        assert self.sheet is not None
        few = stations.select(sparse(stations, tile.raster, MOST_A_CELL))
        p = problem(few, self.tables, tile.raster, step_m)
        stiffness = Stiffness(*FREE, self.edge)
        start = nearest_allowed(p, surfels_of(p))
        rows, cols = tile.raster.shape
        first = tile.row - tile.rows.start, tile.col - tile.cols.start
        block = (slice(first[0], first[0] + rows), slice(first[1], first[1] + cols))
        known = self.sheet.known[block]
        starts = [start]
        if 2 * np.count_nonzero(known & tile.raster.domain) > np.count_nonzero(tile.raster.domain):
            starts.append(np.where(known, self.sheet.height_m[block], start))
        return _sheet(p, min((_settled(p, one, stiffness) for one in starts), key=lambda found: found.score))


def looked_at(sweep: Sweep, scene: FusionScene) -> FloatArray:
    """Where the sensors of a sweep look, on average (2,): u and v of their own axes at the typical range."""
    part_from_world = inverse(scene.world_from_part)
    heard = np.isfinite(sweep.range_m)
    typical = float(np.median(sweep.range_m[heard])) if np.any(heard) else 0.0
    ends = transform_points(part_from_world, sweep.position_m + typical * sweep.axis)
    return np.asarray(ends[:, :2].mean(axis=0) if len(ends) else np.full(2, np.nan), dtype=np.float64)


def _window(raster: Raster, here_m: FloatArray, domain: Callable[[Raster], BoolArray]) -> Tile:
    """The cells about a place, cut at the border of the raster."""
    rows, cols = raster.shape
    column, row = (round(float(c)) for c in (here_m - [raster.u0_m, raster.v0_m]) / raster.g_m)
    wide = CORE_CELLS + OVERLAP_CELLS
    a, b = max(0, min(row - wide, rows - 1)), max(0, min(column - wide, cols - 1))
    c, d = max(a + 1, min(row + wide + 1, rows)), max(b + 1, min(column + wide + 1, cols))
    part = Raster(raster.u0_m + b * raster.g_m, raster.v0_m + a * raster.g_m, raster.g_m, np.ones((c - a, d - b), bool))
    part = replace(part, domain=domain(part))
    low_v, low_u = max(row - CORE_CELLS - a, 0), max(column - CORE_CELLS - b, 0)
    kept_v = slice(low_v, max(low_v, min(row + CORE_CELLS + 1, c) - a))
    kept_u = slice(low_u, max(low_u, min(column + CORE_CELLS + 1, d) - b))
    return Tile(part, kept_v, kept_u, a + low_v, b + low_u)


def _settled(p: Estimation, start: FloatArray, stiffness: Stiffness) -> Solution:
    width = crease(p, stiffness)
    height, heard = descend(p, start, stiffness, width, SHARP)
    return Solution(height, heard, stiffness, width, objective(p, height, heard, stiffness, 0.0), "live")


def _sheet(p: Estimation, solution: Solution) -> RasterLayers:
    """The layers of a window; second surfaces are left to the whole estimate."""
    su, sv, _, _, _ = slopes(solution.height_m, p.raster.domain, p.raster.g_m, solution.crease_m)
    rest = layers(p, solution)
    none = blank(p.raster)
    return replace(
        none, height_m=solution.height_m, slope_u=su, slope_v=sv, sigma_m=rest.sigma_m, confidence=rest.confidence,
        count=rest.count, regime=rest.regime, known=p.raster.domain,
    )  # fmt: skip
