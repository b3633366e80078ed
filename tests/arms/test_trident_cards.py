"""The servo card: registers, scales, counters that overflow, wrist coupling, start-up calibration."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from trident_bench import MODEL, Bench

from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.arm_models.puma560_dynamics import TORQUE_MAX_NM
from surfuse.errors import ConfigError, DeviceError
from surfuse.servo_cards import registers as reg
from surfuse.servo_cards.calibration import Calibration, rough_position
from surfuse.servo_cards.scales import CardScales, converter_words, unwrap
from surfuse.twin.servo_card import CardParameters, Potentiometers

SCALES = CardScales()
PLACES = np.random.default_rng(3).uniform(LIMITS.lower_rad, LIMITS.upper_rad, (20, 6))


@given(st.lists(st.integers(-32767, 32767), min_size=1, max_size=40), st.integers(0, 65535))
def test_counters_are_carried_over_their_overflows(changes: list[int], first: int) -> None:
    last, counts, total = np.array([first]), np.array([first]), first
    for change in changes:
        total += change
        unwrap(np.array([total & 0xFFFF]), last, counts)
        assert counts[0] == total


def test_joint_6_overflows_its_counter_over_its_range() -> None:
    span = np.abs(SCALES.counts(LIMITS.upper_rad) - SCALES.counts(LIMITS.lower_rad))
    assert span[5] > 65536.0 > span[0]


def test_counts_and_joints_are_inverse_and_decode_as_published() -> None:
    for place in PLACES:
        assert_allclose(SCALES.joints(SCALES.counts(place)), place, atol=1e-12)
    motors = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    joints = SCALES.joints(motors / np.array(SCALES.rad_per_count)) - np.array(SCALES.zero_rad)
    c45, c46, c56 = SCALES.coupling
    assert_allclose(joints[:4], motors[:4])
    assert joints[4] == pytest.approx(0.5 - c45 * 0.4)
    assert joints[5] == pytest.approx(0.6 - c46 * 0.4 - c56 * 0.5)


def test_torque_words_keep_power_across_the_coupling() -> None:
    torque, speed = np.array([20.0, -30.0, 15.0, 3.0, -2.0, 1.0]), np.array([0.3, -0.2, 0.5, 0.7, -0.4, 0.9])
    words = np.zeros(6, dtype=np.int64)
    motor_torque = np.ascontiguousarray(SCALES.joint_from_motor.T)
    converter_words(torque, motor_torque, np.array(SCALES.counts_per_nm), words)
    at_motors = (words - reg.DAC_ZERO) / np.array(SCALES.counts_per_nm)
    assert at_motors @ (SCALES.motor_from_joint @ speed) == pytest.approx(torque @ speed, abs=0.1)


def test_the_converters_end_where_the_torque_limits_are() -> None:
    for torque in (np.full(6, 1e4), np.full(6, -1e4)):
        words = np.zeros(6, dtype=np.int64)
        converter_words(torque, np.eye(6), np.array(SCALES.counts_per_nm), words)
        assert set(words.tolist()) == {0, reg.DAC_FULL}
        reached = (words - reg.DAC_ZERO) / np.array(SCALES.counts_per_nm)
        assert_allclose(np.abs(reached), TORQUE_MAX_NM, rtol=1e-2)


def test_without_power_nothing_moves_whatever_the_converters_say() -> None:
    bench = Bench()
    bench.card.write(reg.DAC_BASE, [0] * 6)
    for _ in range(50):
        bench.card.wait(1e-3)
    assert_allclose(bench.plant.position_rad, READY_RAD, atol=1e-12)
    assert bench.card.read(reg.STATUS_REG)[0] & reg.STATUS_POWER_ON == 0


def test_a_loaded_counter_counts_on_from_there() -> None:
    bench = Bench()
    bench.card.write(reg.ENC_LOAD_BASE + 2 * reg.STEP, [65530])
    assert bench.card.read(reg.ENC_COUNT_BASE, 6)[2] == 65530
    moved = READY_RAD + np.array([0.0, 0.0, 20 * SCALES.rad_per_count[2], 0.0, 0.0, 0.0])
    bench.plant.rest_at(moved)
    bench.card.wait(1e-3)
    assert bench.card.read(reg.ENC_COUNT_BASE, 6)[2] == 14


def test_index_pulses_are_latched_once_a_turn_and_cleared_by_reading() -> None:
    bench = Bench()
    seen = 0
    for step in range(1, 251):
        bench.plant.rest_at(READY_RAD + np.array([step * 10 * SCALES.rad_per_count[0], 0.0, 0.0, 0.0, 0.0, 0.0]))
        bench.card.wait(1e-3)
        if bench.card.read(reg.STATUS_REG)[0] >> reg.STATUS_INDEX_SHIFT & 1:
            seen += 1
            bench.card.read(reg.ENC_INDEX_BASE)
            assert not bench.card.read(reg.STATUS_REG)[0] & reg.STATUS_INDEX & 1 << reg.STATUS_INDEX_SHIFT
    assert seen in (2, 3)


@pytest.mark.parametrize("place", [READY_RAD, *PLACES[:3]])
def test_potentiometers_are_good_to_less_than_half_a_motor_turn(place: np.ndarray) -> None:
    bench = Bench(start=place)
    rough = rough_position(bench.card, SCALES, Calibration())
    assert np.all(np.abs(rough - place) < 0.4 * SCALES.resolution_rad * np.array(SCALES.counts_per_turn))
    assert np.abs(rough - place).max() > 1e-4


@pytest.mark.parametrize("shift", [np.zeros(6), np.radians([60.0, -20.0, 40.0, 30.0, -20.0, 200.0])])
def test_calibration_finds_the_joints_to_the_count(shift: np.ndarray) -> None:
    bench = Bench(start=READY_RAD + shift, reference=Calibration())
    with bench.arm as arm:
        assert np.all(np.abs(arm.joint_state().position_rad - bench.plant.position_rad) < SCALES.resolution_rad)
        # It turns by a motor turn and comes back to where it started.
        assert_allclose(bench.plant.position_rad, READY_RAD + shift, atol=0.06)
        assert 1.0 < bench.clock.time_s < 10.0


def test_calibration_refuses_a_potentiometer_that_contradicts_the_index_pulse() -> None:
    bent = CardParameters(
        potentiometers=Potentiometers(bend_v=0.0, noise_v=0.0), index_phase=(137, 855, 702, 318, 871, 44)
    )
    bench = Bench(reference=replace(Calibration(), doubt_share=0.3), card_parameters=bent)
    with pytest.raises(DeviceError, match=r"motor 2 are \d+ counts apart, at most 240"), bench.arm:
        pass


def test_hostile_parameters_are_refused() -> None:
    with pytest.raises(ConfigError, match="rad_per_count"):
        CardScales(rad_per_count=(0.0, *SCALES.rad_per_count[1:]))
    with pytest.raises(ConfigError, match="watchdog_s"):
        CardParameters(watchdog_s=0.0)
    with pytest.raises(ConfigError, match="doubt_share"):
        Calibration(doubt_share=0.6)
    assert len(MODEL) == 6
