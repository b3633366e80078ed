"""Gaussian process: the dense process on small data, planes, sums of evidence, constants from the readings."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.fusing.covariances import Covariance, chosen, matern
from surfuse.fusing.sites import Sites
from surfuse.fusion import gaussian_process


def test_equals_the_dense_process_on_small_data():
    rng = np.random.default_rng(0)
    uv, nodes = rng.uniform(-0.05, 0.05, (40, 2)), rng.uniform(-0.05, 0.05, (7, 2))
    sigma = rng.uniform(2e-4, 2e-3, 40)
    height = 0.1 + 0.2 * uv[:, 0] + 0.01 * np.sin(60 * uv[:, 1]) + rng.normal(0.0, sigma)
    covariance = Covariance(0.02, 0.005, 1.5)
    sites = Sites(uv, height, sigma, np.ones(40, dtype=np.int64))
    index = np.tile(np.arange(40), (7, 1))
    mean, deviation = gaussian_process.kriged(sites, nodes, index, covariance, 0.5)
    for node, m, s in zip(nodes, mean, deviation, strict=True):
        # The plane as a covariance: a very uncertain offset and slopes of 0.5, all about the node.
        def k(a, b, at=node):
            linear = 1e2 + 0.25 * (a - at) @ (b - at).T
            return 0.005**2 * matern(a, b, 0.02) + linear

        gram = k(uv, uv) + np.diag((1.5 * sigma) ** 2)
        cross = k(uv, node[None])[:, 0]
        solved = np.linalg.solve(gram, np.column_stack([height, cross]))
        assert m == pytest.approx(cross @ solved[:, 0], abs=1e-7)
        assert s == pytest.approx(np.sqrt(k(node[None], node[None])[0, 0] - cross @ solved[:, 1]), rel=2e-3)


def test_matern_is_one_at_home_and_falls_as_written():
    a = np.array([[0.0, 0.0], [0.03, 0.04]])
    x = 3**0.5 * 0.05 / 0.02
    np.testing.assert_allclose(matern(a, a, 0.02), [[1.0, (1 + x) * np.exp(-x)], [(1 + x) * np.exp(-x), 1.0]])


def test_constants_are_found_again_in_a_draw_of_the_process():
    rng = np.random.default_rng(3)
    u, v = np.meshgrid(np.arange(20) * 0.01, np.arange(20) * 0.01)
    uv, sigma = np.column_stack([u.ravel(), v.ravel()]), np.full(400, 3e-4)
    gram = 0.004**2 * matern(uv, uv, 0.04) + 1e-12 * np.eye(400)
    height = np.linalg.cholesky(gram) @ rng.normal(size=400) + rng.normal(0.0, 2 * 3e-4, 400)
    near = np.argsort(np.linalg.norm(uv[:, None] - uv[None], axis=2), axis=1, kind="stable")[::13, :48]
    found = chosen(uv, height, sigma, near, 0.01)
    assert 0.015 <= found.length_m <= 0.17
    assert found.noise == pytest.approx(2.0, rel=0.5)


@pytest.mark.parametrize("degrees", [0.0, 15.0, 25.0])
def test_a_plane_at_any_tilt_is_met(scan, mapped, degrees):
    slope = np.tan(np.radians(degrees))
    scene, readings = scan(lambda u, v: slope * (u - v), nv=8, outlined=False, noise_m=1e-6)
    surface = mapped("gaussian_process", scene, readings)
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    assert surface.mask.all()
    np.testing.assert_allclose(surface.height_m, slope * (u - v), atol=2e-5)


def test_sigma_of_a_facing_plate_covers_its_error(scan, mapped):
    inside = []
    for seed in range(6):
        scene, readings = scan(lambda u, v: 0.0 * u, nu=14, nv=12, outlined=False, noise_m=1e-3, seed=seed)
        surface = mapped("gaussian_process", scene, readings)
        inside.append(np.mean(np.abs(surface.height_m) < 1.645 * surface.sigma_m))
        assert np.sqrt(np.mean(surface.height_m**2)) < 0.4e-3
    assert 0.75 < np.mean(inside) <= 1.0


def test_given_constants_are_used(scan, mapped):
    scene, readings = scan(lambda u, v: 0.02 * np.sin(40 * u), nv=8, outlined=False)
    stiff = mapped("gaussian_process", scene, readings, length_m=1.0, signal_m=1e-6, noise_factor=1.0)
    free = mapped("gaussian_process", scene, readings)
    truth = 0.02 * np.sin(40 * free.grid.u_m)
    assert np.abs(free.height_m - truth).max() < 0.3 * np.abs(stiff.height_m - truth).max()
