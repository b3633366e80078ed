"""Joint samples of a motion: straight lines between them, and nothing made up outside of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.errors import DataError
from surfuse.records import JointSamples

SAMPLES = JointSamples(np.array([1.0, 1.5, 3.0]), np.array([[0.0, 1.0], [1.0, 1.0], [4.0, -2.0]]))


def test_between_two_samples_joints_lie_on_a_straight_line() -> None:
    assert_allclose(SAMPLES.at(np.array([1.0, 1.25, 2.0, 3.0])), [[0.0, 1.0], [0.5, 1.0], [2.0, 0.0], [4.0, -2.0]])


@pytest.mark.parametrize("t_s", [0.999, 3.001, np.nan])
def test_outside_the_samples_nobody_knows(t_s: float) -> None:
    with pytest.raises(DataError, match="until the last reading"):
        SAMPLES.at(np.array([2.0, t_s]))


@pytest.mark.parametrize("t_s", [[1.0, 1.0], [2.0, 1.0], [0.0, np.nan]])
def test_times_must_go_forward(t_s: list[float]) -> None:
    with pytest.raises(DataError, match=r"JointSamples\.t_s .* numbers"):
        JointSamples(np.array(t_s), np.zeros((2, 6)))
