"""Angles are shifted by whole turns into limits, and a solution is inside only between both of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560_closed_form import into_limits

TURN = 2.0 * np.pi


@pytest.mark.parametrize(("lower", "upper"), [(-1.0, 2.0), (-2.0, 1.0), (1.0, 5.0), (-5.0, -1.0), (-4.0, 4.0)])
def test_an_angle_is_inside_exactly_when_some_turn_of_it_is(lower: float, upper: float) -> None:
    asked = np.random.default_rng(0).uniform(-np.pi, np.pi, (500, 8, 1))
    joints = asked.copy()
    inside = into_limits(joints, np.array([lower]), np.array([upper]))
    turns = asked + TURN * np.array([-1.0, 0.0, 1.0])
    np.testing.assert_array_equal(inside, np.any((turns >= lower) & (turns <= upper), axis=2))
    assert np.all((joints[inside] >= lower) & (joints[inside] <= upper))
    assert_allclose(np.exp(1j * joints), np.exp(1j * asked), atol=1e-12)
    stays = (asked >= lower) & (asked <= upper)
    np.testing.assert_array_equal(joints[stays], asked[stays])
    np.testing.assert_array_equal(joints[~inside], asked[~inside])


def test_one_joint_outside_or_unknown_is_enough() -> None:
    joints = np.array([[[0.0, 0.0], [0.0, 1.5], [-1.5, 0.0], [0.0, np.nan]]])
    assert into_limits(joints, np.full(2, -1.0), np.full(2, 1.0)).tolist() == [[True, False, False, False]]
