"""The arm behind the servo cards: it arrives, settles, tells where it is, and refuses what it must."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from trident_bench import MODEL, TARGET, Bench

from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.arm_models.puma560_dynamics import FIXTURE, extra_load, loaded_puma560
from surfuse.arms import trident
from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.motion.trapezoid import durations_s
from surfuse.records import FloatArray
from surfuse.rig.simulated.servo_arm import control_law
from surfuse.servo_cards.scales import CardScales

COUNT = CardScales().resolution_rad


def test_the_arm_arrives_settles_and_reports_encoder_counts() -> None:
    bench = Bench()
    with bench.arm as arm:
        began = bench.clock.now_s()
        state = arm.move_to(TARGET)
        took = bench.clock.now_s() - began
    assert_allclose(state.position_rad, TARGET, atol=2e-4)
    assert np.all(np.abs(state.position_rad - bench.plant.position_rad) <= 0.6 * COUNT + 2e-5)
    counts = CardScales().counts(state.position_rad)
    assert_allclose(counts, np.rint(counts), atol=1e-6)
    move = float(durations_s(READY_RAD, TARGET, LIMITS))
    assert move < took < move + 0.2
    assert state.t_s == pytest.approx(bench.clock.now_s())


def test_a_payload_error_of_two_kilograms_is_overcome() -> None:
    heavy = loaded_puma560(FIXTURE, extra_load(2.0))
    bench = Bench(truth=replace(heavy, coulomb_motor_nm=1.15 * heavy.coulomb_motor_nm))
    with bench.arm as arm:
        state = arm.move_to(TARGET)
    assert_allclose(state.position_rad, TARGET, atol=2e-4)


def test_independent_pid_arrives_too_and_pd_says_that_it_did_not() -> None:
    with Bench(law=control_law("independent_pid", MODEL)).arm as arm:
        assert_allclose(arm.move_to(TARGET).position_rad, TARGET, atol=2e-4)
    slow = trident.Parameters(settle_timeout_s=0.5)
    with (
        Bench(law=control_law("gravity_pd", MODEL), parameters=slow).arm as arm,
        pytest.raises(DeviceError, match=r"joint \d is still 0\.\d+ deg from its target after 0\.5 s"),
    ):
        arm.move_to(TARGET)


def test_the_arm_stays_where_it_settled() -> None:
    bench = Bench()
    with bench.arm as arm:
        arm.move_to(TARGET)
        before = bench.plant.position_rad
        arm.servo.hold(arm.target_rad, 500)
        assert np.all(np.abs(bench.plant.position_rad - before) < 2.0 * COUNT)


def test_a_target_outside_the_limits_is_refused_before_the_arm_moves() -> None:
    bench = Bench()
    with bench.arm as arm:
        before, t = bench.plant.position_rad, bench.clock.now_s()
        beyond = READY_RAD.copy()
        beyond[2] = np.radians(-230.0)
        with pytest.raises(SafetyStopError, match=r"joint 3 is -230\.00 deg"):
            arm.move_to(beyond)
        with pytest.raises(SafetyStopError, match="joint 2 is nan"):
            arm.move_to(np.where(np.arange(6) == 1, np.nan, READY_RAD))
        assert_allclose(bench.plant.position_rad, before)
        assert bench.clock.now_s() == t


def test_the_guard_is_asked_with_start_and_target() -> None:
    asked: list[tuple[FloatArray, FloatArray]] = []

    def guard(start: FloatArray, end: FloatArray) -> None:
        asked.append((start, end))
        raise SafetyStopError("too near")

    bench = Bench(guard=guard)
    with bench.arm as arm, pytest.raises(SafetyStopError, match="too near"):
        arm.move_to(TARGET)
    assert_allclose(asked[0][0], READY_RAD, atol=1e-3)
    assert_allclose(asked[0][1], TARGET)


def test_power_is_off_and_brakes_are_on_after_closing() -> None:
    bench = Bench()
    with bench.arm:
        assert not bench.plant.brakes_on
    assert bench.plant.brakes_on
    with pytest.raises(SafetyStopError, match="the arm is stopped"):
        bench.arm.move_to(TARGET)


def test_the_same_moves_give_the_same_bits() -> None:
    ends = []
    for _ in range(2):
        bench = Bench()
        with bench.arm as arm:
            arm.move_to(TARGET)
            ends.append(bench.plant.position_rad)
    assert np.array_equal(ends[0], ends[1])


def test_the_servo_waits_for_no_clock_but_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def waits(*_: object) -> None:
        raise AssertionError("simulated time must not pass in real time")

    bench = Bench()
    with bench.arm as arm:
        for name in ("sleep", "monotonic", "perf_counter", "time"):
            monkeypatch.setattr(f"time.{name}", waits)
        before_s = bench.clock.now_s()
        arm.servo.hold(READY_RAD, 200)
        monkeypatch.undo()
        assert bench.clock.now_s() - before_s == pytest.approx(0.2)


def test_hostile_parameters_are_refused() -> None:
    for name, value in (("settle_rad", 0.0), ("settle_ticks", 0), ("settle_timeout_s", np.nan), ("rest_s", -1.0)):
        with pytest.raises(ConfigError, match=name):
            replace(trident.Parameters(), **{name: value})
