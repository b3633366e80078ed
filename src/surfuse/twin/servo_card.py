"""A servo card in software: the registers of the TRC004 in front of a simulated arm, with faults on demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import Clock, Generator
from surfuse.records import FloatArray, IntArray
from surfuse.servo_cards import registers as reg
from surfuse.servo_cards.scales import CardScales


class CardMemory(NamedTuple):
    """What the card works with for J motors, as kernels take it. `torque` and `absolute` to `before` (J,) move on.

    `zero` (J,) in rad, `motor_from_joint` (J, J), `per_count` (J,) in rad; `torque_per_word` (J, J) in Nm, joint from
    motor, and the joint `torque` (J,) in Nm. In counts: `absolute` position, `offset` of the counter, `frozen` word of
    a counter that is stuck (-1: none), `before` the position of the tick before, `phase` and `turn` of the index.
    """

    zero: FloatArray
    motor_from_joint: FloatArray
    per_count: FloatArray
    torque_per_word: FloatArray
    torque: FloatArray
    absolute: IntArray
    offset: IntArray
    frozen: IntArray
    before: IntArray
    phase: IntArray
    turn: IntArray


class Plant(Protocol):
    """An arm that torques move."""

    brakes_on: bool

    @property
    def position_rad(self) -> FloatArray: ...
    def step(self, torque_nm: FloatArray, duration_s: float) -> None: ...


@dataclass(frozen=True)
class Potentiometers:
    """Start-up potentiometers on the motor side: V = 2.5 + `volt_per_rad` x angle, with noise and a bend.

    `noise_v`: standard deviation of one reading. `bend_v`: largest deviation from the straight line, one full wave
    over 4 rad.
    """

    volt_per_rad: float = 0.45
    noise_v: float = 0.003
    bend_v: float = 0.005


@dataclass(frozen=True)
class CardParameters:
    """`watchdog_s`: time without a change of the watchdog bit after which the card cuts the power.

    `index_phase`: absolute count (J,) of one index pulse of every motor.

    `potentiometers`: what the start-up calibration reads.
    """

    watchdog_s: float = 5e-3
    index_phase: tuple[int, ...] = (137, 455, 702, 318, 871, 44)
    potentiometers: Potentiometers = Potentiometers()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.watchdog_s) and self.watchdog_s > 0.0):
            raise ConfigError(f"watchdog_s = {self.watchdog_s}", cure="give a time > 0 s, 1.5 servo periods or more")


class SimulatedCard:
    """A TRC004 whose channels end in a simulated arm. Counters start at 0 wherever the arm stands.

    Time passes only in `wait`, which moves the arm and the clock. While other devices use the clock the arm stands.
    """

    def __init__(
        self,
        plant: Plant,
        scales: CardScales,
        clock: Clock,
        rng: Generator,
        parameters: CardParameters = CardParameters(),
    ) -> None:
        self._plant = plant
        self._scales = scales
        self._clock = clock
        self._rng = rng
        self._parameters = parameters
        self._zero = np.asarray(scales.zero_rad)
        self._per_count = np.asarray(scales.rad_per_count)
        self._motor_from_joint = scales.motor_from_joint
        self._torque_per_word = np.ascontiguousarray(scales.motor_from_joint.T / np.asarray(scales.counts_per_nm))
        self._turn = np.asarray(scales.counts_per_turn)
        self._phase = np.asarray(parameters.index_phase)
        self._absolute = np.zeros(reg.JOINTS, dtype=np.int64)
        self._count()
        self._offset = -self._absolute
        self._frozen = np.full(reg.JOINTS, -1, dtype=np.int64)
        self._index_words = [0] * reg.JOINTS
        self._index_seen = 0
        self._words = np.full(reg.JOINTS, reg.DAC_ZERO, dtype=np.int64)
        self._shown = np.empty(reg.JOINTS, dtype=np.int64)
        self._before = np.zeros(reg.JOINTS, dtype=np.int64)
        self._torque = np.zeros(reg.JOINTS)
        self._outputs = 0
        self._unfed_s = 0.0
        self._powered = False
        self._chain_closed = True
        self._adc_channel = 0
        self._adc_word = 0
        self._stall_s = 0.0
        self._silent = False
        plant.brakes_on = True

    # The bus -----------------------------------------------------------------------------------------------------

    def read(self, register: int, count: int = 1) -> Sequence[int]:
        """See `CardBus.read`."""
        if self._silent:
            return [reg.NO_CARD] * count
        if register == reg.ENC_COUNT_BASE:
            return self._counters()[:count]
        if register == reg.STATUS_REG:
            return [(reg.STATUS_POWER_ON if self._powered else 0) | self._index_seen << reg.STATUS_INDEX_SHIFT]
        if register == reg.DISCRETE_REG:
            return [self._outputs | (reg.IN_EMERGENCY_STOP_CLOSED if self._chain_closed else 0) << 8]
        if register == reg.ADC_VALUE:
            return [self._adc_word]
        if reg.ENC_INDEX_BASE <= register < reg.STATUS_REG:
            joint = register // reg.STEP
            self._index_seen &= ~(1 << joint)
            return [self._index_words[joint]]
        return [0] * count

    def write(self, register: int, words: Sequence[int]) -> None:
        """See `CardBus.write`."""
        if self._silent:
            return
        if register == reg.DAC_BASE:
            self._words[:] = words
            self._words &= reg.DAC_FULL
        elif register == reg.DISCRETE_REG:
            self._set_outputs(words[0])
        elif register == reg.ADC_MUX_SELECT:
            self._adc_channel = words[0] % reg.JOINTS
        elif register == reg.ADC_START:
            self._adc_word = self._convert()
        elif reg.ENC_LOAD_BASE <= register < reg.ADC_MUX_SELECT:
            joint = (register - reg.ENC_LOAD_BASE) // reg.STEP
            self._offset[joint] = words[0] - self._absolute[joint]

    def wait(self, duration_s: float) -> float:
        """See `CardBus.wait`: the arm moves under the torques that the converters hold."""
        passed = duration_s + self._stall_s
        self._stall_s = 0.0
        left = passed
        while left > 1e-12:
            # A stalled computer does not stop the card's own time: the watchdog counts in steps of one period.
            part = min(duration_s, left)
            self._let_pass(part)
            left -= part
        self._clock.advance(passed)
        return passed

    def look_again(self) -> None:
        """Count where the arm is now, after it was put somewhere without time passing."""
        self._count()

    @property
    def undisturbed(self) -> bool:
        """Whether nothing but time will pass at the next ticks: power on, brakes off, no fault in the way of them."""
        released = bool(self._outputs & reg.OUT_BRAKE_RELEASE)
        return self._powered and released and not self._silent and self._stall_s == 0.0

    @property
    def memory(self) -> CardMemory:
        """The card's own arrays, for a loop that takes the ticks in its place; see `has_run`."""
        return CardMemory(
            self._zero,
            self._motor_from_joint,
            self._per_count,
            self._torque_per_word,
            self._torque,
            self._absolute,
            self._offset,
            self._frozen,
            self._before,
            self._phase,
            self._turn,
        )

    def has_run(self, ticks: int, period_s: float, words: IntArray, passed: bool) -> None:
        """Take over what a loop over `memory` has done: its last converter words (J,), whether an index was passed."""
        self._words[:] = words
        self._unfed_s = period_s
        self._outputs ^= reg.OUT_WATCHDOG * (ticks % 2)
        if passed:
            self._latch()
        self._clock.advance(ticks * period_s)

    # Faults ------------------------------------------------------------------------------------------------------

    def stick_encoder(self, joint: int) -> None:
        """Joint 1 to 6: its counter stays where it is from now on."""
        self._frozen[joint - 1] = self._counters()[joint - 1]

    def mend_encoders(self) -> None:
        """All counters count again."""
        self._frozen[:] = -1

    def lose_amplifier(self, motor: int) -> None:
        """Motor 1 to 6 gets no current any more, whatever its converter says."""
        self._torque_per_word[:, motor - 1] = 0.0

    def open_emergency_stop(self) -> None:
        """Somebody pushes the button: the card loses arm power."""
        self._chain_closed = False
        self._cut()

    def close_emergency_stop(self) -> None:
        """The button is pulled out again; power stays off until it is switched on."""
        self._chain_closed = True

    def stall(self, duration_s: float) -> None:
        """The computer will miss this much time at its next tick."""
        self._stall_s = duration_s

    def go_silent(self, silent: bool = True) -> None:
        """The card no longer answers, as if it had been pulled out."""
        self._silent = silent

    # Inside ------------------------------------------------------------------------------------------------------

    def _count(self) -> None:
        absolute_counts(self._plant.position_rad, self._zero, self._motor_from_joint, self._per_count, self._absolute)

    def _counters(self) -> list[int]:
        shown_words(self._absolute, self._offset, self._frozen, self._shown)
        found: list[int] = self._shown.tolist()
        return found

    def _set_outputs(self, word: int) -> None:
        if (word ^ self._outputs) & reg.OUT_WATCHDOG:
            self._unfed_s = 0.0
        switched_on = word & ~self._outputs & reg.OUT_ARM_POWER
        self._outputs = word
        if switched_on and self._chain_closed:
            self._powered = True
            self._unfed_s = 0.0
        if not word & reg.OUT_ARM_POWER:
            self._powered = False
        self._brake()

    def _brake(self) -> None:
        applied = not (self._powered and self._outputs & reg.OUT_BRAKE_RELEASE)
        if applied != self._plant.brakes_on:
            self._plant.brakes_on = applied

    def _cut(self) -> None:
        self._powered = False
        self._outputs &= ~(reg.OUT_ARM_POWER | reg.OUT_BRAKE_RELEASE)
        self._brake()

    def _let_pass(self, duration_s: float) -> None:
        if self._powered:
            joint_torques(self._words, self._torque_per_word, self._torque)
            self._unfed_s += duration_s
        else:
            self._torque[:] = 0.0
        self._plant.step(self._torque, duration_s)
        self._before[:] = self._absolute
        self._count()
        if passed_index(self._before, self._absolute, self._phase, self._turn):
            self._latch()
        if self._powered and self._unfed_s > self._parameters.watchdog_s:
            self._cut()

    def _latch(self) -> None:
        for j in range(reg.JOINTS):
            low, high = sorted((int(self._before[j]), int(self._absolute[j])))
            turn, phase = int(self._turn[j]), int(self._phase[j])
            index = phase + turn * ((high - phase) // turn)
            if low < index <= high:
                self._index_words[j] = (index + int(self._offset[j])) & 0xFFFF
                self._index_seen |= 1 << j

    def _convert(self) -> int:
        pots = self._parameters.potentiometers
        angle = float(self._absolute[self._adc_channel] * self._per_count[self._adc_channel])
        volts = 2.5 + pots.volt_per_rad * angle + pots.bend_v * np.sin(angle * np.pi / 2.0)
        volts += pots.noise_v * self._rng.standard_normal()
        return round(float(volts) / reg.ADC_VOLT_PER_LSB) & reg.ADC_MASK


@compiled
def absolute_counts(
    q: FloatArray, zero: FloatArray, motor_from_joint: FloatArray, per_count: FloatArray, counts: IntArray
) -> None:
    """Write the absolute counts (J,) of the motors at joints (J,).

    `q` and `zero` (J,) in rad, `motor_from_joint` (J, J), `per_count` (J,) in rad; rounded to the nearest count.
    """
    for i in range(q.shape[0]):
        motor = 0.0
        for j in range(q.shape[0]):
            motor += motor_from_joint[i, j] * (q[j] - zero[j])
        counts[i] = int(np.floor(motor / per_count[i] + 0.5))


@compiled
def shown_words(absolute: IntArray, offset: IntArray, frozen: IntArray, words: IntArray) -> None:
    """Write what the 16-bit counters (J,) show; those that are stuck show what they did.

    `absolute` and `offset` (J,) in counts, `frozen` (J,) the word that a stuck counter shows, -1 where none is stuck;
    `words` (J,) from 0 to 65535 are written.
    """
    for j in range(words.shape[0]):
        words[j] = frozen[j] if frozen[j] >= 0 else (absolute[j] + offset[j]) & 0xFFFF


@compiled
def joint_torques(words: IntArray, torque_per_word: FloatArray, torque: FloatArray) -> None:
    """Write the joint torques (J,) of converter words (J,).

    In Nm; `torque_per_word` (J, J) in Nm holds the coupling of the wrist. The word `DAC_ZERO` gives none.
    """
    for i in range(torque.shape[0]):
        total = 0.0
        for j in range(torque.shape[0]):
            total += torque_per_word[i, j] * (words[j] - reg.DAC_ZERO)
        torque[i] = total


@compiled
def passed_index(before: IntArray, after: IntArray, phase: IntArray, turn: IntArray) -> bool:
    """Whether any motor has passed an index pulse.

    All (J,), in counts: the place at the tick before and now, the place of one pulse, and the counts of a turn.
    """
    for j in range(before.shape[0]):
        low, high = min(before[j], after[j]), max(before[j], after[j])
        if (high - phase[j]) // turn[j] != (low - phase[j]) // turn[j]:
            return True
    return False
