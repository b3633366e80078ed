"""The compiled loop of the twin against the servo ticking through the card: the same to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, READY_RAD, Puma560
from surfuse.arms import trident
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.rig.simulated.servo_arm import ServoArm, ServoDesign, Unknown, build_servo_arm

KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.08 - FLANGE_OFFSET_M]))
TURNS = ([8.0, -4.0, 3.0, 5.0, -3.0, 10.0], [7.5, -4.0, 3.0, 5.0, -3.0, 9.0])
TARGETS = [READY_RAD + np.radians(turn) for turn in TURNS]


def both(**how: object) -> list[ServoArm]:
    """The same arm with and without the compiled loop."""
    return [
        build_servo_arm(
            KINEMATICS,
            SimulatedClock(),
            np.random.default_rng(3),
            ServoDesign(parameters=trident.Parameters(rest_s=0.02), compiled_loop=compiled, **how),  # type: ignore[arg-type]
        )
        for compiled in (True, False)
    ]


def assert_same(fast: ServoArm, slow: ServoArm) -> None:
    assert_array_equal(fast.plant.position_rad, slow.plant.position_rad)
    assert_array_equal(fast.plant.velocity_rad_s, slow.plant.velocity_rad_s)
    for one, other in zip(fast.arm.servo.memory, slow.arm.servo.memory, strict=True):
        assert_array_equal(one, other)
    for register, count in ((0x0C, 1), (0x10, 6), (0x2E, 1), (0x00, 1)):
        assert fast.card.read(register, count) == slow.card.read(register, count)


@pytest.mark.parametrize("calibrated_at_start", [True, False])
def test_moves_settling_rests_and_calibration_are_the_same(calibrated_at_start: bool) -> None:
    arms = both(calibrated_at_start=calibrated_at_start, unknown=Unknown(1.0, 0.1))
    times = []
    for parts in arms:
        clock_s = parts.arm.joint_state().t_s
        with parts.arm as arm:
            for target in TARGETS:
                arm.move_to(target)
            times.append(arm.joint_state().t_s - clock_s)
    assert_same(*arms)
    assert times[0] == pytest.approx(times[1], abs=1e-9)


def test_a_stop_by_supervision_is_the_same() -> None:
    arms, told = both(calibrated_at_start=False), []
    for parts in arms:
        with parts.arm as arm:
            arm.move_to(TARGETS[0])
            parts.card.stick_encoder(2)
            with pytest.raises(SafetyStopError, match="encoder of joint 2 stands still") as stopped:
                arm.move_to(READY_RAD)
            told.append(str(stopped.value))
    assert told[0] == told[1]
    assert_same(*arms)


def test_a_stall_is_seen_by_the_tick_that_it_delays() -> None:
    fast, _ = both(calibrated_at_start=False)
    with fast.arm as arm:
        fast.card.stall(4e-3)
        with pytest.raises(SafetyStopError, match="heartbeat was lost"):
            arm.move_to(TARGETS[0])
