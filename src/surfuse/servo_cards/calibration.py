"""Start-up calibration: the potentiometer of each motor picks the turn, its index pulse then gives the exact count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DeviceError
from surfuse.motion.control_law import Commands, ControlLaw
from surfuse.records import FloatArray
from surfuse.servo_cards import registers as reg
from surfuse.servo_cards.scales import WORD, CardScales
from surfuse.servo_cards.servo import JointServo


@dataclass(frozen=True)
class Calibration:
    """What was measured once on this arm.

    `pot_rad_per_volt`, `pot_zero_v` (6,): line of each potentiometer, angle of the motor side = slope x (V - zero).
    `index_phase` (6,): absolute count of one index pulse of each motor. `samples`: readings averaged for one voltage.
    `doubt_share`: largest disagreement of potentiometer and index pulse, as a share of a motor turn. `sweep_rad_s`:
    joint speed while looking for the pulses.
    """

    pot_rad_per_volt: tuple[float, ...] = (1.0 / 0.45,) * reg.JOINTS
    pot_zero_v: tuple[float, ...] = (2.5,) * reg.JOINTS
    index_phase: tuple[int, ...] = (137, 455, 702, 318, 871, 44)
    samples: int = 9
    doubt_share: float = 0.4
    sweep_rad_s: float = 0.1

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise ConfigError(f"samples = {self.samples}", cure="give 1 or more")
        if not 0.0 < self.doubt_share < 0.5:
            raise ConfigError(f"doubt_share = {self.doubt_share}", cure="give a share above 0 and below 0.5")
        if not 0.0 < self.sweep_rad_s <= 0.5:
            raise ConfigError(f"sweep_rad_s = {self.sweep_rad_s}", cure="give a slow speed, at most 0.5 rad/s")


def rough_position(bus: reg.CardBus, scales: CardScales, calibration: Calibration) -> FloatArray:
    """Joint angles (6,) from the potentiometers alone: good to about a degree."""
    motors = np.empty(reg.JOINTS)
    for j in range(reg.JOINTS):
        bus.write(reg.ADC_MUX_SELECT, [j])
        volts = [_volts(bus) for _ in range(calibration.samples)]
        motors[j] = calibration.pot_rad_per_volt[j] * (float(np.mean(volts)) - calibration.pot_zero_v[j])
    return np.asarray(scales.joint_from_motor @ motors + np.asarray(scales.zero_rad), dtype=np.float64)


def _volts(bus: reg.CardBus) -> float:
    bus.write(reg.ADC_START, [0])
    word = bus.read(reg.ADC_VALUE)[0]
    return (word - WORD if word >= WORD // 2 else word) * reg.ADC_VOLT_PER_LSB


def calibrate(
    bus: reg.CardBus, servo: JointServo, law: ControlLaw, scales: CardScales, calibration: Calibration
) -> FloatArray:
    """Find out where the arm is, to the count; it turns every joint by one motor turn and back. Returns joints (6,).

    The servo must be connected. Afterwards the arm is under power and holds its position.

    Raises
    ------
    DeviceError : a motor showed no index pulse in a whole turn, or one that its potentiometer contradicts.
    """
    servo.set_position(rough_position(bus, scales, calibration))
    for j in range(reg.JOINTS):
        bus.read(reg.ENC_INDEX_BASE + reg.STEP * j)
    start = servo.power_on()
    # A little more than one turn of the motor, towards the middle of the joint's range so that no limit is met.
    turn = 1.1 * scales.resolution_rad * np.asarray(scales.counts_per_turn)
    away = _sweep(start, start - np.copysign(turn, start - _middle(scales)), law.period_s, calibration.sweep_rad_s)
    servo.run(away)
    servo.hold(away.position_rad[-1], round(0.2 / law.period_s))
    correction = _correction(bus, servo, scales, calibration)
    servo.power_off()
    servo.set_position(scales.joints(np.rint(scales.counts(servo.read_position())) + correction))
    there = servo.power_on()
    back = _sweep(there, there + (start - away.position_rad[-1]), law.period_s, calibration.sweep_rad_s)
    servo.run(back)
    end: FloatArray = back.position_rad[-1].copy()
    return end


def _middle(scales: CardScales) -> FloatArray:
    """Any place well inside the range of every joint: where the counters are zero, or 90 degrees from the fold."""
    return np.asarray(np.asarray(scales.zero_rad) + np.array([0.0, np.pi, -np.pi, 0.0, 0.0, 0.0]), dtype=np.float64)


def _sweep(start: FloatArray, end: FloatArray, period_s: float, speed_rad_s: float) -> Commands:
    """A smooth slow motion: half a cosine, the fastest joint at the given speed in its middle."""
    duration = np.pi / 2.0 * float(np.max(np.abs(end - start))) / speed_rad_s
    count = max(1, int(np.ceil(duration / period_s)))
    t = np.arange(1, count + 1)[:, None] / count
    change, rate = end - start, np.pi / (count * period_s)
    return Commands(
        start + 0.5 * (1.0 - np.cos(np.pi * t)) * change,
        0.5 * rate * np.sin(np.pi * t) * change,
        0.5 * rate**2 * np.cos(np.pi * t) * change,
    )


def _correction(bus: reg.CardBus, servo: JointServo, scales: CardScales, calibration: Calibration) -> FloatArray:
    """Counts (6,) to add to what the potentiometers said."""
    seen = bus.read(reg.STATUS_REG)[0] >> reg.STATUS_INDEX_SHIFT
    believed = np.rint(scales.counts(servo.read_position()))
    words = bus.read(reg.ENC_COUNT_BASE, reg.JOINTS)
    correction = np.empty(reg.JOINTS)
    for j in range(reg.JOINTS):
        if not seen >> j & 1:
            raise DeviceError(
                f"motor {j + 1} showed no index pulse in a whole turn", cure="check the encoder's index channel"
            )
        latched = bus.read(reg.ENC_INDEX_BASE + reg.STEP * j)[0]
        ago = (words[j] - latched + WORD // 2) % WORD - WORD // 2
        turn, phase = scales.counts_per_turn[j], calibration.index_phase[j]
        at_index = believed[j] - ago
        true_index = phase + turn * round((at_index - phase) / turn)
        correction[j] = true_index - at_index
        if abs(correction[j]) > calibration.doubt_share * turn:
            raise DeviceError(
                f"potentiometer and index pulse of motor {j + 1} are {abs(correction[j]):.0f} counts apart, at most "
                f"{calibration.doubt_share * turn:.0f} leave no doubt about the turn",
                cure="measure the potentiometer's line again",
            )
    return correction
