from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfuse.confidence.agreement import agreement_confidence, median_of_others, median_of_sorted, updated_error_rate
from surfuse.confidence.boundary import boundary_confidence, boundary_scale
from surfuse.confidence.prediction import predicted_depth, prediction_confidence, remember
from surfuse.fusing.uncertainty import sigma_of_average
from surfuse.geometry.poses import pose, rotation_about

lengths = st.floats(-1.0, 1.0)


def grips(origins: np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    turn = rotation_about([1, 0, 0], np.pi) if rotation is None else rotation
    return np.array([pose(turn, origin) for origin in origins])


def window_of(poses: np.ndarray, depths: list[float]) -> tuple[np.ndarray, int]:
    window, held = np.zeros((3, 3)), 0
    for j, depth in enumerate(depths):
        held = remember(window, held, poses, j, depth)
    return window, held


@pytest.mark.parametrize("n", [2, 3, 5])
def test_prediction_is_the_least_squares_line_of_the_last_three_against_position(n: int) -> None:
    rng = np.random.default_rng(n)
    x = np.cumsum(rng.uniform(0.005, 0.03, n + 1))
    depths = rng.normal(0.43, 0.01, n)
    poses = grips(np.column_stack([x, 0 * x + 2.0, 0 * x + 5.0]))
    window, held = window_of(poses, depths.tolist())
    used = min(n, 3)
    assert held == used
    expected = np.polyval(np.polyfit(x[n - used : n], depths[n - used : n], 1), x[n])
    assert predicted_depth(window, held, poses, n) == pytest.approx(expected, rel=1e-10)


def test_prediction_along_any_direction_from_any_pose() -> None:
    rng = np.random.default_rng(3)
    turn = rotation_about([0.2, 1.0, -0.4], 1.1)
    travel = turn @ [0.6, 0.8, 0.0]
    x = np.array([0.0, 0.01, 0.025, 0.04])
    depths = rng.normal(0.43, 0.01, 3)
    poses = grips(np.array([3.0, -1.0, 2.0]) + x[:, None] * travel, turn)
    window, held = window_of(poses, depths.tolist())
    expected = np.polyval(np.polyfit(x[:3], depths, 1), x[3])
    assert predicted_depth(window, held, poses, 3) == pytest.approx(expected, rel=1e-10)


def test_prediction_needs_two_points_and_survives_standing_still() -> None:
    poses = grips(np.zeros((4, 3)))
    window, held = window_of(poses, [0.43])
    assert math.isnan(predicted_depth(window, 0, poses, 1))
    assert math.isnan(predicted_depth(window, held, poses, 1))
    window, held = window_of(poses, [0.42, 0.43, 0.47])
    assert predicted_depth(window, held, poses, 3) == pytest.approx(0.44)


def test_prediction_ignores_pose_noise_of_a_standing_arm() -> None:
    poses = grips(np.random.default_rng(0).normal(0.0, 1e-8, (4, 3)))
    window, held = window_of(poses, [0.42, 0.43, 0.47])
    assert predicted_depth(window, held, poses, 3) == pytest.approx(0.44, abs=1e-4)


@given(st.lists(lengths, min_size=2, max_size=9))
def test_median_of_the_others_equals_numpys(values: list[float]) -> None:
    ordered, n = np.sort(values), len(values)
    low, high = (n - 2) // 2, (n - 1) // 2
    middle = (ordered[low], ordered[low + 1], ordered[high], ordered[min(high + 1, n - 1)])
    for k, value in enumerate(values):
        assert median_of_others(value, *middle) == np.median(values[:k] + values[k + 1 :])
    assert median_of_sorted(ordered, n) == np.median(values)


@given(lengths, st.floats(1e-4, 1.0))
@settings(deadline=None)
def test_factors_lie_in_0_to_1_and_fall_with_the_deviation(deviation: float, scale: float) -> None:
    for factor in (prediction_confidence(deviation, scale), agreement_confidence(deviation, scale, 0.25)):
        assert 0.0 <= factor <= 1.0
    assert prediction_confidence(deviation, scale) == prediction_confidence(-deviation, scale)
    assert prediction_confidence(2 * deviation, scale) <= prediction_confidence(deviation, scale)
    assert agreement_confidence(2 * deviation, scale, 0.25) <= agreement_confidence(deviation, scale, 0.25)
    assert 0.0 <= boundary_confidence(deviation, scale) <= 1.0
    total = boundary_confidence(deviation, scale) + boundary_confidence(-deviation, scale)
    assert total == pytest.approx(1.0)


def test_values_of_the_factors() -> None:
    assert prediction_confidence(0.0, 0.01) == 1.0
    assert prediction_confidence(0.01, 0.01) == pytest.approx(math.exp(-0.5))
    assert agreement_confidence(0.024, 0.025, 0.1) == pytest.approx(0.9)
    assert agreement_confidence(-0.05, 0.025, 0.1) == pytest.approx(0.9 * math.exp(-0.5))
    assert boundary_confidence(0.0, 0.01) == 0.5
    assert boundary_confidence(math.inf, 0.01) == 1.0
    assert boundary_confidence(-50.0, 0.01) == 0.0
    assert boundary_scale(0.04, 0.25, 0.002) == 0.01
    assert boundary_scale(0.0, 0.25, 0.002) == 0.002


def test_error_rate_forgets_exponentially() -> None:
    rate = 0.0
    for _ in range(2000):
        rate = updated_error_rate(rate, True, 20.0)
    assert rate == pytest.approx(1.0)
    assert rate <= 1.0
    for _ in range(20):
        rate = updated_error_rate(rate, False, 20.0)
    assert rate == pytest.approx(0.95**20)


def test_sigma_of_an_average() -> None:
    one, sigma = np.ones(4), np.full(4, 0.002)
    value = np.array([1.0, 2.0, 4.0, 5.0])
    assert sigma_of_average(one, np.full(4, 3.0), sigma, 0, 0, 4, 3.0) == pytest.approx(0.001)
    expected = np.std(value, ddof=1) / 2.0
    assert sigma_of_average(one, value, sigma, 0, 0, 4, 3.0) == pytest.approx(expected)
    # Scale of the weights does not matter, weights 0 take no part, the offset of the block is respected.
    weight = np.array([9.0, 1e-250, 1e-250, 0.0])
    value, sigma = np.array([1.0, 1.0, np.nan]), np.array([0.002, 0.002, np.nan])
    assert sigma_of_average(weight, value, sigma, 1, 1, 4, 1.0) == pytest.approx(0.002 / math.sqrt(2))
    # A single reading has no scatter.
    assert sigma_of_average(one, value, sigma, 0, 0, 1, 7.0) == 0.002
