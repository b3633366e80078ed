"""Inverse variance: the closed form, and the mean as its special case."""

from __future__ import annotations

import dataclasses

import numpy as np

from surfuse.fusion import inverse_variance, mean
from surfuse.records import MapGrid

GRID = MapGrid(np.arange(3) * 0.01, np.arange(3) * 0.01, np.eye(4))


def test_closed_form(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, outlined=False)
    rng = np.random.default_rng(4)
    sigma = rng.uniform(1e-4, 3e-3, len(readings.range_m))
    noisy = dataclasses.replace(readings, sigma_m=sigma, range_m=readings.range_m + rng.normal(0.0, sigma))
    points = inverse_variance.create(inverse_variance.Parameters()).replay(scene, noisy, GRID).points
    m, w = noisy.range_m.reshape(-1, 4), 1.0 / sigma.reshape(-1, 4) ** 2
    expected = (w * m).sum(axis=1) / w.sum(axis=1)
    np.testing.assert_allclose(points.depth_m, expected, rtol=0, atol=1e-12)
    assert np.all(points.sigma_m >= 1.0 / np.sqrt(w.sum(axis=1)) * (1 - 1e-12))
    np.testing.assert_allclose(points.dc.reshape(-1, 4), w / w.max(axis=1, keepdims=True))


def test_variance_of_agreeing_readings(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, outlined=False)
    sigma = np.tile([1e-3, 2e-3, 3e-3, 4e-3], readings.n_sweeps)
    points = (
        inverse_variance.create(inverse_variance.Parameters())
        .replay(scene, dataclasses.replace(readings, sigma_m=sigma), GRID)
        .points
    )
    np.testing.assert_allclose(points.sigma_m, 1.0 / np.sqrt(np.sum(1.0 / np.array([1e-3, 2e-3, 3e-3, 4e-3]) ** 2)))


def test_equal_sensors_give_the_mean(scan):
    scene, readings = scan(lambda u, v: 0.1 * u, noise_m=1e-3, missing=0.2)
    ours = inverse_variance.create(inverse_variance.Parameters()).replay(scene, readings, GRID).points
    theirs = mean.create(mean.Parameters()).replay(scene, readings, GRID).points
    np.testing.assert_allclose(ours.depth_m, theirs.depth_m, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(ours.gap, theirs.gap)
