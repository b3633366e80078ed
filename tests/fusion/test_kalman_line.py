"""Kalman along the line: batch least squares on linear data, planes, fresh starts at steps, outliers gated."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surfuse.fusion import kalman_line
from surfuse.records import Gap, MapGrid

GRID = MapGrid(np.arange(3) * 0.01, np.arange(3) * 0.01, np.eye(4))
PLAIN = {"bend_per_root_m": 0.0, "scatter_memory": 0.0, "gate_sigmas": 50.0}


def fuse(scene, readings, **given):
    return kalman_line.create(kalman_line.Parameters(**given)).replay(scene, readings, GRID).points


def test_equals_batch_least_squares_on_a_plane(scan):
    scene, readings = scan(lambda u, v: 0.02 + 0.2 * u - 0.1 * v, nv=1, outlined=False, noise_m=3e-4, seed=1)
    points = fuse(scene, readings, slope_sigma=0.5, **PLAIN)
    hits = readings.position_m - np.array([0.0, 0.0, 1.0]) * readings.range_m[:, None]
    for j in (3, 11):
        u0 = readings.world_from_grip[j, :2, 3]
        rows = hits[: 4 * (j + 1)]
        design = np.column_stack([np.ones(len(rows)), rows[:, 0] - u0[0], rows[:, 1] - u0[1]])
        # The slopes' prior counts as two more rows, in units of the readings' sigma.
        prior = np.array([[0.0, 3e-4 / 0.5, 0.0], [0.0, 0.0, 3e-4 / 0.5]])
        full, right = np.vstack([design, prior]), np.append(rows[:, 2], [0.0, 0.0])
        solution, *_ = np.linalg.lstsq(full, right, rcond=None)
        covariance = np.linalg.inv(full.T @ full) * 3e-4**2
        assert points.point_m[j, 2] == pytest.approx(solution[0], abs=2e-8)
        assert points.sigma_m[j] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-4)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 25.0])
def test_a_tilted_plane_is_no_change_of_depth(scan, degrees):
    slope = np.tan(np.radians(degrees))
    scene, readings = scan(lambda u, v: slope * u, outlined=False)
    points = fuse(scene, readings)
    # The prior pulls the first sweep of a line towards the level, by a thousandth of the tilt at most.
    np.testing.assert_allclose(points.point_m[:, 2], slope * points.point_m[:, 0], atol=1e-5)
    assert not points.reset.any()


def test_starts_afresh_when_most_of_a_sweep_has_jumped(scan):
    scene, readings = scan(lambda u, v: np.where(u > 0.02, 0.09, 0.0), nu=20, nv=2, outlined=False)
    points = fuse(scene, readings)
    assert points.reset.reshape(2, 20).sum(axis=1).tolist() == [1, 1]
    far = np.abs(points.point_m[:, 0] - 0.02) > 0.03
    np.testing.assert_allclose(points.point_m[far, 2], np.where(points.point_m[far, 0] > 0.02, 0.09, 0.0), atol=1e-3)


def test_a_lone_outlier_is_gated(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, nv=1, outlined=False, noise_m=3e-4, seed=2)
    ranges = readings.range_m.copy()
    ranges[4 * 6 + 1] += 0.05
    points = fuse(scene, _with(readings, ranges))
    assert points.dc[4 * 6 + 1] == 0.0
    assert np.abs(points.point_m[:, 2]).max() < 0.0015


def test_readings_beside_the_part_hardly_count(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, nu=16, nv=10)
    beside = np.abs(readings.position_m[:, 0]) > 0.08
    late = _with(readings, np.where(beside, readings.range_m + 0.01, readings.range_m))
    value = fuse(scene, late).gap == Gap.NONE
    blind = fuse(dataclasses.replace(scene, outline=None), late).point_m[value, 2]
    seeing = fuse(scene, late).point_m[value, 2]
    assert np.mean(np.abs(seeing)) < 0.6 * np.mean(np.abs(blind))


def test_a_new_line_knows_nothing_of_the_last(scan):
    scene, readings = scan(lambda u, v: np.where(v > 0.0, 0.3, 0.0), nv=2, outlined=False)
    alone = fuse(scene, readings)
    assert not alone.reset.any()


def _with(readings, ranges):
    return dataclasses.replace(readings, range_m=ranges)
