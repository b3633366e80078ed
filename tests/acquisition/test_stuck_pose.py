"""An arm that tells old poses, or one pose for ever, or whose clock stands still."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.recording import RecordingHooks, record
from surfuse.acquisition.stop_arm import JointStopArm
from surfuse.acquisition.tool_track import STANDS_S, ToolTrack
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.records import Echo, Fixture, JointState, SensorSpec, Status, ToolState

SPEC = SensorSpec("us0", "laser", 0.05, 5.0, 0.02, 0.001)
SPEED_M_S, SLOPE = 0.1, 0.5


class Rail:
    """Along x at a steady speed; it looks at itself every `looks_s`, and is asked every 10 ms."""

    def __init__(self, looks_s=0.0, stuck_s=np.inf, frozen=False, clock_off_s=0.0):
        self.kinematics, self.looks_s, self.stuck_s, self.frozen = self, looks_s, stuck_s, frozen
        self.t_s, self.anew_s = 0.0, 0.0

    def joint_state(self):
        self.t_s += 0.01
        seen_s = min(self.t_s, self.stuck_s)
        if self.looks_s:
            seen_s = self.looks_s * np.floor(seen_s / self.looks_s)
        return JointState(np.array([SPEED_M_S * seen_s]), 0.0 if self.frozen else self.t_s - self.anew_s)

    @staticmethod
    def forward(joints_rad):
        return pose(np.diag([1.0, -1.0, -1.0]), (float(joints_rad[0]), 0.0, 0.5))


class Ranger:
    """Straight down onto a slope; `tilt_rad` turns its beam towards the motion."""

    def __init__(self, rail, steady=False, scatter_m=0.0, tilt_rad=0.0):
        grip_from_sensor = np.eye(4)
        c, s = np.cos(tilt_rad), np.sin(tilt_rad)
        grip_from_sensor[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
        self.fixture = Fixture(grip_from_sensor[np.newaxis], (SPEC,))
        self.rail, self.steady, self.scatter_m = rail, steady, scatter_m
        self.rng = np.random.default_rng(3)

    def sweep(self):
        self.rail.t_s += 0.01
        moved_m = 0.0 if self.steady else SLOPE * SPEED_M_S * self.rail.t_s
        range_m = 0.5 + moved_m + self.scatter_m * self.rng.standard_normal()
        return (Echo(range_m, Status.OK, self.rail.t_s - self.rail.anew_s),)


def recorded(rail, ranger, cycles=200, stamps_off_s=None, at=None):
    kept, left_out, left = [], [], [cycles]

    def over():
        left[0] -= 1
        if at is not None:
            at(cycles - left[0])
        return left[0] < 0

    hooks = RecordingHooks(kept.append, left_out.append, over)
    record(JointStopArm(rail), ranger, (0.0,), hooks, stamps_off_s)
    return kept, left_out


@pytest.mark.parametrize("looks_s", [0.05, 0.125])
def test_an_arm_that_is_asked_more_often_than_it_looks_is_where_it_really_was(looks_s):
    kept, left_out = recorded(rail := Rail(looks_s), Ranger(rail))
    assert len(kept) > 180
    assert np.nanmax([0.0, *left_out]) == 0.0  # only those at its beginning and end
    for sweep in kept:
        off_m = abs(sweep.position_m[0, 0] - SPEED_M_S * sweep.t_s[0])
        assert off_m <= sweep.sigma_m[0]
        assert off_m < 0.5 * SPEED_M_S * looks_s
        assert sweep.sigma_m[0] < 4e-3


def test_a_pose_repeated_for_long_is_that_of_an_arm_that_stands():
    track = ToolTrack()
    for k in range(101):
        track.add(ToolState(0.01 * k, pose(np.eye(3), (0.1, 0.2, 0.3))))
    assert track.since_s == 0.0
    assert track.until_s == 1.0
    assert track.unchanged_s == 1.0
    found = track.at([0.3, 0.97], [0.4, 0.4])
    assert_allclose(found.off_m, 0.0)
    assert_allclose(found.velocity_m_s, 0.0)


def test_a_pose_repeated_for_a_moment_says_nothing():
    track = ToolTrack()
    for t_s, x in ((0.0, 0.0), (0.1, 0.01), (0.2, 0.01), (0.25, 0.01), (0.3, 0.03)):
        assert t_s < STANDS_S
        track.add(ToolState(t_s, pose(np.eye(3), (x, 0.0, 0.0))))
    place = track.at([0.2], [0.0])
    assert_allclose(place.world_from_grip[0, 0, 3], 0.02)
    # The new pose may have been reached at any time since the last repetition, 50 ms before: half of that weighs here.
    assert place.off_m[0] >= 0.5 * 0.05 * 0.1


def test_an_arm_stuck_while_its_sensors_see_motion_stops_the_recording():
    with pytest.raises(SafetyStopError, match=r"one pose for [23]\.\d s while the range of 'us0' changes by \d+ mm"):
        recorded(rail := Rail(stuck_s=1.0), Ranger(rail), cycles=1000)


@pytest.mark.parametrize("scatter_m", [0.0, 0.001, 0.1])
def test_an_arm_that_stands_before_noise_does_not(scatter_m):
    kept, _ = recorded(rail := Rail(stuck_s=0.0), Ranger(rail, steady=True, scatter_m=scatter_m), cycles=1000)
    assert len(kept) > 900


def test_a_clock_that_stands_still_stops_the_recording():
    with pytest.raises(SafetyStopError, match=r"stands still: t_s = 0\.000000 in 101 states .* at most 100"):
        recorded(rail := Rail(frozen=True), Ranger(rail), cycles=1000)


def test_a_clock_that_begins_anew_costs_the_sweeps_that_wait():
    rail = Rail()

    def restarted(cycle):
        if cycle == 100:
            rail.anew_s = rail.t_s

    kept, left_out = recorded(rail, Ranger(rail), at=restarted)
    assert len(kept) + len(left_out) == 200
    assert len(kept) >= 195


@pytest.mark.parametrize("tilt_rad", [0.0, 0.5])
def test_a_clock_that_is_not_known_well_makes_readings_less_sure_by_the_speed_along_the_beam(tilt_rad):
    exact, _ = recorded(rail := Rail(), Ranger(rail, tilt_rad=tilt_rad))
    unsure, _ = recorded(rail := Rail(), Ranger(rail, tilt_rad=tilt_rad), stamps_off_s=lambda: (0.05,))
    along_m = 0.05 * SPEED_M_S * np.sin(tilt_rad)
    for one, other in zip(exact, unsure, strict=True):
        known = SPEC.sigma_m if np.isnan(one.sigma_m[0]) else one.sigma_m[0]
        found = SPEC.sigma_m if np.isnan(other.sigma_m[0]) else other.sigma_m[0]
        assert_allclose(found, np.hypot(known, along_m), rtol=1e-6)


@pytest.mark.parametrize("off_s", [0.2, np.inf])
def test_a_clock_that_moves_the_place_too_far_leaves_readings_out(off_s):
    kept, left_out = recorded(rail := Rail(), Ranger(rail), stamps_off_s=lambda: (off_s,))
    assert kept == []
    assert np.nanmax(left_out) >= 0.2 * SPEED_M_S - 1e-9
    kept, _ = recorded(rail := Rail(stuck_s=0.0), Ranger(rail, steady=True), stamps_off_s=lambda: (off_s,))
    assert len(kept) > 100  # of an arm that stands, the time does not matter
