"""Kalman a node with local planes: the plane fit, the filter as an inverse-variance mean, planes at any tilt."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.fusion import kalman_plane


def test_plane_fit_is_weighted_least_squares():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.05, 0.05, (9, 2)), rng.uniform(-0.01, 0.01, 9)])
    variance = rng.uniform(1e-7, 1e-5, 9)
    plane, _ = kalman_plane.fit_plane(points, variance, np.arange(9), 1e6)
    centre = points.mean(axis=0)
    design = np.column_stack([np.ones(9), points[:, :2] - centre[:2]]) / np.sqrt(variance)[:, None]
    expected, *_ = np.linalg.lstsq(design, points[:, 2] / np.sqrt(variance), rcond=None)
    np.testing.assert_allclose(plane, expected, rtol=1e-9)


def test_one_point_is_a_level_with_the_slopes_of_the_prior():
    plane, covariance = kalman_plane.fit_plane(np.array([[0.1, 0.2, 0.3]]), np.array([1e-6]), np.array([0]), 0.47)
    np.testing.assert_allclose(plane, [0.3, 0.0, 0.0])
    np.testing.assert_allclose(np.diag(covariance), [1e-6, 0.47**2, 0.47**2])


def test_a_node_filter_is_the_inverse_variance_mean_of_its_planes():
    rng = np.random.default_rng(1)
    corners = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * 0.005
    heights, points = rng.normal(0.0, 1e-3, 6), []
    for height in heights:
        points += [[*corner, height] for corner in corners]
    sweep = np.repeat(np.arange(6), 4)
    variance = np.repeat(rng.uniform(1e-7, 1e-6, 6), 4)
    heard = kalman_plane.Points(np.array(points), variance, sweep, np.zeros(24, dtype=np.int64))
    trust = kalman_plane.Trust(0.01, 0.01, 0.0, 0.5)
    found, p = kalman_plane.node_filters(heard, np.zeros(1), np.zeros(1), trust)
    weight = 4.0 / variance[::4]
    assert found[0, 0] == pytest.approx(np.sum(weight * heights) / np.sum(weight), rel=1e-9)
    assert p[0, 0] >= 1.0 / weight.sum() * (1 - 1e-9)


@pytest.mark.parametrize("degrees", [0.0, 12.0, 25.0])
def test_a_plane_at_any_tilt_is_met(scan, mapped, degrees):
    slope = np.tan(np.radians(degrees))
    scene, readings = scan(lambda u, v: slope * (u + 0.5 * v), nv=8, outlined=False)
    surface = mapped("kalman_plane", scene, readings)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    assert surface.mask.all()
    np.testing.assert_allclose(surface.height_m, slope * (u + 0.5 * v), atol=5e-6)


def test_one_sensor_on_one_line_borrows_from_the_stops_before(scan, mapped):
    import dataclasses

    scene, readings = scan(lambda u, v: 0.2 * u, nv=1, outlined=False)
    only = np.where(readings.sensor == 0, 0, 1)
    single = dataclasses.replace(
        readings, status=only, range_m=np.where(readings.sensor == 0, readings.range_m, np.inf)
    )
    grid = dataclasses.replace(_line(scene), v_m=np.array([-0.025]))
    surface = mapped("kalman_plane", scene, single, grid)
    hit = surface.mask[0] & (grid.u_m > -0.055) & (grid.u_m < 0.025)
    assert hit.sum() > 5
    np.testing.assert_allclose(surface.height_m[0, hit], 0.2 * grid.u_m[hit], atol=1e-3)


def test_outliers_of_a_facing_plate_leave_no_trace(scan, mapped):
    scene, readings = scan(lambda u, v: 0.0 * u, nv=12, outlined=False, noise_m=3e-4, outliers=0.1, seed=3)
    surface = mapped("kalman_plane", scene, readings)
    assert np.nanmax(np.abs(surface.height_m)) < 0.0015


def _line(scene):
    from surfuse.records import MapGrid

    return MapGrid((np.arange(12) - 5.5) * 0.01, np.zeros(1), scene.world_from_part)
