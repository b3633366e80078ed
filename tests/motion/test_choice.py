import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.errors import DataError
from surfuse.motion.choice import follow, nearest_configuration, nearest_turn

LOWER, UPPER = np.radians([-160.0, -266.0]), np.radians([160.0, 266.0])


def plain_turn(angle: float, current: float, lower: float, upper: float) -> float:
    inside = [c for c in angle + 2.0 * np.pi * np.arange(-5, 6) if lower - 1e-9 <= c <= upper + 1e-9]
    return min(inside, key=lambda c: abs(c - current), default=np.nan)


def test_nearest_turn_is_that_of_trying_all_turns() -> None:
    rng = np.random.default_rng(0)
    for angle, current in np.radians(rng.uniform(-700.0, 700.0, (300, 2))):
        for lower, upper in zip(LOWER, UPPER, strict=True):
            expected = plain_turn(angle, current, lower, upper)
            assert_allclose(nearest_turn(angle, current, lower, upper), expected, atol=1e-12)
            assert_allclose(nearest_turn.py_func(angle, current, lower, upper), expected, atol=1e-12)


def test_nearest_prefers_the_small_move_over_the_principal_angle() -> None:
    solutions = np.radians([[[10.0, -100.0], [60.0, 240.0]]])
    joints, index = nearest_configuration(solutions, np.array([[True, True]]), np.radians([10.0, 250.0]), LOWER, UPPER)
    assert index.tolist() == [0]
    assert_allclose(np.degrees(joints), [[10.0, 260.0]])


def test_weights_decide_what_near_means() -> None:
    solutions = np.radians([[[0.0, 50.0], [40.0, 0.0]]])
    valid = np.array([[True, True]])
    assert nearest_configuration(solutions, valid, np.zeros(2), LOWER, UPPER)[1].tolist() == [1]
    assert nearest_configuration(solutions, valid, np.zeros(2), LOWER, UPPER, [1.0, 0.1])[1].tolist() == [0]


def test_invalid_solutions_are_never_chosen() -> None:
    solutions = np.radians([[[0.0, 0.0], [90.0, 90.0]]])
    assert nearest_configuration(solutions, np.array([[False, True]]), np.zeros(2), LOWER, UPPER)[1].tolist() == [1]
    with pytest.raises(DataError):
        nearest_configuration(solutions, np.array([[True, True]]), np.array([np.nan, 0.0]), LOWER, UPPER)


def test_follow_unwraps_and_passes_over_gaps() -> None:
    truth = np.column_stack([np.zeros(60), np.radians(np.linspace(-200.0, 260.0, 60))])
    wrapped = np.angle(np.exp(1j * truth))
    wrapped[30] = np.nan
    path = follow(wrapped, truth[0], LOWER, UPPER)
    assert np.isnan(path[30]).all()
    keep = np.arange(60) != 30
    assert_allclose(path[keep], truth[keep], atol=1e-12)
