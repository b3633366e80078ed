"""Motions are refused before they start: limits, speeds, singularities, own links, and what stands around."""

import numpy as np
import pytest

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.errors import ConfigError, DataError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.guard import GuardParameters, MotionGuard
from surfuse.motion.obstacles import Box, Obstacle
from surfuse.motion.own_links import own_links
from surfuse.motion.planners import Stretched, tool_speed, trapezoidal, within_tool_speed
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import Fixture, FloatArray, SensorSpec

SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
SENSORS = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
RODS = (*volume.CAPSULES, *fixture_capsules(SENSORS, volume.TOOL_LINK))
TURN = np.radians([90.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def clearance(obstacles: tuple[Obstacle, ...]) -> ClearanceModel:
    own = own_links(RODS, volume.OWN_PAIRS)
    return ClearanceModel(ARM.link_poses, body_of(RODS), (volume.column(STAND_HEIGHT_M), *obstacles), own)


def guard(**how: float) -> MotionGuard:
    return MotionGuard(ARM, LIMITS, clearance, (), GuardParameters(**how))


def move(change: FloatArray, start: FloatArray = READY_RAD) -> TrapezoidalMove:
    return TrapezoidalMove(start, start + change, LIMITS)


def test_usual_moves_pass() -> None:
    guard()(READY_RAD, READY_RAD + TURN)
    guard().check(move(TURN))


def test_a_joint_beyond_its_limit_is_named_with_value_and_limit() -> None:
    beyond = READY_RAD + np.radians([0.0, 0.0, -12.0, 0.0, 0.0, 0.0])
    words = r"target of joint 3 is -22\d\.\d+ deg, its limits are -225\.0 to 45\.0 deg"
    with pytest.raises(SafetyStopError, match=words):
        guard()(READY_RAD, beyond)
    with pytest.raises(SafetyStopError, match=words):
        guard().check(move(beyond - READY_RAD))


def test_nan_set_points_are_refused() -> None:
    with pytest.raises(SafetyStopError, match="target of joint 2 is nan"):
        guard()(READY_RAD, np.where(np.arange(6) == 1, np.nan, READY_RAD))
    with pytest.raises(DataError, match="end_rad"):
        move(np.full(6, np.nan))
    with pytest.raises(SafetyStopError, match="takes nan s"):
        guard().check(Stretched(move(TURN), np.nan))


def test_a_joint_that_would_be_too_fast_is_named() -> None:
    fast = Stretched(move(TURN), 0.5)
    with pytest.raises(SafetyStopError, match=r"joint 1 would turn at 12\d\.\d deg/s, its limit is 100\.0 deg/s"):
        guard(tool_speed_max_m_s=5.0).check(fast)


def test_the_speed_of_the_tool_is_limited() -> None:
    with pytest.raises(SafetyStopError, match=r"the tool would move at 0\.\d\d m/s, its limit is 0\.30 m/s"):
        guard(tool_speed_max_m_s=0.3).check(move(TURN))


def test_a_path_near_a_singularity_is_refused_by_name() -> None:
    straight = READY_RAD + np.radians([0.0, 0.0, 0.0, 0.0, -50.0, 0.0])
    with pytest.raises(SafetyStopError, match=r"within 0\.0\d+ of the wrist singularity at .*at least 0\.05"):
        guard().check(TrapezoidalMove(READY_RAD, straight, LIMITS))
    # The same turn of one joint is harmless as a move in joint space.
    guard()(READY_RAD, straight)


def test_own_links_stop_a_motion_on_its_way() -> None:
    # Both ends are clear; on the way joint 5 brings the tubes to the forearm.
    start = READY_RAD + np.radians([0.0, 0.0, 0.0, -90.0, 0.0, 0.0])
    end = start + np.radians([0.0, 0.0, 0.0, 0.0, 55.0, 0.0])
    with pytest.raises(SafetyStopError, match=r"sensor tube would be -?\d+ mm (from|inside) the arm's own forearm"):
        guard(clearance_min_m=0.01)(start, end)


def test_a_part_counts_from_the_moment_it_is_known() -> None:
    ahead = ARM.forward(READY_RAD + 0.5 * TURN)[:3, 3]
    block = Box((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05), pose(np.eye(3), ahead), name="the part")
    watched = guard()
    watched(READY_RAD, READY_RAD + TURN)
    watched.surround((block,))
    with pytest.raises(SafetyStopError, match="the part"):
        watched(READY_RAD, READY_RAD + TURN)
    with pytest.raises(SafetyStopError, match=r"the part, \d\.\d\d s into a motion of 2\.\d\d s; at least 5 mm"):
        watched.check(move(TURN))
    with pytest.raises(SafetyStopError, match="the part"):
        watched.checked(lambda points: (move(TURN), np.zeros(len(points))))(np.zeros((2, 6)))


def test_a_planner_slows_what_would_be_too_fast() -> None:
    slow = within_tool_speed(trapezoidal(LIMITS), ARM, 0.3)(READY_RAD, READY_RAD + TURN)
    t = np.linspace(0.0, slow.duration_s, 2001)
    q, qd, qdd = slow.sample(t)
    assert 0.28 < tool_speed(ARM, t, q) <= 0.3
    assert np.allclose(np.gradient(q, t, axis=0)[1:-1], qd[1:-1], atol=2e-3)
    assert np.abs(qdd).max() < LIMITS.acceleration_rad_s2[0]
    assert isinstance(within_tool_speed(trapezoidal(LIMITS), ARM, 5.0)(READY_RAD, READY_RAD + TURN), TrapezoidalMove)


@pytest.mark.parametrize(
    "change",
    [{"clearance_min_m": np.nan}, {"tool_speed_max_m_s": 0.0}, {"singularity_min": 1.0}, {"resolution_rad": np.inf}],
)
def test_hostile_parameters_are_refused(change: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        GuardParameters(**change)
