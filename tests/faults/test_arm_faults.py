"""Faults of arm and cards: each ends in a safe stop that names joint, value and limit, and the arm can go on."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.scan import WalkHooks
from surfuse.acquisition.stop_arm import JointStopArm

sys.path.insert(0, str(Path(__file__).parents[1] / "arms"))
from trident_bench import KINEMATICS, MODEL, TARGET, Bench

from surfuse.acquisition.scan import scan
from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.arm_models.puma560_dynamics import FIXTURE, extra_load, loaded_puma560
from surfuse.arms import trident
from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.motion.control_law import Commands
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import Echo, Fixture, FloatArray, Outline, ScanPlan, SensorSpec, Status, Sweep
from surfuse.servo_cards import registers as reg
from surfuse.servo_cards.supervision import Supervision

# Stated stopping distances: joint by joint and at the tool, from any speed within the limits, over the whole range.
# With the motors' help; without power the wrist runs out against its friction.
STOP_RAD = np.full(6, 0.04)
STOP_M = 0.02
DEAD_STOP_RAD = np.array([0.06, 0.06, 0.06, 0.7, 0.7, 0.7])
DEAD_STOP_M = 0.07
# From the moment at which an encoder sticks: braked joints, and the tool.
STUCK_RAD = 0.10
STUCK_M = 0.06


ScanParts = tuple[Bench, ScanPlan, "QuietArray", list[Sweep]]
SPEC = SensorSpec("stand-in", "ultrasonic", 0.3, 4.0, 0.3, 0.001)


class QuietArray:
    fixture = Fixture(np.stack([np.eye(4)]), (SPEC,))

    def __enter__(self) -> "QuietArray":
        return self

    def __exit__(self, *args: object) -> None:
        return None

    def sweep(self) -> tuple[Echo, ...]:
        return (Echo(0.5, Status.OK, 0.0),)


@pytest.fixture
def scan_of_three_stops() -> ScanParts:
    joints: FloatArray = np.array([READY_RAD + share * (TARGET - READY_RAD) for share in (0.2, 0.4, 1.0)])
    square = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]])
    plan = ScanPlan(
        world_from_grip=KINEMATICS.forward(joints),
        uv_m=np.zeros((3, 2)),
        row=np.zeros(3, dtype=np.int64),
        joints_rad=joints,
        outline=Outline(square, np.eye(4)),
        step_m=0.01,
        standoff_m=0.43,
        skipped=(),
    )
    return Bench(), plan, QuietArray(), []


def halfway(bench: Bench, share: float = 0.5) -> Commands:
    """The first part of a move, so that the arm is at speed when the fault comes."""
    commands = bench.law.commands(TrapezoidalMove(READY_RAD, TARGET, LIMITS))
    count = int(share * len(commands))
    return Commands(
        commands.position_rad[:count], commands.velocity_rad_s[:count], commands.acceleration_rad_s2[:count]
    )


def assert_safe(bench: Bench) -> None:
    """Power off, brakes on, everything at rest."""
    assert bench.plant.brakes_on
    assert bench.card.read(reg.STATUS_REG)[0] & reg.STATUS_POWER_ON == 0
    before = bench.plant.position_rad
    for _ in range(200):
        bench.card.wait(1e-3)
    assert_allclose(bench.plant.position_rad[:3], before[:3], atol=1e-6)


def test_a_stuck_encoder_stops_the_arm() -> None:
    bench = Bench()
    with bench.arm as arm:
        bench.card.stick_encoder(2)
        with pytest.raises(
            SafetyStopError,
            match=r"encoder of joint 2 stands still at 80\.\d+ deg.*by \d+\.\d N m \(friction and load hold 45\.0\)",
        ):
            arm.move_to(TARGET)
        assert_safe(bench)
        assert abs(bench.plant.position_rad[1] - READY_RAD[1]) < STUCK_RAD


@pytest.mark.parametrize("joint", range(1, 7))
def test_an_encoder_that_sticks_at_speed_stops_the_arm_before_it_runs_away(joint: int) -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        begin = bench.plant.position_rad
        bench.card.stick_encoder(joint)
        rest = bench.law.commands(TrapezoidalMove(READY_RAD, TARGET, LIMITS))
        later = slice(len(halfway(bench)), None)
        with pytest.raises(SafetyStopError, match=f"encoder of joint {joint} stands still"):
            arm.servo.run(
                Commands(rest.position_rad[later], rest.velocity_rad_s[later], rest.acceleration_rad_s2[later])
            )
        assert_safe(bench)
        end = bench.plant.position_rad
        assert np.abs(end - begin)[:3].max() < STUCK_RAD
        # The wrist has no brakes and runs out against its friction alone.
        assert float(np.linalg.norm((KINEMATICS.forward(end) - KINEMATICS.forward(begin))[:3, 3])) < STUCK_M


def test_a_following_error_stops_the_arm() -> None:
    tight = trident.Parameters(supervision=Supervision(following_rad=0.02, stuck_rad=0.5))
    bench = Bench(parameters=tight)
    with bench.arm as arm:
        far = np.tile(READY_RAD, (50, 1))
        far[:, 0] += np.radians(3.0)
        with pytest.raises(SafetyStopError, match=r"following error of joint 1 is 3\.0\d deg, its limit is 1\.15 deg"):
            arm.servo.run(Commands(far, np.zeros_like(far), np.zeros_like(far)))
        assert_safe(bench)


def test_an_encoder_that_jumps_stops_the_arm() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        bench.card.write(reg.ENC_LOAD_BASE + 3 * reg.STEP, [20000])
        with pytest.raises(SafetyStopError, match="encoder of joint 4 jumped by more than 400 counts"):
            arm.servo.hold(arm.servo.position_rad, 2)
        assert_safe(bench)


def test_a_blow_makes_the_joint_too_fast() -> None:
    bench = Bench()
    with bench.arm as arm:
        bench.plant.drift(np.array([0.0, 0.0, 0.0, 20.0, 0.0, 0.0]))
        with pytest.raises(SafetyStopError, match=r"joint 4 turns at \d+ deg/s, its limit is 300 deg/s"):
            arm.servo.hold(READY_RAD, 20)
        assert_safe(bench)


def test_a_lost_heartbeat_stops_the_arm() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        bench.card.stall(4e-3)
        with pytest.raises(SafetyStopError, match=r"heartbeat was lost: 5\.0 ms between two ticks, at most 3\.0 ms"):
            arm.servo.hold(arm.servo.position_rad, 5)
        assert_safe(bench)


def test_the_watchdog_cuts_the_power_of_a_dead_computer() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        there = bench.plant.position_rad
        # The computer does nothing for a second: the card alone must stop the arm.
        for _ in range(1000):
            bench.card.wait(1e-3)
        assert_safe(bench)
        assert np.abs(bench.plant.position_rad - there).max() < STUCK_RAD
        with pytest.raises(SafetyStopError, match="watchdog was not fed in time and cut the arm power"):
            arm.servo.hold(TARGET, 1)
        with pytest.raises(SafetyStopError, match="the arm is stopped: the card's watchdog"):
            arm.move_to(TARGET)


def test_the_emergency_stop_button_stops_the_arm_and_it_goes_on_afterwards() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        bench.card.open_emergency_stop()
        with pytest.raises(SafetyStopError, match="the emergency stop was pushed"):
            arm.servo.hold(arm.servo.position_rad, 1)
        assert_safe(bench)
        with pytest.raises(DeviceError, match="the emergency stop is pushed"):
            arm.recover()
        bench.card.close_emergency_stop()
        state = arm.recover()
        # The counters counted on while the arm ran out: the position is still known to the count.
        assert np.abs(state.position_rad - bench.plant.position_rad).max() < 2e-4
        assert_allclose(arm.move_to(TARGET).position_rad, TARGET, atol=2e-4)


def test_a_card_that_falls_silent_is_a_device_error() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        bench.card.go_silent()
        with pytest.raises(DeviceError, match="does not answer: status register 0x0c reads 0xffff"):
            arm.servo.hold(TARGET, 1)
        # Nobody feeds the watchdog any more.
        for _ in range(300):
            bench.card.wait(1e-3)
        assert bench.plant.brakes_on
    silent = Bench()
    silent.card.go_silent()
    with pytest.raises(DeviceError, match="does not answer"), silent.arm:
        pass


def test_no_power_without_the_emergency_chain() -> None:
    bench = Bench()
    bench.card.open_emergency_stop()
    with pytest.raises(DeviceError, match="the emergency stop is pushed"), bench.arm:
        pass
    assert bench.plant.brakes_on


def moving(seed: int, truth: ArmDynamics = MODEL) -> Bench:
    """An arm anywhere within its limits."""
    rng = np.random.default_rng(seed)
    middle, half = 0.5 * (LIMITS.lower_rad + LIMITS.upper_rad), 0.45 * (LIMITS.upper_rad - LIMITS.lower_rad)
    return Bench(start=middle + half * rng.uniform(-1.0, 1.0, 6), truth=truth)


def at_speed(bench: Bench, seed: int) -> FloatArray:
    """Give the arm its speed, up to the limits of the joints and 1 m/s at the tool; returns where it is."""
    rng = np.random.default_rng(1000 + seed)
    speed = LIMITS.velocity_rad_s * np.where(rng.random(6) < 0.5, -1.0, 1.0) * rng.uniform(0.5, 1.0, 6)
    tool = float(np.linalg.norm(KINEMATICS.jacobian(bench.start)[:3] @ speed))
    bench.plant.drift(speed * min(1.0, 1.0 / tool))
    return bench.plant.position_rad


def tool_travel(begin: FloatArray, end: FloatArray) -> float:
    places = KINEMATICS.forward(np.array([begin, end]))[:, :3, 3]
    return float(np.linalg.norm(places[1] - places[0]))


@pytest.mark.parametrize("seed", range(24))
def test_an_emergency_stop_from_any_state_ends_within_the_stated_distance(seed: int) -> None:
    bench = moving(seed)
    with bench.arm as arm:
        begin = at_speed(bench, seed)
        arm.emergency_stop()
        end = bench.plant.position_rad
        assert np.all(np.abs(end - begin) < STOP_RAD)
        assert tool_travel(begin, end) < STOP_M
        assert_safe(bench)
        with pytest.raises(SafetyStopError, match="asked for by the program"):
            arm.move_to(TARGET)


@pytest.mark.parametrize("seed", range(8))
def test_an_unknown_load_does_not_carry_the_braked_joints_on(seed: int) -> None:
    bench = moving(seed, loaded_puma560(FIXTURE, extra_load(2.0)))
    with bench.arm as arm:
        begin = at_speed(bench, seed)
        arm.emergency_stop()
        assert np.all(np.abs(bench.plant.position_rad - begin)[:3] < STOP_RAD[:3])


@pytest.mark.parametrize("seed", range(24))
def test_a_loss_of_power_in_any_state_ends_within_the_stated_distance(seed: int) -> None:
    bench = moving(seed)
    with bench.arm as arm:
        begin = at_speed(bench, seed)
        bench.card.open_emergency_stop()
        with pytest.raises(SafetyStopError, match="the emergency stop was pushed"):
            arm.servo.hold(begin, 1)
        end = bench.plant.position_rad
        assert np.all(np.abs(end - begin) < DEAD_STOP_RAD)
        assert tool_travel(begin, end) < DEAD_STOP_M
        # The counters have followed all the way.
        assert np.abs(arm.joint_state().position_rad - end).max() < 2e-4


def test_an_emergency_stop_with_a_stuck_encoder_cuts_the_power_at_once() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.servo.run(halfway(bench))
        bench.card.stick_encoder(5)
        arm.emergency_stop()
        assert_safe(bench)
        assert not arm.servo.running


def test_a_program_that_fails_in_mid_motion_leaves_the_arm_at_rest() -> None:
    bench = Bench()

    def scan_until_the_disk_is_full() -> None:
        with bench.arm as arm:
            arm.begin(TrapezoidalMove(READY_RAD, TARGET, LIMITS))
            arm.run_until(bench.clock.now_s() + 0.3)
            raise RuntimeError("the disk is full")

    with pytest.raises(RuntimeError, match="disk"):
        scan_until_the_disk_is_full()
    assert_safe(bench)
    assert np.abs(bench.plant.velocity_rad_s).max() < 1e-6


def test_what_was_scanned_before_a_stop_has_been_handed_on(scan_of_three_stops: ScanParts) -> None:
    bench, plan, array, kept = scan_of_three_stops

    def before(stop: int) -> None:
        if stop == 2:
            bench.card.stick_encoder(1)

    with bench.arm as arm:
        with pytest.raises(SafetyStopError, match="encoder of joint 1 stands still"):
            scan(plan, JointStopArm(arm), array, WalkHooks(kept.append, before))
        assert [sweep.stop for sweep in kept] == [0, 1]
        bench.card.mend_encoders()
        arm.recover()
        outcome = scan(plan, JointStopArm(arm), array, WalkHooks(kept.append), start_at=2)
    assert outcome.finished
    assert [sweep.stop for sweep in kept] == [0, 1, 2]


def test_hostile_supervision_is_refused() -> None:
    with pytest.raises(ConfigError, match="following_rad"):
        Supervision(following_rad=float("nan"))
    with pytest.raises(ConfigError, match="speed_max_rad_s"):
        Supervision(speed_max_rad_s=(1.0, -1.0, 1.0, 1.0, 1.0, 1.0))
