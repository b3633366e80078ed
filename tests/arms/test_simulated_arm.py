from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560 import ENCODER_RAD_PER_COUNT, FLANGE_OFFSET_M, LIMITS, READY_RAD, Puma560
from surfuse.arms import recorded, simulated
from surfuse.errors import ConfigError, DataError, DeviceError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.trapezoid import durations_s
from surfuse.records import ByteArray, CameraModel, FloatArray, JointState, SensorSpec

KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
TARGET = READY_RAD + np.radians([20.0, -10.0, 5.0, 8.0, -3.0, 30.0])


class Clock:
    def __init__(self) -> None:
        self.time_s = 5.0

    def now_s(self) -> float:
        return self.time_s

    def advance(self, duration_s: float) -> None:
        assert duration_s >= 0.0
        self.time_s += duration_s


class ShakyWorld:
    """A world with nothing in it but the error of the arm."""

    def __init__(self, sigma_rad: float) -> None:
        self.sigma_rad = sigma_rad
        self.rng = np.random.default_rng(0)

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        return np.full(pings, np.inf), np.zeros(pings)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        return np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)

    def repeatability(self, joints: int) -> FloatArray:
        return self.rng.normal(0.0, self.sigma_rad, joints)

    def begin(self, stage: str, index: int) -> None:
        self.rng = np.random.default_rng(index)


def arm_in(world: ShakyWorld, clock: Clock, **changes: float) -> simulated.SimulatedArm:
    around = surroundings(world, clock)
    return simulated.create(
        simulated.Parameters(encoder_rad_per_count=ENCODER_RAD_PER_COUNT, surroundings=around, **changes)
    )


def surroundings(world: ShakyWorld, clock: Clock, start_rad: FloatArray = READY_RAD) -> simulated.Surroundings:
    return simulated.Surroundings(
        kinematics=KINEMATICS, limits=LIMITS, clock=clock, world=world, start_rad=np.asarray(start_rad)
    )


def replayed(states: list[JointState]) -> recorded.RecordedArm:
    around = recorded.Surroundings(kinematics=KINEMATICS, limits=LIMITS, states=states)
    return recorded.create(recorded.Parameters(surroundings=around))


def test_a_perfect_arm_arrives_after_the_time_of_the_move_and_the_rest() -> None:
    clock = Clock()
    with arm_in(ShakyWorld(0.0), clock, settle_s=0.3) as arm:
        state = arm.move_to(TARGET)
    assert_allclose(arm.true_joints_rad, TARGET, atol=0.0)
    assert state.t_s == clock.time_s == pytest.approx(5.0 + float(durations_s(READY_RAD, TARGET, LIMITS)) + 0.3)
    assert_allclose(arm.true_tool_pose(), KINEMATICS.forward(TARGET), atol=1e-15)


def test_half_the_speed_and_acceleration_takes_longer() -> None:
    fast, slow = Clock(), Clock()
    arm_in(ShakyWorld(0.0), fast, settle_s=0.0).move_to(TARGET)
    arm_in(ShakyWorld(0.0), slow, settle_s=0.0, speed_share=0.25).move_to(TARGET)
    # A triangular profile scales with the root of the acceleration.
    assert slow.time_s - 5.0 == pytest.approx(2.0 * (fast.time_s - 5.0))


def test_the_encoders_show_the_reached_joints_not_the_target() -> None:
    arm = arm_in(ShakyWorld(2e-3), Clock())
    measured = arm.move_to(TARGET).position_rad
    assert np.abs(arm.true_joints_rad - TARGET).max() > 1e-3
    assert np.all(np.abs(measured - arm.true_joints_rad) <= 0.5 * np.array(ENCODER_RAD_PER_COUNT) + 1e-15)
    counts = measured / np.array(ENCODER_RAD_PER_COUNT)
    assert_allclose(counts, np.round(counts), atol=1e-6)
    assert_allclose(arm.joint_state().position_rad, measured)


def test_the_error_of_a_stop_and_its_time_do_not_depend_on_what_ran_before() -> None:
    def visit(indices: list[int]) -> tuple[np.ndarray, float]:
        world, clock = ShakyWorld(1e-3), Clock()
        arm = arm_in(world, clock)
        for index in indices:
            world.begin("scan", index)
            before = clock.time_s
            arm.move_to(READY_RAD + index * np.radians([1.0, 0, 0, 0, 0, 0]))
        return arm.true_joints_rad, clock.time_s - before

    joints, duration = visit([1, 2, 3])
    again, same_duration = visit([2, 3])
    assert np.array_equal(joints, again)
    assert duration == pytest.approx(same_duration, abs=1e-12)


def test_a_refused_move_leaves_arm_and_clock_where_they_were() -> None:
    clock = Clock()
    arm = arm_in(ShakyWorld(1e-3), clock)
    with pytest.raises(SafetyStopError, match="joint 5"):
        arm.move_to(np.radians([0.0, 80.0, -215.0, 0.0, 101.0, 0.0]))
    with pytest.raises(SafetyStopError):
        arm.move_to(np.full(6, np.nan))
    assert clock.time_s == 5.0
    assert np.array_equal(arm.true_joints_rad, READY_RAD)


def test_the_guard_sees_start_and_target_and_may_refuse() -> None:
    seen: list[np.ndarray] = []

    def guard(start: np.ndarray, target: np.ndarray) -> None:
        seen.extend([start, target])
        raise SafetyStopError("the wrist would be inside the table")

    around = replace(surroundings(ShakyWorld(0.0), Clock()), guard=guard)
    arm = simulated.create(simulated.Parameters(surroundings=around))
    with pytest.raises(SafetyStopError, match="table"):
        arm.move_to(TARGET)
    assert_allclose(seen, [READY_RAD, TARGET])
    assert np.array_equal(arm.true_joints_rad, READY_RAD)


def test_a_start_outside_the_limits_is_refused() -> None:
    around = surroundings(ShakyWorld(0.0), Clock(), np.radians([0, 300.0, -90, 0, 0, 0]))
    with pytest.raises(SafetyStopError, match="joint 2"):
        simulated.create(simulated.Parameters(surroundings=around))


@pytest.mark.parametrize(
    "change", [{"settle_s": -1.0}, {"speed_share": 0.0}, {"speed_share": 1.5}, {"encoder_rad_per_count": (0.0,)}]
)
def test_parameters_out_of_their_limits_are_refused(change: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        simulated.Parameters(**change)


def test_a_recorded_arm_replays_its_states_in_order() -> None:
    states = [JointState(READY_RAD + 0.1 * i, 10.0 + i) for i in range(3)]
    with replayed(states) as arm:
        assert arm.joint_state() is states[0]
        assert arm.move_to(READY_RAD + 0.1005) is states[1]
        with pytest.raises(DeviceError, match="recorded state 2 has joint"):
            arm.move_to(READY_RAD)
        with pytest.raises(SafetyStopError):
            arm.move_to(np.full(6, np.nan))
        assert arm.move_to(READY_RAD + 0.2) is states[2]
        with pytest.raises(DeviceError, match="ends after 3"):
            arm.move_to(READY_RAD + 0.3)


def test_a_recording_must_fit_the_arm() -> None:
    with pytest.raises(DataError):
        replayed([])
    with pytest.raises(DataError, match="5 joints"):
        replayed([JointState(np.zeros(5), 0.0)])
