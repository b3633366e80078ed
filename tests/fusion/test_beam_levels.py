"""Loud and quiet echoes, parallel levels under the free space, borders that move one by one, edges inside of cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.fusion.test_beam import scan, to_plane, to_step

from surfuse.beam_model.heard.domain import raster_over
from surfuse.beam_model.heard.stations import gather, spacing
from surfuse.beam_model.map.estimate import domain_of, tables_of
from surfuse.beam_model.map.nodes import finer_grid, on_grid
from surfuse.beam_model.map.tiles import RasterLayers, blank
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.search.edges import borders, grown, sloped
from surfuse.beam_model.search.estimation import Estimation, loudness, problem
from surfuse.beam_model.search.terraces import levels_of, stepped
from surfuse.beam_model.search.unheld_pieces import pieces
from surfuse.errors import DataError
from surfuse.fusion import beam
from surfuse.records import FloatArray, MapGrid
from surfuse.surface.resample import thinned

CREASE_M = 0.004


def estimation(amplitude: float = float("nan"), g_m: float = 0.005) -> Estimation:
    """A facing plate, whose readings all have one amplitude."""
    scene, readings, grid = scan(to_plane(0.0), outliers=0.0)
    readings = replace(readings, amplitude=np.full(len(readings.range_m), amplitude))
    stations = gather(readings, scene)
    raster = raster_over(grid, g_m)
    raster = replace(raster, domain=domain_of(scene, raster, grid, stations.foot_m, 0.04))
    return problem(stations, tables_of(scene, stations, beam.Parameters().detector), raster, spacing(stations))


def over(p: Estimation, slope: float) -> float:
    u, v = p.raster.nodes()
    uu, _ = np.meshgrid(u, v)
    cost = loudness(p, slope * uu, CREASE_M)
    middle = np.hypot(p.stations.foot_m[:, 0], p.stations.foot_m[:, 1]) < 0.04
    return float(np.mean(cost[middle]))


def test_a_loud_echo_needs_a_surface_that_faces_the_sensor() -> None:
    p = estimation(0.9)
    assert over(p, 0.0) < 0.05
    assert over(p, np.tan(np.radians(22.0))) > 2.0


def test_a_quiet_echo_says_that_nothing_faces_the_sensor() -> None:
    p = estimation(0.04)
    assert over(p, np.tan(np.radians(22.0))) < 0.3
    assert over(p, 0.0) > 2.0


def test_readings_without_an_amplitude_say_nothing_of_it() -> None:
    p = estimation()
    assert over(p, 0.0) == over(p, 0.4) == 0.0


def stairs(p: Estimation) -> tuple[FloatArray, FloatArray]:
    """Treads of 3 cm, and the arcs that the rims above them leave free."""
    u, v = p.raster.nodes()
    uu, _ = np.meshgrid(u, v)
    share = np.mod((uu + 0.1001) / 0.03, 1.0)
    truth = 0.012 * np.floor((uu + 0.1001) / 0.03)
    return truth, truth + 0.012 * np.maximum(share - 0.3, 0.0) ** 2


def test_treads_are_found_under_the_arcs_of_the_free_space() -> None:
    p = estimation()
    truth, free = stairs(p)
    levels = levels_of(p, free)
    treads, cells = np.unique(np.round(truth[p.raster.domain], 6), return_counts=True)
    whole = treads[cells > 0.9 * np.max(cells)]
    assert len(whole) >= 4
    assert all(np.min(np.abs(levels - one)) < 0.0012 for one in whole)
    found = stepped(p, free, 0.0, 0.0)
    assert found is not None
    assert np.mean(np.abs(found - truth)[p.raster.domain] < 0.002) > 0.9


def test_one_level_makes_no_terraces() -> None:
    p = estimation()
    assert stepped(p, np.zeros(p.raster.shape), 0.0, 0.0) is None


def test_a_border_moves_over_the_piece_beyond_it_alone() -> None:
    p = estimation()
    u, v = p.raster.nodes()
    uu, vv = np.meshgrid(u, v)
    height = np.where(uu > 0.0, 0.03, 0.0) + np.where((uu > 0.0) & (vv > 0.0), 0.03, 0.0)
    number = pieces(height, p.raster.domain, p.raster.g_m, 2.0 * CREASE_M)
    low = int(number[np.unravel_index(np.argmin(np.where(p.raster.domain, uu, np.inf)), uu.shape)])
    names = {border[:2] for border in borders(number)}
    assert len({one for pair in names for one in pair}) == 3
    beyond = next(other for one, other, way in borders(number) if one == low and way == (0, 1))
    moved = grown(sloped(p, height, CREASE_M), number == low, number == beyond, (0, 1), 2)
    changed = moved != height
    assert np.any(changed)
    assert np.all(number[changed] == beyond)
    assert np.all(moved[changed] == 0.0)


def two_plateaus(edge: float) -> RasterLayers:
    """Height 0 left of the border between columns 3 and 4, 0.03 right of it; the edge lies `edge` cells beside it."""
    raster = Raster(0.0, 0.0, 0.01, np.ones((6, 8), dtype=bool))
    height, edges = np.zeros((6, 8)), np.zeros((6, 8))
    height[:, 4:] = 0.03
    edges[:, 3] = edge
    return replace(blank(raster), height_m=height, known=raster.domain, edge_u=edges)


@pytest.mark.parametrize("edge", [-0.4, -0.1, 0.0, 0.2, 0.45])
def test_an_edge_lies_where_it_was_found_inside_its_cell(edge: float) -> None:
    u = np.arange(0.0, 0.0701, 0.0005)
    surface = on_grid(two_plateaus(edge), MapGrid(u, np.arange(6) * 0.01, np.eye(4)))
    first = u[np.argmax(surface.height_m[2] > 0.015)]
    assert first == pytest.approx(0.035 + 0.01 * edge, abs=0.0006)


def test_nodes_are_as_close_as_the_cells_and_closer_where_an_edge_is_inside_one() -> None:
    grid = MapGrid(np.arange(5) * 0.02, np.arange(4) * 0.02, np.eye(4))
    plain, edged = finer_grid(two_plateaus(0.0), grid), finer_grid(two_plateaus(0.2), grid)
    assert plain.shape == (7, 9)
    assert edged.shape == (19, 25)
    np.testing.assert_allclose(edged.u_m[::6], grid.u_m, atol=1e-12)


def test_the_map_of_a_scan_has_the_nodes_of_its_stops_among_its_own() -> None:
    scene, readings, grid = scan(to_step(0.06, 0.042))
    surface = beam.create(beam.Parameters()).replay(scene, readings, grid).surface
    assert surface is not None
    assert surface.grid.shape[0] >= 2 * grid.shape[0] - 1
    coarse = thinned(surface, grid)
    at = np.argmin(np.abs(surface.grid.u_m - grid.u_m[3]))
    row = np.argmin(np.abs(surface.grid.v_m - grid.v_m[5]))
    assert coarse.height_m[5, 3] == surface.height_m[row, at]
    with pytest.raises(DataError, match="no node of the map"):
        thinned(surface, MapGrid(grid.u_m + 0.0031, grid.v_m, grid.world_from_part))
