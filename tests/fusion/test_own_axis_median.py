"""Own-axis median: planes exactly at any tilt, spikes out, steps sharp, gaps kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest


@pytest.mark.parametrize("degrees", [0.0, 5.0, 15.0, 25.0])
@pytest.mark.parametrize("turn", [0.0, 40.0])
def test_a_plane_at_any_tilt_is_met_exactly(scan, mapped, degrees, turn):
    a = np.tan(np.radians(degrees)) * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    scene, readings = scan(lambda u, v: a[0] * u + a[1] * v, nv=8, outlined=False)
    surface = mapped("own_axis_median", scene, readings)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    assert surface.mask.all()
    np.testing.assert_allclose(surface.height_m, a[0] * u + a[1] * v, atol=1e-9)


def test_outliers_of_a_facing_plate_leave_no_trace(scan, mapped):
    scene, readings = scan(lambda u, v: 0.0 * u, nv=12, outlined=False, noise_m=3e-4, outliers=0.1, seed=3)
    surface = mapped("own_axis_median", scene, readings)
    assert surface.mask.mean() > 0.95
    assert np.nanmax(np.abs(surface.height_m)) < 0.0015
    assert np.nanmean(surface.confidence) < 0.97
    raw = mapped("own_axis_median", scene, readings, despike=False)
    assert np.nanmax(np.abs(raw.height_m)) > np.nanmax(np.abs(surface.height_m))


def test_a_step_between_two_places_stays_between_them(scan, mapped):
    scene, readings = scan(lambda u, v: np.where(u > 0.0, 0.09, 0.0), nv=10, outlined=False)
    surface = mapped("own_axis_median", scene, readings)
    left, right = surface.grid.u_m < -0.006, surface.grid.u_m > 0.006
    np.testing.assert_allclose(surface.height_m[:, left], 0.0, atol=1e-9)
    np.testing.assert_allclose(surface.height_m[:, right], 0.09, atol=1e-9)


def test_no_value_where_nobody_looked(scan, mapped):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=16, nv=12, outlined=False)
    hole = np.hypot(readings.position_m[:, 0], readings.position_m[:, 1]) < 0.025
    lost = dataclasses.replace(
        readings, range_m=np.where(hole, np.inf, readings.range_m), status=np.where(hole, 1, readings.status)
    )
    surface = mapped("own_axis_median", scene, lost)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    assert not surface.mask[np.hypot(u, v) < 0.012].any()
    assert surface.mask[np.hypot(u, v) > 0.035].all()


def test_sensors_that_repeat_each_others_speckle_do_not_earn_a_small_sigma(scan, mapped):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=20, nv=14, outlined=False)
    place = np.round(readings.position_m[:, :2] / 0.005).astype(np.int64)
    _, number = np.unique(place, axis=0, return_inverse=True)
    speckle = np.random.default_rng(2).normal(0.0, 0.003, number.max() + 1)[number.ravel()]
    heard = dataclasses.replace(readings, range_m=readings.range_m + speckle)
    surface = mapped("own_axis_median", scene, heard)
    # Each node lies between four places of 3 mm each.
    error = np.sqrt(np.nanmean(surface.height_m**2))
    assert 0.7 * error < np.nanmedian(surface.sigma_m) < 1.5 * error
