"""The piecewise-smooth prior: plain twin, null space, precision by finite differences, band solver."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.beam_model.prior.band_matrix import colour, factor, log_determinant, solve
from surfuse.beam_model.prior.smoothness import STENCILS, THIRD_ORDER, Plate, Stiffness, plate

G = 0.01
SOFT = Stiffness(1e-2, 1e1, 1e9)


def shape_with_a_hole() -> np.ndarray:
    domain = np.ones((9, 7), dtype=bool)
    domain[3:5, 2:4] = False
    return domain


def plain_energy(p: Plate, height: np.ndarray, stiffness: Stiffness) -> float:
    """The sum over all differences, one by one."""
    total = 0.0
    for k, (points, share) in enumerate(STENCILS):
        density = G ** (-4) / stiffness.third if k < THIRD_ORDER else G ** (-2) / stiffness.second
        for j in range(height.shape[0]):
            for i in range(height.shape[1]):
                cells = [(j + dj, i + di) for dj, di, _ in points]
                if all(0 <= a < height.shape[0] and 0 <= b < height.shape[1] and p.domain[a, b] for a, b in cells):
                    bend = sum(c * height[a, b] for (_, _, c), (a, b) in zip(points, cells, strict=True))
                    x = 0.5 * share * density * bend**2
                    total += stiffness.edge * x / (stiffness.edge + x)
    return total


@pytest.mark.parametrize("edge", [0.5, 1e9])
def test_energy_against_the_plain_twin(edge: float) -> None:
    p = plate(shape_with_a_hole(), G)
    height = np.random.default_rng(1).normal(size=p.domain.shape) * 1e-3
    stiffness = Stiffness(1e-2, 1e1, edge)
    np.testing.assert_allclose(p.energy(height, stiffness), plain_energy(p, height, stiffness), rtol=1e-10)


def test_planes_are_free_and_quadrics_cost_only_curvature() -> None:
    p = plate(np.ones((10, 12), dtype=bool), G)
    j, i = np.indices(p.domain.shape)
    assert p.energy(0.3 * i * G - 0.2 * j * G + 0.1, SOFT) < 1e-15
    bowl = 0.5 * 4.0 * (i * G) ** 2
    assert p.energy(bowl, Stiffness(1e9, 1e-6, 1e9)) < 1e-6
    assert p.energy(bowl, SOFT) > 0.1


def test_an_edge_costs_a_bounded_price_whatever_its_height() -> None:
    p = plate(np.ones((10, 12), dtype=bool), G)
    step = np.zeros(p.domain.shape)
    step[:, 6:] = 1.0
    stiffness = Stiffness(1e-2, 1e1, 0.5)
    assert p.energy(0.05 * step, stiffness) == pytest.approx(p.energy(0.2 * step, stiffness), rel=0.02)


def test_precision_is_the_second_derivative_of_the_energy() -> None:
    p = plate(shape_with_a_hole(), G)
    band = p.precision(np.zeros(p.domain.shape), SOFT, 1e-3)
    dense = np.zeros((p.size, p.size))
    for k in range(band.shape[1]):
        for n in range(p.size - k):
            dense[n + k, n] = dense[n, n + k] = band[n, k]
    x = np.random.default_rng(2).normal(size=p.size) * 1e-3
    energy = p.energy(p.field(x), SOFT)
    np.testing.assert_allclose(0.5 * x @ dense @ x - 0.5e-3 * x @ x, energy, rtol=1e-6)


def test_band_solver_against_numpy() -> None:
    p = plate(shape_with_a_hole(), G)
    band = p.precision(np.zeros(p.domain.shape), SOFT, 1.0)
    dense = np.zeros((p.size, p.size))
    for k in range(band.shape[1]):
        for n in range(p.size - k):
            dense[n + k, n] = dense[n, n + k] = band[n, k]
    right = np.random.default_rng(4).normal(size=p.size)
    lower = factor(band)
    np.testing.assert_allclose(solve(lower, right), np.linalg.solve(dense, right), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(log_determinant(lower), np.linalg.slogdet(dense)[1], rtol=1e-9)


def test_vector_and_field_are_inverse() -> None:
    p = plate(shape_with_a_hole(), G)
    values = np.arange(p.size, dtype=np.float64)
    np.testing.assert_array_equal(p.vector(p.field(values)), values)


def test_samples_have_the_inverse_as_covariance() -> None:
    p = plate(np.ones((4, 3), dtype=bool), G)
    band = p.precision(np.zeros(p.domain.shape), SOFT, 1.0)
    half = colour(factor(band), np.eye(p.size))
    dense = np.zeros((p.size, p.size))
    for k in range(band.shape[1]):
        for n in range(p.size - k):
            dense[n + k, n] = dense[n, n + k] = band[n, k]
    np.testing.assert_allclose(half @ half.T, np.linalg.inv(dense), rtol=1e-6, atol=1e-9)
