from __future__ import annotations

import numpy as np
import pytest

from surfuse.surface.beam_average import averaged_ranges
from surfuse.surface.casting import RayCaster

PLATE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])
DOWN = np.array([[0.0, 0.0, -1.0]])


def test_a_narrow_beam_reads_its_axis() -> None:
    tilted = np.array([[np.sin(0.5), 0.0, -np.cos(0.5)]])
    mean, share = averaged_ranges(RayCaster(PLATE, TWO), np.array([[0.0, 0.0, 0.4]]), tilted, np.array([1e-6]))
    assert mean == pytest.approx(0.4 / np.cos(0.5), rel=1e-6)
    assert share == 1.0


def test_the_mean_over_a_cone_is_the_integral() -> None:
    """Facing: range h / cos(a), weight cos(a)^3 / h^2 a solid angle; the integral over the cone, done finely."""
    half, height = 0.3, 0.4
    mean, _ = averaged_ranges(RayCaster(PLATE, TWO), np.array([[0.0, 0.0, height]]), DOWN, np.array([half]))
    angle = np.linspace(0.0, half, 20001)
    weight = np.cos(angle) ** 3 * np.sin(angle)
    expected = np.sum(weight * height / np.cos(angle)) / np.sum(weight)
    assert mean == pytest.approx(expected, rel=1e-3)


def test_beside_the_plate_only_what_is_met_counts() -> None:
    caster = RayCaster(PLATE, TWO)
    mean, share = averaged_ranges(
        caster, np.array([[1.0, 0.0, 0.4], [5.0, 0.0, 0.4]]), np.repeat(DOWN, 2, 0), np.full(2, 0.1)
    )
    assert share[0] == pytest.approx(0.5, abs=0.1)
    assert mean[0] == pytest.approx(0.4, rel=0.01)
    assert share[1] == 0.0
    assert np.isinf(mean[1])
