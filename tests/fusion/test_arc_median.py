"""Arc-transversal median: crossings of circles, a corner heard from aside, planes, lonely arcs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from surfuse.fusion import arc_median
from surfuse.fusion.arc_median import Arc, crossing_bearing


def bearing_of(x, other_x, target, least=0.0, spread=0.3):
    """Bearing from x where the arcs of two sensors at height 0.4, looking down, cross when both hear a target."""
    r, other_r = math.dist((x, 0.4), target), math.dist((other_x, 0.4), target)
    arc, other = Arc(x, 0.4, 0.0, -1.0, r, spread), Arc(other_x, 0.4, 0.0, -1.0, other_r, spread)
    return crossing_bearing(arc, other, least)


@pytest.mark.parametrize("target", [(0.0, 0.0), (0.03, 0.01), (-0.05, -0.02)])
def test_two_arcs_cross_where_both_heard_it(target):
    for x, other_x in ((-0.04, 0.05), (0.05, -0.04)):
        assert bearing_of(x, other_x, target) == pytest.approx(math.atan2(target[0] - x, 0.4 - target[1]))


def test_crossings_outside_of_a_beam_or_too_flat_do_not_count():
    assert math.isnan(bearing_of(-0.04, 0.05, (0.2, 0.0)))
    crossing_angle = math.atan2(0.04, 0.4) + math.atan2(0.05, 0.4)
    assert not math.isnan(bearing_of(-0.04, 0.05, (0.0, 0.0), least=crossing_angle - 1e-6))
    assert math.isnan(bearing_of(-0.04, 0.05, (0.0, 0.0), least=crossing_angle + 1e-6))
    assert math.isnan(bearing_of(0.02, 0.02, (0.0, 0.0)))


def test_a_ridge_is_found_where_the_axes_only_see_the_ground(cone_scan):
    # A thin ridge: heard from everywhere around it, and far too wide on the own axes.
    scene, readings = cone_scan(lambda u, v: np.where(np.abs(u) < 0.0015, 0.05, 0.0), nu=12, nv=6, outlined=False)
    from surfuse.fusing.survey import survey
    from surfuse.fusion import median
    from surfuse.records import MapGrid

    grid = MapGrid(np.arange(3) * 0.01, np.arange(3) * 0.01, scene.world_from_part)
    gate = median.create(median.Parameters()).replay(scene, readings, grid).points.gate
    heard = survey(scene, readings, gate, grid)
    near = (heard.range_m < 0.40) & (np.abs(heard.foot_m[:, 0]) > 0.012)
    points, _ = arc_median.placed(heard, arc_median.Parameters())
    assert near.sum() > 20
    assert np.median(np.abs(points[near, 0])) < 0.35 * np.median(np.abs(heard.foot_m[near, 0]))


@pytest.mark.parametrize("degrees", [0.0, 3.0])
def test_a_plane_is_met_but_for_the_sagitta_of_its_rims(cone_scan, mapped, degrees):
    slope = np.tan(np.radians(degrees))
    scene, readings = cone_scan(lambda u, v: slope * u, nu=18, nv=16, outlined=False)
    surface = mapped("arc_median", scene, readings)
    error = surface.height_m - slope * surface.grid.u_m
    # An echo moved to the end of both its arcs is 0.43 (1 - cos 6.5 degrees) too near, twice.
    assert np.nanmax(np.abs(error)) < 0.0056
    middle = error[6:10, 7:11]
    assert np.nanmax(np.abs(middle)) < 0.0028
    covered = np.abs(error) < 3.0 * surface.sigma_m
    assert covered[surface.mask].mean() > 0.9


def test_lonely_arcs_keep_their_middle_or_are_left_out(scan, mapped):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=1, nv=1, outlined=False)
    apart = dataclasses.replace(readings, position_m=readings.position_m * np.array([40.0, 40.0, 1.0]))
    kept = mapped("arc_median", scene, apart, _at(scene, apart))
    assert kept.mask.sum() == 4
    np.testing.assert_allclose(kept.height_m[kept.mask], 0.0, atol=1e-12)
    assert not mapped("arc_median", scene, apart, _at(scene, apart), keep_lonely=False).mask.any()


def test_light_does_not_move(scan, mapped):
    scene, readings = scan(lambda u, v: 0.3 * u, nv=8, outlined=False)
    light = tuple(dataclasses.replace(spec, kind="infrared") for spec in scene.specs)
    surface = mapped("arc_median", dataclasses.replace(scene, specs=light), readings)
    np.testing.assert_allclose(surface.height_m, np.tile(0.3 * surface.grid.u_m, (8, 1)), atol=1e-9)


def _at(scene, readings):
    from surfuse.records import MapGrid

    return MapGrid(np.unique(readings.position_m[:, 0]), np.unique(readings.position_m[:, 1]), scene.world_from_part)
