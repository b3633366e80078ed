"""A recording asks and places; it moves nothing. With arms that say joints, and sensors that stamp late or early."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.recording import OFF_LIMIT_M, RecordingHooks, record
from surfuse.acquisition.stop_arm import JointStopArm
from surfuse.geometry.poses import pose
from surfuse.records import Echo, Fixture, JointState, SensorSpec, Status

SPEC = SensorSpec("us0", "laser", 0.05, 1.2, 0.02, 0.001)
STEP_S = 0.02


class Rail:
    """An arm of one joint along x, at 1 rad and 1 m a second until it is pushed to and fro; it can only be asked."""

    def __init__(self, jerky_m=0.0):
        self.t_s, self.kinematics, self.jerky_m = 0.0, self, jerky_m

    def joint_state(self):
        self.t_s += STEP_S
        push = self.jerky_m * (-1.0) ** round(self.t_s / (2.0 * STEP_S))
        return JointState(np.array([self.t_s + push]), self.t_s)

    @staticmethod
    def forward(joints_rad):
        return pose(np.eye(3), (float(joints_rad[0]), 0.0, 0.5))


class Ranger:
    """One sensor on the grip; it stamps `late_s` before the moment at which it measures `x`."""

    fixture = Fixture(np.eye(4)[np.newaxis], (SPEC,))

    def __init__(self, rail, late_s=0.0, status=Status.OK):
        self.rail, self.late_s, self.status = rail, late_s, status

    def sweep(self):
        self.rail.t_s += STEP_S
        x = 0.4 + 0.1 * (self.rail.t_s - self.rail.t_s // 1.0)
        range_m = x if self.status is Status.OK else np.inf
        return (Echo(range_m, self.status, self.rail.t_s - self.late_s),)


def recorded(rail, ranger, lag_s=0.0, cycles=30):
    kept, left_out, left = [], [], [cycles]

    def over():
        left[0] -= 1
        return left[0] < 0

    record(JointStopArm(rail), ranger, (lag_s,), RecordingHooks(kept.append, left_out.append, over))
    return kept, left_out


@pytest.mark.parametrize("late_s", [0.0, 0.015, 0.3, -0.25])
def test_a_reading_is_placed_where_the_arm_was_when_it_was_taken(late_s):
    kept, left_out = recorded(rail := Rail(), Ranger(rail, late_s), late_s)
    assert len(kept) + len(left_out) == 30
    assert len(kept) > 10
    assert [sweep.stop for sweep in kept] == list(range(len(kept)))
    for sweep in kept:
        assert_allclose(sweep.position_m[0, 0], sweep.t_s[0], atol=1e-12)
        assert_allclose(sweep.joints_rad, sweep.t_s, atol=1e-12)
        measured_at = sweep.t_s[0] - sweep.t_s[0] // 1.0
        assert_allclose(sweep.range_m[0], 0.4 + 0.1 * measured_at, atol=1e-9)


def test_readings_from_before_the_first_state_and_after_the_last_have_no_place():
    early, left_out = recorded(rail := Rail(), Ranger(rail), lag_s=-0.2)
    assert len(early) + len(left_out) == 30
    assert 0 < len(left_out) < 10
    assert np.isnan(left_out).all()
    late, left_out = recorded(rail := Rail(), Ranger(rail), lag_s=0.2)
    assert len(late) + len(left_out) == 30
    assert 0 < len(left_out) < 10


def test_no_echo_is_kept_as_one_and_gets_no_sigma():
    kept, _ = recorded(rail := Rail(), Ranger(rail, status=Status.NO_ECHO))
    assert {int(sweep.status[0]) for sweep in kept} == {int(Status.NO_ECHO)}
    assert np.isnan([sweep.sigma_m[0] for sweep in kept]).all()


def test_a_jerked_arm_makes_readings_less_sure_until_they_are_left_out():
    smooth, _ = recorded(rail := Rail(), Ranger(rail))
    jerky, none = recorded(rail := Rail(jerky_m=0.004), Ranger(rail))
    assert none == []
    assert max(sweep.sigma_m[0] for sweep in smooth) < 1.1e-3
    assert max(sweep.sigma_m[0] for sweep in jerky) > 3e-3
    kept, left_out = recorded(rail := Rail(jerky_m=0.1), Ranger(rail))
    assert kept == []
    assert min(left_out) > OFF_LIMIT_M
