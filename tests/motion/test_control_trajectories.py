"""Trajectories under jerk, torque and speed limits: calculus, limits, ends, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, Puma560
from surfuse.arm_models.puma560_dynamics import FIXTURE, JERK_RAD_S3, loaded_puma560
from surfuse.errors import ConfigError, DataError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.control_law import every_tick
from surfuse.motion.jerk_limited import JerkLimitedMove
from surfuse.motion.limits import JointLimits
from surfuse.motion.planners import torque_limited
from surfuse.motion.torque_limits import within_torque
from surfuse.motion.trajectory import Trajectory
from surfuse.motion.trapezoid import TrapezoidalMove, durations_s
from surfuse.records import FloatArray
from surfuse.rig.simulated.servo_arm import control_law

MODEL = loaded_puma560(FIXTURE)
KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.08 - FLANGE_OFFSET_M]))
MOVES = [
    np.radians([20.0, -10.0, 5.0, 8.0, -3.0, 30.0]),
    np.radians([0.6, 0.3, -0.4, 0.0, 0.2, -0.1]),
    np.array([1e-5, 0.0, 0.0, 0.0, 0.0, 0.0]),
    np.radians([150.0, 20.0, 60.0, -100.0, 50.0, 200.0]),
]


def samples(motion: Trajectory, count: int = 4001) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    t = np.linspace(0.0, motion.duration_s, count)
    return t, *motion.sample(t)


def consistent(motion: Trajectory) -> None:
    """Speed is the derivative of position: by the trapezoidal rule, whose error the acceleration bounds."""
    t, q, qd, qdd = samples(motion)
    step = np.diff(t)[:, None]
    allowed = float(np.abs(qdd).max()) * step[0, 0] ** 2 + 1e-12
    assert_allclose(np.diff(q, axis=0), 0.5 * step * (qd[1:] + qd[:-1]), atol=allowed)


@pytest.mark.parametrize("change", MOVES)
def test_a_jerk_limited_move_keeps_its_limits_and_ends_at_rest(change: FloatArray) -> None:
    move = JerkLimitedMove(READY_RAD, READY_RAD + change, LIMITS, JERK_RAD_S3)
    t, q, qd, qdd = samples(move)
    consistent(move)
    assert np.all(np.abs(qd) <= LIMITS.velocity_rad_s * (1.0 + 1e-9))
    assert np.all(np.abs(qdd) <= LIMITS.acceleration_rad_s2 * (1.0 + 1e-9))
    assert np.all(np.abs(np.diff(qdd, axis=0)) <= JERK_RAD_S3 * np.diff(t)[:, None] * (1.0 + 1e-6) + 1e-12)
    assert_allclose(q[0], READY_RAD)
    assert_allclose(q[-1], READY_RAD + change, atol=1e-12)
    assert_allclose(qd[[0, -1]], 0.0, atol=1e-12)
    assert move.duration_s > float(durations_s(READY_RAD, READY_RAD + change, LIMITS))


@pytest.mark.parametrize(
    ("speed", "acceleration", "jerk"),
    [(1.0, 1.0, 1.0), (0.2, 5.0, 50.0), (30.0, 5.0, 50.0), (30.0, 500.0, 50.0), (0.1, 9.0, 1.0), (2.0, 2.0, 1e6)],
)
def test_the_time_law_is_that_of_ruckig(speed: float, acceleration: float, jerk: float) -> None:
    ruckig = pytest.importorskip("ruckig")
    asked, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    asked.current_position, asked.target_position = [0.0], [1.0]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [speed], [acceleration], [jerk]
    assert ruckig.Ruckig(1).calculate(asked, found) in (ruckig.Result.Working, ruckig.Result.Finished)
    one = np.ones(1)
    move = JerkLimitedMove(0.0 * one, one, JointLimits(-one, one, speed * one, acceleration * one), jerk * one)
    assert move.duration_s == pytest.approx(found.duration, rel=1e-9)
    times = np.linspace(0.0, found.duration, 50)[:-1]
    own = np.hstack(move.sample(times))
    assert_allclose(own, [np.ravel(found.at_time(t)) for t in times.tolist()], rtol=1e-6, atol=1e-8)


def test_before_and_after_a_move_the_arm_rests_at_its_ends() -> None:
    end = READY_RAD + MOVES[0]
    for move in (JerkLimitedMove(READY_RAD, end, LIMITS, JERK_RAD_S3), torque_limited(MODEL, LIMITS)(READY_RAD, end)):
        late = move.duration_s
        position, speed, push = move.sample([-1.0, -1e-9, late, late + 1e-9, late + 1.0])
        assert_allclose(position, [READY_RAD, READY_RAD, end, end, end])
        assert not np.any(speed)
        assert not np.any(push)


def test_large_jerk_gives_the_trapezoid() -> None:
    move = JerkLimitedMove(READY_RAD, READY_RAD + MOVES[0], LIMITS, 1e5 * JERK_RAD_S3)
    assert move.duration_s == pytest.approx(
        TrapezoidalMove(READY_RAD, READY_RAD + MOVES[0], LIMITS).duration_s, rel=1e-3
    )


def test_a_move_to_where_the_arm_is_takes_no_time() -> None:
    move = JerkLimitedMove(READY_RAD, READY_RAD, LIMITS, JERK_RAD_S3)
    assert move.duration_s == 0.0
    assert len(every_tick(move, 1e-3)) == 0
    assert_allclose(move.sample([0.0, 1.0])[0], [READY_RAD, READY_RAD])


def test_hostile_jerk_limits_and_set_points_are_refused() -> None:
    with pytest.raises(ConfigError, match="jerk limits"):
        JerkLimitedMove(READY_RAD, READY_RAD, LIMITS, np.zeros(6))
    with pytest.raises(DataError, match="end_rad"):
        JerkLimitedMove(READY_RAD, np.full(6, np.nan), LIMITS, JERK_RAD_S3)


@pytest.mark.parametrize("change", MOVES[:2])
def test_the_torque_limit_is_reached_and_kept(change: FloatArray) -> None:
    limits = within_torque(MODEL, READY_RAD, READY_RAD + change, LIMITS, torque_share=0.6)
    move = TrapezoidalMove(READY_RAD, READY_RAD + change, limits)
    share = np.abs(MODEL.inverse_dynamics(*samples(move)[1:])) / MODEL.torque_max_nm
    assert 0.5 < share.max() <= 0.6 + 1e-6
    assert move.duration_s < float(durations_s(READY_RAD, READY_RAD + change, LIMITS))


def test_half_of_the_speed_takes_twice_as_long_or_a_little_less() -> None:
    whole = torque_limited(MODEL, LIMITS)(READY_RAD, READY_RAD + MOVES[3])
    half = torque_limited(MODEL, LIMITS, speed_share=0.5)(READY_RAD, READY_RAD + MOVES[3])
    assert 1.7 * whole.duration_s < half.duration_s <= 2.0 * whole.duration_s
    assert np.abs(samples(half)[2]).max() == pytest.approx(0.5 * np.abs(samples(whole)[2]).max(), rel=1e-6)


def test_a_posture_that_cannot_be_held_is_refused_with_joint_value_and_limit() -> None:
    weak = replace(MODEL, torque_max_nm=np.array([97.0, 20.0, 89.0, 24.0, 20.0, 21.0]))
    with pytest.raises(SafetyStopError, match=r"joint 2 needs 2\d\.\d N m .*15\.0 N m may be planned with"):
        within_torque(weak, READY_RAD, READY_RAD + MOVES[1], LIMITS)
    with pytest.raises(ConfigError, match="torque_share"):
        within_torque(MODEL, READY_RAD, READY_RAD + MOVES[0], LIMITS, torque_share=0.0)


def test_the_old_controller_is_told_a_point_every_28_ms_with_straight_lines_between() -> None:
    move = TrapezoidalMove(READY_RAD, READY_RAD + MOVES[0], LIMITS)
    told = control_law("set_points_28ms", MODEL).commands(move).position_rad
    assert len(told) % 32 == 0
    t = 28e-3 * np.arange(1, len(told) // 32 + 1)
    assert_allclose(told[31::32], move.sample(t)[0], atol=1e-12)
    assert_allclose(np.diff(told[32:64], n=2, axis=0), 0.0, atol=1e-12)
    assert_allclose(told[-1], READY_RAD + MOVES[0], atol=1e-12)


def test_a_time_optimal_pass_goes_through_every_point_within_all_limits() -> None:
    from surfuse.motion.time_optimal import PassParameters, time_optimal_pass

    wave = np.linspace(0.0, 1.0, 25)[:, None]
    points = READY_RAD + wave * MOVES[0] + 0.05 * np.sin(6.0 * wave) * np.array([1.0, -1.0, 1.0, 0.0, 1.0, 0.0])
    planned, times = time_optimal_pass(points, MODEL, LIMITS, KINEMATICS.jacobian, PassParameters(tool_speed_m_s=0.3))
    consistent(planned)
    assert_allclose(planned.sample(times)[0], points, atol=1e-9)
    assert np.all(np.diff(times) > 0.0)
    t, q, qd, qdd = samples(planned)
    assert np.all(np.abs(qd) <= LIMITS.velocity_rad_s * 1.001)
    assert np.all(np.abs(MODEL.inverse_dynamics(q, qd, qdd)) <= 0.77 * MODEL.torque_max_nm)
    tool = np.linalg.norm(np.gradient(KINEMATICS.forward(q)[:, :3, 3], t, axis=0), axis=1)
    assert 0.25 < tool.max() < 0.302
    stops = float(np.sum(durations_s(points[:-1], points[1:], LIMITS)))
    assert planned.duration_s < 0.5 * stops


@pytest.mark.parametrize("torque_share", [0.5, 0.75, 1.0])
def test_a_pass_that_asks_too_much_is_stretched_until_its_torques_are_just_allowed(torque_share: float) -> None:
    pytest.importorskip("toppra")
    from surfuse.motion.time_optimal import _torque_excess

    rng = np.random.default_rng(4)
    q = READY_RAD + rng.uniform(-0.3, 0.3, (200, 6))
    qd, qdd = rng.uniform(-1.0, 1.0, (200, 6)), rng.uniform(-30.0, 30.0, (200, 6))
    factor = np.sqrt(_torque_excess(q, qd, qdd, MODEL, torque_share))
    assert factor > 1.0
    # Friction counts as at the full speed: slower, it is less.
    share = np.abs(MODEL.rigid_torque(q, qd / factor, qdd / factor**2) + MODEL.friction(qd)) / MODEL.torque_max_nm
    assert share.max() == pytest.approx(torque_share, rel=1e-9)


def test_a_hostile_pass_is_refused() -> None:
    from surfuse.motion.time_optimal import PassParameters, time_optimal_pass

    with pytest.raises(ConfigError, match="no repeats"):
        time_optimal_pass(np.tile(READY_RAD, (3, 1)), MODEL, LIMITS, KINEMATICS.jacobian)
    with pytest.raises(ConfigError, match="tool_speed_m_s"):
        PassParameters(tool_speed_m_s=float("inf"))


def pass_through_a_line(**how: float) -> tuple[Trajectory, FloatArray, FloatArray]:
    from surfuse.motion.time_optimal import PassParameters, time_optimal_pass

    points = READY_RAD + np.linspace(0.0, 1.0, 15)[:, None] * np.radians([12.0, -3.0, 4.0, 2.0, -5.0, 3.0])
    dynamics = None if how.pop("published", False) else MODEL
    planned, times = time_optimal_pass(points, dynamics, LIMITS, KINEMATICS.jacobian, PassParameters(**how))
    return planned, times, points


def test_a_pass_with_a_ramp_has_bounded_jerk_and_still_meets_every_point() -> None:
    planned, times, points = pass_through_a_line(tool_speed_m_s=0.1, ramp_s=0.03)
    consistent(planned)
    assert_allclose(planned.sample(times)[0], points, atol=1e-9)
    jumping = pass_through_a_line(tool_speed_m_s=0.1)[0]
    step = 1e-4
    largest = []
    for motion in (planned, jumping):
        t = np.arange(0.0, motion.duration_s, step)
        largest.append(np.abs(np.diff(motion.sample(t)[2], axis=0)).max() / step)
    assert largest[0] < 0.1 * largest[1]
    assert planned.duration_s < jumping.duration_s + 0.04
    assert_allclose(planned.sample([0.0, planned.duration_s])[1], 0.0, atol=1e-12)


def test_an_arm_of_unknown_dynamics_keeps_its_acceleration_limits() -> None:
    planned, times, points = pass_through_a_line(tool_speed_m_s=0.2, published=True)
    qdd = samples(planned)[3]
    assert np.all(np.abs(qdd) <= LIMITS.acceleration_rad_s2 * 1.002)
    assert np.abs(qdd / LIMITS.acceleration_rad_s2).max() > 0.9
    assert_allclose(planned.sample(times)[0], points, atol=1e-9)


def test_the_mean_of_a_path_law_is_the_mean() -> None:
    from surfuse.motion.path_law import PathLaw

    grid = np.linspace(0.0, 1.0, 11)
    speed = np.sqrt(np.maximum(1e-9, np.minimum(grid, 1.0 - grid)))
    plain, ramped = PathLaw(grid, speed), PathLaw(grid, speed, 0.2)
    assert ramped.duration_s == pytest.approx(plain.duration_s + 0.2)
    for t in (0.05, 0.9, plain.duration_s + 0.1):
        window = np.linspace(t - 0.2, t, 4001)
        at, rate, push = plain.sample(window)
        found = [float(value[0]) for value in ramped.sample(np.array([t]))]
        assert_allclose(found, [np.trapezoid(value, window) / 0.2 for value in (at, rate, push)], atol=2e-3)


def test_a_hostile_ramp_is_refused() -> None:
    from surfuse.motion.time_optimal import PassParameters

    with pytest.raises(ConfigError, match="ramp_s"):
        PassParameters(ramp_s=float("nan"))
