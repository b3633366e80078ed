"""The arm behind servo cards while it moves beside other devices: true places, encoder samples, faults on the way."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from trident_bench import KINEMATICS, TARGET, Bench, Clock

from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.errors import DataError, SafetyStopError
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import ByteArray, CameraModel, FloatArray, SensorSpec
from surfuse.rig.simulated.servo_arm import ServoDesign, ServoTwinArm, build_servo_arm
from surfuse.servo_cards.scales import CardScales

MOVE = TrapezoidalMove(READY_RAD, TARGET, LIMITS)
COUNT = CardScales().resolution_rad


class StillWorld:
    """A world with nothing in it, and no error between motor and link."""

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        return np.full(pings, np.inf), np.zeros(pings)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        return np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)

    def repeatability(self, joints: int) -> FloatArray:
        return np.zeros(joints)

    def begin(self, stage: str, index: int) -> None:
        return None


def twin() -> tuple[ServoTwinArm, Clock]:
    clock = Clock()
    parts = build_servo_arm(KINEMATICS, clock, np.random.default_rng(2), ServoDesign(calibrated_at_start=False))
    return ServoTwinArm(parts, StillWorld()), clock


def test_the_arm_moves_while_other_devices_let_time_pass() -> None:
    arm, clock = twin()
    with arm:
        began_s = arm.start(MOVE)
        places, times = [], []
        while clock.now_s() < began_s + MOVE.duration_s:
            # A sensor that is busy for 25 ms, whenever that may be within the servo's period.
            clock.advance(0.0253)
            places.append(arm.true_joints_rad)
            times.append(clock.now_s())
        planned = MOVE.sample(np.array(times) - began_s)[0]
        assert_allclose(places, planned, atol=4e-3)
        assert np.abs(np.array(places) - planned).max() > 1e-5
        arm.finish()
        assert_allclose(arm.joint_state().position_rad, TARGET, atol=3e-4)


def test_samples_say_where_the_arm_was_when_a_sensor_fired() -> None:
    arm, clock = twin()
    with arm:
        began_s = arm.start(MOVE)
        for due_s in np.arange(0.1, MOVE.duration_s, 0.2):
            arm.wait_until(began_s + float(due_s))
            fired_s, true = [], []
            for _ in range(4):
                fired_s.append(clock.now_s())
                true.append(arm.true_joints_rad)
                clock.advance(0.025)
            found = arm.samples_since(fired_s[0]).at(np.array(fired_s))
            # Half a count, and what a straight line over 4 ms leaves.
            assert_allclose(found, true, atol=0.6 * COUNT.max() + 3e-5)
        arm.finish()


def test_samples_come_every_few_milliseconds_and_end_now() -> None:
    arm, clock = twin()
    with arm:
        began_s = arm.start(MOVE)
        arm.wait_until(began_s + 0.3)
        samples = arm.samples_since(began_s)
        assert samples.t_s[0] == began_s
        assert np.diff(samples.t_s).max() < 4.1e-3
        assert clock.now_s() - samples.t_s[-1] < 1.1e-3
        later = arm.samples_since(began_s + 0.2)
        assert began_s + 0.2 - 4.1e-3 < later.t_s[0] <= began_s + 0.2
        with pytest.raises(DataError, match="samples"):
            samples.at(np.array([began_s + 0.5]))


def test_nothing_is_forgotten_in_mid_motion() -> None:
    arm, _ = twin()
    with arm:
        began_s = arm.start(MOVE)
        arm.wait_until(began_s + 0.4)
        before = arm.true_joints_rad
        arm.begin_stop()
        assert_allclose(arm.true_joints_rad, before, atol=1e-12)


def test_a_fault_on_the_way_reaches_who_waits_for_the_arm_not_the_sensor() -> None:
    arm, clock = twin()
    with arm:
        began_s = arm.start(MOVE)
        arm.wait_until(began_s + 0.3)
        arm.parts.card.open_emergency_stop()
        clock.advance(0.1)
        # The sensor's node asks where the arm is: it gets an answer.
        at_rest = arm.true_joints_rad
        with pytest.raises(SafetyStopError, match="the emergency stop was pushed"):
            arm.wait_until(began_s + 0.5)
        assert arm.parts.plant.brakes_on
        assert_allclose(arm.true_joints_rad[:3], at_rest[:3], atol=1e-9)
        with pytest.raises(SafetyStopError, match="the arm is stopped"):
            arm.finish()
        arm.parts.card.close_emergency_stop()
        arm.parts.arm.recover()
        assert_allclose(arm.move_to(TARGET).position_rad, TARGET, atol=3e-4)


def test_a_motion_that_begins_elsewhere_is_refused() -> None:
    for arm in (twin()[0], Bench().arm):
        with arm:
            start = arm.start if isinstance(arm, ServoTwinArm) else arm.begin
            with pytest.raises(SafetyStopError, match=r"begins with joint 6 at 10\.\d+ deg, the arm stands at"):
                start(TrapezoidalMove(TARGET, READY_RAD, LIMITS))


def test_a_motion_beyond_the_limits_is_refused_before_it_begins() -> None:
    arm, clock = twin()
    with arm:
        beyond = READY_RAD.copy()
        beyond[2] = np.radians(-230.0)
        now = clock.now_s()
        with pytest.raises(SafetyStopError, match="joint 3"):
            arm.start(TrapezoidalMove(READY_RAD, beyond, LIMITS))
        assert clock.now_s() == now
