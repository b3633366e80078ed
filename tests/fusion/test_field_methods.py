"""What the methods of the field share: frames, wrists, dead lengths, despiking, places, gaps, outlines."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.fusing.cones import columns_within, nearest_node, shell
from surfuse.fusing.despiking import supported
from surfuse.fusing.places import covered, feet_on_part, nodes_on_part
from surfuse.fusing.sites import between, groups, mean_sites, median_sites
from surfuse.fusing.survey import survey
from surfuse.fusion import median
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import MapGrid, Outline, Readings
from surfuse.registry import load

MAPWISE = (
    "arc_median", "carving", "directional_maximum", "gaussian_process", "kalman_plane", "occupancy", "own_axis_median",
    "single_sensor",
)  # fmt: skip
ALL = (*MAPWISE, "inverse_variance", "kalman_line")
ELSEWHERE = pose(rotation_about([0.3, -0.5, 0.8], 2.1), [1.2, -0.4, 0.9])


def moved(scene, readings, world_from_old):
    """The same scan in another place of the world."""
    rotation = world_from_old[:3, :3]
    outline = scene.outline
    if outline is not None:
        outline = dataclasses.replace(outline, world_from_part=world_from_old @ outline.world_from_part)
    return dataclasses.replace(
        scene, world_from_part=world_from_old @ scene.world_from_part, outline=outline
    ), dataclasses.replace(
        readings,
        position_m=readings.position_m @ rotation.T + world_from_old[:3, 3],
        axis=readings.axis @ rotation.T,
        world_from_grip=world_from_old @ readings.world_from_grip,
    )


def heard(scene, readings, grid):
    gate = median.create(median.Parameters()).replay(scene, readings, grid).points.gate
    return survey(scene, readings, gate, grid)


def nodes(scene, nu=12, nv=5):
    return MapGrid((np.arange(nu) - (nu - 1) / 2) * 0.01, (np.arange(nv) - (nv - 1) / 2) * 0.01, scene.world_from_part)


@pytest.mark.parametrize("name", ALL)
def test_the_part_frame_may_be_anywhere(scan, mapped, name):
    # Odd slopes and spacings: nothing may lie on the border of a voxel, where rounding decides.
    scene, readings = scan(lambda u, v: 0.0137 + 0.1131 * u - 0.0713 * v, nv=8, noise_m=1e-4, seed=5)
    here, there = mapped(name, scene, readings), mapped(name, *moved(scene, readings, ELSEWHERE))
    np.testing.assert_array_equal(here.mask, there.mask)
    # Of neighbours at the same distance rounding picks the last one.
    tolerance = 3e-5 if name == "gaussian_process" else 2e-6
    np.testing.assert_allclose(here.height_m, there.height_m, atol=tolerance)
    np.testing.assert_allclose(here.sigma_m, there.sigma_m, atol=tolerance)
    assert here.mask.any()


@pytest.mark.parametrize("name", MAPWISE)
def test_every_cell_has_all_layers_and_outline_and_gaps_are_kept(scan, mapped, name):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=20, nv=16, noise_m=3e-4, missing=0.1)
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    scene = dataclasses.replace(scene, outline=Outline(box * [0.07, 0.06], np.eye(4), holes_m=(box * 0.015,)))
    surface = mapped(name, scene, readings)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    part = (np.abs(u) < 0.07) & (np.abs(v) < 0.06) & ~((np.abs(u) < 0.015) & (np.abs(v) < 0.015))
    assert not surface.mask[~part].any()
    assert surface.mask[part].mean() > 0.75
    m = surface.mask
    assert np.all(surface.sigma_m[m] > 0.0)
    assert np.all((surface.confidence >= 0.0) & (surface.confidence <= 1.0))
    assert np.all(surface.confidence[m] > 0.0)
    assert np.all(surface.count[m] > 0)
    assert np.all(np.isnan(surface.height_m[~m]) & np.isnan(surface.sigma_m[~m]))
    assert np.all((surface.regime == 1) == m)
    assert surface.method == name


@pytest.mark.parametrize("name", MAPWISE)
def test_nothing_is_invented_away_from_the_readings(scan, mapped, name):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=8, nv=6, outlined=False)
    wide = MapGrid(np.arange(-20, 21) * 0.01, np.arange(-20, 21) * 0.01, scene.world_from_part)
    surface = mapped(name, scene, readings, wide)
    u, v = np.meshgrid(wide.u_m, wide.v_m)
    assert not surface.mask[(np.abs(u) > 0.071) | (np.abs(v) > 0.061)].any()


@pytest.mark.parametrize("name", ["own_axis_median", "gaussian_process", "kalman_plane"])
@pytest.mark.parametrize("degrees", [20.0, 45.0])
def test_a_turned_wrist_reads_along_the_normal(mapped, name, degrees):
    tilt = np.radians(degrees)
    turn = rotation_about([0, 1, 0], -tilt)
    u, v = np.meshgrid(np.arange(-6, 7) * 0.01, np.arange(-4, 5) * 0.01)
    foot = np.column_stack([u.ravel(), v.ravel(), np.tan(tilt) * u.ravel()])
    axis = np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    n = len(foot)
    grip = np.tile(pose(turn @ rotation_about([1, 0, 0], np.pi), [0, 0, 0]), (n, 1, 1))
    grip[:, :3, 3] = foot - 0.4 * axis
    from surfuse.records import FusionScene, SensorSpec

    spec = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 0.0003)
    readings = Readings(
        specs=(spec,), t_s=np.arange(n), sensor=np.zeros(n), position_m=grip[:, :3, 3], axis=np.tile(axis, (n, 1)),
        range_m=np.full(n, 0.4), status=np.zeros(n), amplitude=np.full(n, np.nan), sigma_m=np.full(n, np.nan),
        count=np.ones(n), start=np.arange(n + 1), stop=np.arange(n), row=np.repeat(np.arange(9), 13),
        world_from_grip=grip,
    )  # fmt: skip
    grid = MapGrid(np.arange(-5, 6) * 0.01, np.arange(-3, 4) * 0.01, np.eye(4))
    surface = mapped(name, FusionScene((spec,), np.eye(4)), readings, grid)
    assert surface.mask.all()
    # One sensor: a plane of three stops on one line has the prior's slope across it.
    np.testing.assert_allclose(surface.height_m, np.tile(np.tan(tilt) * grid.u_m, (7, 1)), atol=2e-4)


def test_the_beam_starts_after_the_dead_length(scan):
    scene, readings = scan(lambda u, v: 0.0 * u)
    tube = tuple(dataclasses.replace(spec, dead_length_m=0.2) for spec in scene.specs)
    s = heard(dataclasses.replace(scene, specs=tube), readings, nodes(scene))
    np.testing.assert_allclose(s.range_m, 0.23)
    np.testing.assert_allclose(s.start_m[:, 2], 0.23)
    np.testing.assert_allclose(s.foot_m[:, 2], 0.0, atol=1e-12)


def test_readings_from_behind_or_past_the_part_are_left_out(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, outlined=False)
    axis = readings.axis.copy()
    axis[0], axis[1] = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
    assert len(heard(scene, dataclasses.replace(readings, axis=axis), nodes(scene))) == len(readings.range_m) - 2


def test_despiking_asks_the_neighbours_and_not_the_other_sensors(scan):
    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.09, 0.0), nu=16, nv=10, outlined=False)
    clean = heard(scene, readings, nodes(scene))
    assert supported(clean).all()
    ranges = readings.range_m.copy()
    spikes = np.array([41, 200, 333, 500])
    ranges[spikes] += [0.06, -0.06, 0.03, 0.1]
    spiked = heard(scene, dataclasses.replace(readings, range_m=ranges), nodes(scene))
    np.testing.assert_array_equal(np.flatnonzero(~supported(spiked)), spikes)


def test_most_spikes_are_found_among_three_in_ten(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=20, nv=14, outlined=False, outliers=0.3, seed=7)
    s = heard(scene, readings, nodes(scene))
    spike = np.abs(s.foot_m[:, 2]) > 0.01
    kept = supported(s)
    assert kept[~spike].mean() > 0.99
    assert kept[spike].mean() < 0.12


def test_readings_of_one_place_judge_each_other(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=1, nv=1, outlined=False)
    twelve = np.zeros(12, dtype=np.int64)
    s = heard(scene, readings, nodes(scene)).select(twelve)
    s.foot_m[5, 2] += 0.05
    np.testing.assert_array_equal(np.flatnonzero(~supported(s)), [5])


def test_spacing_is_that_of_the_stops(scan):
    scene, readings = scan(lambda u, v: 0.0 * u)
    assert heard(scene, readings, nodes(scene)).spacing_m == pytest.approx(0.01)


def test_sites_are_medians_and_weighted_means():
    points = np.array([[0.0, 0.0, 1.0], [1e-4, 0.0, 2.0], [0.0, 1e-4, 9.0], [0.01, 0.0, 5.0]])
    sigma = np.array([1e-3, 2e-3, 1e-3, 1e-3])
    assert groups(points[:, :2], 0.01).tolist() == [0, 0, 0, 1]
    assert median_sites(points, sigma, 0.01).height_m.tolist() == [2.0, 5.0]
    mean = mean_sites(points, sigma, 0.01, believed=True)
    assert mean.height_m[0] == pytest.approx((1.0 + 0.25 * 2.0 + 9.0) / 2.25)
    assert mean.sigma_m[0] == pytest.approx(1e-3 / 1.5)


def test_between_sites_a_plane_is_met_and_outside_the_nearest_site():
    rng = np.random.default_rng(0)
    uv = np.vstack([rng.uniform(-0.05, 0.05, (60, 2)), [[-0.06, -0.06], [0.06, -0.06], [-0.06, 0.06], [0.06, 0.06]]])
    points = np.column_stack([uv, 0.3 * uv[:, 0] - 0.2 * uv[:, 1]])
    sites = mean_sites(points, np.full(64, 1e-3), 1e-5)
    grid = MapGrid(np.linspace(-0.05, 0.05, 11), np.linspace(-0.05, 0.05, 9), np.eye(4))
    height, sigma = between(sites, grid, np.ones(grid.shape, dtype=bool))
    np.testing.assert_allclose(height, 0.3 * grid.u_m[None, :] - 0.2 * grid.v_m[:, None], atol=5e-7)
    assert np.all(sigma <= 1e-3 + 1e-12)
    far = MapGrid(np.array([0.2]), np.array([0.06]), np.eye(4))
    assert between(sites, far, np.ones((1, 1), dtype=bool))[0][0, 0] == pytest.approx(0.3 * 0.06 - 0.2 * 0.06)


def test_covered_is_within_three_quarters_of_a_stop(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=6, nv=6, outlined=False)
    grid = MapGrid(np.arange(-100, 101) * 0.001, np.zeros(1), scene.world_from_part)
    inside = covered(heard(scene, readings, grid), grid)[0]
    # The outermost sensors stand at 25 + 25 mm; v = 0 is a line of hits.
    np.testing.assert_array_equal(inside, np.abs(grid.u_m) <= 0.0575)


def test_outline_seen_from_its_viewpoint():
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.05
    outline = Outline(box, np.eye(4), viewpoint_m=np.array([0.0, 0.0, 1.0]))
    grid = MapGrid(np.array([0.0, 0.03, 0.048]), np.zeros(1), np.eye(4))
    np.testing.assert_array_equal(nodes_on_part(grid, outline, np.zeros((1, 3)))[0], [True, True, True])
    np.testing.assert_array_equal(nodes_on_part(grid, outline, np.full((1, 3), 0.1))[0], [True, True, False])


def test_feet_beside_the_outline_are_not_on_the_part(scan):
    scene, readings = scan(lambda u, v: 0.0 * u)
    s = heard(scene, readings, nodes(scene))
    expected = (np.abs(s.foot_m[:, 0]) <= 0.06 + 1e-9) & (np.abs(s.foot_m[:, 1]) <= 0.025 + 1e-9)
    np.testing.assert_array_equal(feet_on_part(s, nodes(scene)), expected)


def test_cones_cover_what_lies_within_their_angle():
    axis = np.array([np.sin(0.4), 0.0, -np.cos(0.4)])
    u = v = np.arange(-60, 61) * 0.005
    start, r, spread = np.array([0.0, 0.0, 0.4]), 0.42, 0.15
    c0, c1, r0, r1 = columns_within(start, axis, r, spread, u, v)
    for k in range(len(v)):
        for c in range(len(u)):
            drop, share = shell(u[c], v[k], axis, r, spread)
            direction = np.array([u[c], v[k], -drop]) / r
            if np.isfinite(share):
                assert share * spread == pytest.approx(np.arccos(np.clip(direction @ axis, -1, 1)), abs=1e-7)
            assert share > 1.0 or (c0 <= c < c1 and r0 <= k < r1)
    assert nearest_node(0.0124, -0.0126, u, v) == (57, 62)
    assert nearest_node(0.304, 0.0, u, v) == (-1, -1)


@pytest.mark.parametrize("name", MAPWISE)
def test_a_foreign_state_is_refused(name):
    module = load("fusion", name)
    with pytest.raises(DataError, match="pass what its start"):
        module.create(module.Parameters()).finish(object(), MapGrid(np.zeros(1), np.zeros(1), np.eye(4)))


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("single_sensor", "sensor", -1), ("carving", "quantile", 0.9), ("occupancy", "detection", 1.5),
        ("gaussian_process", "neighbours", 1), ("kalman_plane", "reach_m", 0.0), ("kalman_line", "slope_sigma", -1.0),
        ("arc_median", "transversal_share", 2.0), ("directional_maximum", "voxel_m", 0.0),
        ("own_axis_median", "gate_footprints", -1.0), ("inverse_variance", "gate_allowance_m", float("nan")),
    ],
)  # fmt: skip
def test_parameters_outside_their_limits_are_refused(name, field, value):
    with pytest.raises(ConfigError, match=field):
        load("fusion", name).Parameters(**{field: value})


@pytest.mark.parametrize("name", ALL)
def test_a_scan_of_two_and_a_half_thousand_readings_is_mapped_whole_and_twice_alike(scan, mapped, name):
    scene, readings = scan(lambda u, v: 0.02 * np.sin(10 * u), nu=25, nv=25, noise_m=3e-4, outliers=0.02)
    once, again = mapped(name, scene, readings), mapped(name, scene, readings)
    np.testing.assert_array_equal(once.height_m, again.height_m)
    np.testing.assert_array_equal(once.sigma_m, again.sigma_m)
    error_m = once.height_m - 0.02 * np.sin(10 * once.grid.u_m)
    assert np.isfinite(error_m).mean() > 0.8
    assert np.nanmedian(np.abs(error_m)) < 0.006
