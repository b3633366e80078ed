import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from surfuse.motion.limits import JointLimits
from surfuse.motion.trapezoid import TrapezoidalMove, durations_s

LIMITS = JointLimits(
    lower_rad=np.full(3, -10.0),
    upper_rad=np.full(3, 10.0),
    velocity_rad_s=np.array([1.0, 2.0, 0.5]),
    acceleration_rad_s2=np.array([2.0, 1.0, 4.0]),
)
JOINTS = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)


def test_closed_form_of_one_joint() -> None:
    # Long: 1 rad/s after 0.5 s; 3 rad take 3 / 1 + 1 / 2 s. Short: triangle of 2 sqrt(d / a).
    assert durations_s(np.zeros(3), np.array([3.0, 0.0, 0.0]), LIMITS) == pytest.approx(3.5)
    assert durations_s(np.zeros(3), np.array([0.02, 0.0, 0.0]), LIMITS) == pytest.approx(2.0 * np.sqrt(0.02 / 2.0))
    assert durations_s(np.ones(3), np.ones(3), LIMITS) == 0.0


def test_durations_are_vectorised_and_symmetric() -> None:
    rng = np.random.default_rng(0)
    start, end = rng.uniform(-2.0, 2.0, (2, 50, 3))
    together = durations_s(start, end, LIMITS)
    assert_allclose(together, [durations_s(a, b, LIMITS) for a, b in zip(start, end, strict=True)])
    assert_allclose(together, durations_s(end, start, LIMITS))


@settings(max_examples=60, deadline=None)
@given(JOINTS, JOINTS)
def test_moves_reach_their_end_within_the_limits(start: np.ndarray, end: np.ndarray) -> None:
    move = TrapezoidalMove(start, end, LIMITS)
    t = np.linspace(0.0, move.duration_s, 2001)
    position, speed, push = move.sample(t)
    assert_allclose(position[[0, -1]], [start, end], atol=1e-9)
    assert_allclose(speed[[0, -1]], 0.0, atol=1e-9)
    assert np.all(np.abs(speed) <= LIMITS.velocity_rad_s + 1e-9)
    assert np.all(np.abs(push) <= LIMITS.acceleration_rad_s2 + 1e-9)
    if move.duration_s > 0.0:
        step = t[1] - t[0]
        assert_allclose(np.diff(position, axis=0), 0.5 * step * (speed[1:] + speed[:-1]), atol=8.0 * step**2)


def test_joints_move_in_proportion() -> None:
    position, _, _ = TrapezoidalMove(np.zeros(3), np.array([1.0, -2.0, 0.5]), LIMITS).sample(np.linspace(0.0, 9.0, 40))
    assert_allclose(position[:, 1], -2.0 * position[:, 0], atol=1e-12)
    assert_allclose(position[-1], [1.0, -2.0, 0.5])


def test_one_limit_is_used_to_the_full() -> None:
    move = TrapezoidalMove(np.zeros(3), np.array([3.0, 1.0, 1.0]), LIMITS)
    _, speed, _ = move.sample(np.linspace(0.0, move.duration_s, 4001))
    assert np.max(np.abs(speed) / LIMITS.velocity_rad_s) == pytest.approx(1.0)


def test_before_and_after_a_move_the_arm_rests_at_its_ends() -> None:
    start, end = np.array([0.1, -0.2, 0.3]), np.array([2.0, 1.0, 0.5])
    move = TrapezoidalMove(start, end, LIMITS)
    position, speed, push = move.sample([-1.0, -1e-9, move.duration_s + 1e-9, move.duration_s + 1.0])
    assert_allclose(position, [start, start, end, end])
    assert not np.any(speed)
    assert not np.any(push)
    # Within it, the acceleration is that of the speed, and is there from the first moment to the last.
    assert np.all(move.sample([0.0])[2] * (end - start) > 0.0)
    assert np.all(move.sample([move.duration_s])[2] * (end - start) < 0.0)
