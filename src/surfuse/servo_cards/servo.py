"""The joint servo: one tick reads the encoders, asks the control law, writes the converters, feeds the watchdog."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from surfuse.errors import DeviceError, SafetyStopError
from surfuse.motion.control_law import Commands, ControlLaw
from surfuse.records import FloatArray, IntArray
from surfuse.servo_cards import registers as reg
from surfuse.servo_cards.scales import CardScales, converter_words
from surfuse.servo_cards.supervision import (
    FINE,
    FOLLOWING,
    JUMP,
    OVERSPEED,
    STUCK,
    Supervision,
    measure,
)

_REST_TICKS = 20
_REST_LIMIT_S = 2.0
_HALT_S = 0.25
_SLOW_RAD_S = 0.02


class ServoMemory(NamedTuple):
    """All that the servo of J joints works with, as a loop takes it. `torque` and what follows it move on in place.

    `constants`, `joint_from_motor`, `counters`, `motion` and `anchor`: see `measure`. `motor_torque` (J, J) is the
    transpose of the wrist's coupling, `counts_per_nm` (J,) the scale of the converters, `torque` (J,) in Nm is that of
    the last tick; `read_words` (J,) are the counters as the card showed them, `written_words` (J,) what the converters
    got.
    """

    constants: FloatArray
    joint_from_motor: FloatArray
    motor_torque: FloatArray
    counts_per_nm: FloatArray
    torque: FloatArray
    counters: IntArray
    motion: FloatArray
    anchor: FloatArray
    read_words: IntArray
    written_words: IntArray


@dataclass(frozen=True)
class Ran:
    """What a `TickLoop` did: ticks, supervision's verdict (about the tick after them), whether all joints arrived.

    `code` is `FINE` or as `measure` gives it.
    """

    ticks: int
    code: int = FINE
    arrived: bool = False


class TickLoop(Protocol):
    """Runs many ticks at once where it can, to the same numbers as `JointServo.tick`."""

    def __call__(self, servo: JointServo, commands: Commands, first: int, until: SettleGoal | None) -> Ran:
        """Run ticks from number `first` on, the last command again and again if there is something to arrive at."""


@dataclass
class SettleGoal:
    """Every joint within `within_rad` of its target for `in_a_row` ticks; `seen` counts them, `left` is the rest."""

    within_rad: float
    in_a_row: int
    left: int
    seen: int = 0


class JointServo:
    """The servo loop over one card. It knows where the joints are once `set_position` has been called.

    `loop` runs ticks faster than one by one, if there is one.
    """

    def __init__(
        self,
        bus: reg.CardBus,
        scales: CardScales,
        law: ControlLaw,
        supervision: Supervision,
        loop: TickLoop | None = None,
    ) -> None:
        joints = reg.JOINTS
        self._bus = bus
        self._law = law
        self._loop = loop
        self._scales = scales
        self._supervision = supervision
        self.memory = ServoMemory(
            constants=supervision.constants(scales, law.period_s),
            joint_from_motor=np.ascontiguousarray(scales.joint_from_motor),
            motor_torque=np.ascontiguousarray(scales.joint_from_motor.T),
            counts_per_nm=np.asarray(scales.counts_per_nm),
            torque=np.zeros(joints),
            counters=np.zeros((2, joints), dtype=np.int64),
            motion=np.zeros((2, joints)),
            anchor=np.zeros((4, joints)),
            read_words=np.zeros(joints, dtype=np.int64),
            written_words=np.full(joints, reg.DAC_ZERO, dtype=np.int64),
        )
        counters, motion = self.memory.counters, self.memory.motion
        self._last_words: IntArray = counters[0]
        self._counts: IntArray = counters[1]
        self._position: FloatArray = motion[0]
        self._velocity: FloatArray = motion[1]
        self._anchor, self._torque = self.memory.anchor, self.memory.torque
        self._outputs = 0
        self._still = np.zeros(joints)
        self.stopped_because = "the power has not been switched on"

    @property
    def position_rad(self) -> FloatArray:
        """Measured joint angles (J,) of the last tick."""
        return self._position.copy()

    @property
    def torque_nm(self) -> FloatArray:
        """Joint torques (J,) asked for at the last tick."""
        return self._torque.copy()

    @property
    def running(self) -> bool:
        """Whether the arm is under power and control."""
        return not self.stopped_because

    def connect(self) -> None:
        """Look for the card and take its counters as they are.

        Raises
        ------
        DeviceError : no card answers.
        """
        self._check_present(self._bus.read(reg.STATUS_REG)[0])
        self._outputs = 0
        self._write_safe()
        self._last_words[:] = self._bus.read(reg.ENC_COUNT_BASE, reg.JOINTS)

    def set_position(self, joints_rad: FloatArray) -> None:
        """Say where the joints (J,) are now: from calibration, or from knowledge.

        In rad. The speeds are 0 from then on.
        """
        self._last_words[:] = self._bus.read(reg.ENC_COUNT_BASE, reg.JOINTS)
        self._counts[:] = np.rint(self._scales.counts(joints_rad)).astype(np.int64)
        self._position[:] = self._scales.joints(self._counts)
        self._velocity[:] = 0.0

    def read_position(self) -> FloatArray:
        """Measured joint angles (J,) now, with or without power."""
        self._observe(self._position)
        return self.position_rad

    def power_on(self) -> FloatArray:
        """Switch the power on, release the brakes and hold the arm where it is; returns that position (J,).

        Raises
        ------
        DeviceError : the card does not give power, for example because the emergency stop is pushed.
        """
        here = self.read_position()
        self._velocity[:] = 0.0
        # Nothing is known yet of the torque that carries the arm: the first ticks find out.
        self._torque[:] = np.nan
        self._anchor[:] = here, self._torque, self._still, self._still
        self._law.reset()
        self._outputs = reg.OUT_ARM_POWER
        self._bus.write(reg.DISCRETE_REG, [self._outputs])
        status = self._bus.read(reg.STATUS_REG)[0]
        self._check_present(status)
        if not status & reg.STATUS_POWER_ON:
            self._outputs = 0
            self._write_safe()
            closed = self._bus.read(reg.DISCRETE_REG)[0] >> 8 & reg.IN_EMERGENCY_STOP_CLOSED
            why = "the card gives no arm power" if closed else "the emergency stop is pushed"
            raise DeviceError(why, cure="check the arm's power" if closed else "release it, then switch on again")
        self.stopped_because = ""
        # One tick with the brakes on, so that the motors carry the arm before the brakes let go.
        self.tick(here, self._still, self._still)
        self._anchor[1] = self._torque
        self._outputs |= reg.OUT_BRAKE_RELEASE
        self.hold(here, 1)
        return here

    def power_off(self) -> None:
        """Cut the power; the brakes close."""
        self._outputs = 0
        self._write_safe()
        self.stopped_because = self.stopped_because or "the power has been switched off"

    def rest(self) -> None:
        """Forget speeds and integrators: the arm is known to stand still where its counters are now."""
        self._observe(self._position)
        self._law.reset()
        self._velocity[:] = 0.0

    def hold(self, joints_rad: FloatArray, ticks: int) -> None:
        """Stay at joints (J,) for some ticks."""
        if self._loop is not None and ticks > 1:
            still = np.zeros((ticks, len(self._still)))
            self.run(Commands(still + joints_rad, still, still))
            return
        for _ in range(ticks):
            self.tick(joints_rad, self._still, self._still)

    def hold_until(self, joints_rad: FloatArray, arrival: SettleGoal) -> bool:
        """Stay at joints (J,) until every joint has arrived there, or the time for it is over; says which."""
        commands = Commands(joints_rad[None].copy(), self._still[None], self._still[None])
        while arrival.left > 0:
            if self._run_fast(commands, 0, arrival).arrived:
                return True
            if arrival.left > 0:
                self.tick(joints_rad, self._still, self._still)
                arrival.left -= 1
                near = float(np.abs(joints_rad - self._position).max()) <= arrival.within_rad
                arrival.seen = arrival.seen + 1 if near else 0
                if arrival.seen >= arrival.in_a_row:
                    return True
        return False

    def run(self, commands: Commands) -> None:
        """Follow commands tick by tick.

        Raises
        ------
        SafetyStopError : supervision stopped the arm; it is at rest, power off, brakes on.
        DeviceError : the card does not answer.
        """
        done = 0
        while done < len(commands):
            done += self._run_fast(commands, done, None).ticks
            if done < len(commands):
                self.tick(
                    commands.position_rad[done], commands.velocity_rad_s[done], commands.acceleration_rad_s2[done]
                )
                done += 1

    def _run_fast(self, commands: Commands, first: int, until: SettleGoal | None) -> Ran:
        """As many ticks as the loop can do at once, perhaps none."""
        if self._loop is None:
            return Ran(0)
        ran = self._loop(self, commands, first, until)
        self._outputs ^= reg.OUT_WATCHDOG * (ran.ticks % 2)
        if ran.code != FINE:
            row = min(first + ran.ticks, len(commands) - 1)
            self._stop(self._describe(ran.code, commands.position_rad[row]))
        return ran

    @property
    def law(self) -> ControlLaw:
        """The control law."""
        return self._law

    def tick(self, wanted_rad: FloatArray, wanted_rad_s: FloatArray, wanted_rad_s2: FloatArray) -> None:
        """One period of the servo.

        Wanted joints (J,) in rad, speeds in rad/s, accelerations in rad/s^2. Looks at the counters first, so that a
        limit is judged before any torque goes out; then waits for the rest of the period.

        Raises
        ------
        SafetyStopError : supervision has found a limit broken, the power is gone, or the heartbeat was late; the
            power is off then.
        """
        bus = self._bus
        status = bus.read(reg.STATUS_REG)[0]
        if status == reg.NO_CARD or not status & reg.STATUS_POWER_ON:
            self._power_is_gone(status)
        code = self._observe(wanted_rad)
        if code != FINE:
            self._stop(self._describe(code, wanted_rad))
        law_torque = self._torque
        self._law.torque(wanted_rad, wanted_rad_s, wanted_rad_s2, self._position, self._velocity, law_torque)
        words = self.memory.written_words
        converter_words(law_torque, self.memory.motor_torque, self.memory.counts_per_nm, words)
        bus.write(reg.DAC_BASE, words.tolist())
        self._outputs ^= reg.OUT_WATCHDOG
        bus.write(reg.DISCRETE_REG, (self._outputs,))
        passed = bus.wait(self._law.period_s)
        if passed > self._supervision.late_share * self._law.period_s:
            self._stop(
                f"the servo's heartbeat was lost: {1e3 * passed:.1f} ms between two ticks, at most "
                f"{1e3 * self._supervision.late_share * self._law.period_s:.1f} ms"
            )

    def halt(self, why: str) -> None:
        """Emergency stop with the motors' help: brakes on, all joints braked by their motors, then power off.

        A stop of category 1 (IEC 60204-1): the wrist has no brakes, and without power it would run out against its
        friction. Where that fails, the power is off at once. No error; the next motion is refused.
        """
        if self.running:
            self._outputs &= ~reg.OUT_BRAKE_RELEASE
            slow, waited = 0, 0.0
            # Supervision has cut the power itself when it raises.
            with suppress(SafetyStopError):
                while slow < _REST_TICKS and waited < _HALT_S:
                    # Wanted where it is, at rest: nothing is left of the law but its damping and the arm's weight.
                    self.tick(self._position.copy(), self._still, self._still)
                    waited += self._law.period_s
                    slow = slow + 1 if np.max(np.abs(self._velocity)) < _SLOW_RAD_S else 0
        self.stop(why)

    def stop(self, why: str) -> None:
        """Emergency stop: power off, brakes on, wait until the arm rests. No error; the next motion is refused."""
        self._outputs = 0
        self._write_safe()
        self.stopped_because = why
        self._wait_for_rest()

    def _stop(self, why: str) -> None:
        self.stop(why)
        raise SafetyStopError(f"{why}; power is off, brakes are on", cure="find the cause, then switch on again")

    def _observe(self, wanted_rad: FloatArray) -> int:
        constants, coupling, _, _, torque, counters, motion, anchor, words, _ = self.memory
        words[:] = self._bus.read(reg.ENC_COUNT_BASE, reg.JOINTS)
        return measure(words, constants, coupling, wanted_rad, torque, counters, motion, anchor)

    def _write_safe(self) -> None:
        self._bus.write(reg.DAC_BASE, [reg.DAC_ZERO] * reg.JOINTS)
        self._bus.write(reg.DISCRETE_REG, [self._outputs])

    def _wait_for_rest(self) -> None:
        """Let the arm come to rest under its brakes, counters followed all the way."""
        quiet, waited = 0, 0.0
        while quiet < _REST_TICKS and waited < _REST_LIMIT_S:
            waited += self._bus.wait(self._law.period_s)
            before = self._counts.copy()
            self._observe(self._position)
            quiet = quiet + 1 if np.array_equal(before, self._counts) else 0
        self._velocity[:] = 0.0

    def _check_present(self, status: int) -> None:
        if status == reg.NO_CARD:
            self.stopped_because = "the servo card does not answer"
            raise DeviceError(
                f"the servo card does not answer: status register {reg.STATUS_REG:#04x} reads {status:#06x}",
                cure="check that the card sits in its slot and its address is right",
            )

    def _power_is_gone(self, status: int) -> None:
        self._check_present(status)
        if not self.running:
            raise SafetyStopError(f"the arm is stopped: {self.stopped_because}", cure="switch on again")
        closed = self._bus.read(reg.DISCRETE_REG)[0] >> 8 & reg.IN_EMERGENCY_STOP_CLOSED
        self._stop(
            "the card's watchdog was not fed in time and cut the arm power"
            if closed
            else "the emergency stop was pushed"
        )

    def _describe(self, code: int, wanted_rad: FloatArray) -> str:
        """A supervision code in words: kind, joint, value, limit."""
        kind, j = code // 16, code % 16
        limits = self._supervision
        off = np.degrees(wanted_rad[j] - self._position[j])
        if kind == FOLLOWING:
            limit = np.degrees(limits.following_rad)
            return f"following error of joint {j + 1} is {off:.2f} deg, its limit is {limit:.2f} deg"
        if kind == STUCK:
            return (
                f"encoder of joint {j + 1} stands still at {np.degrees(self._position[j]):.2f} deg while the joint was "
                f"told to move {np.degrees(abs(wanted_rad[j] - self._anchor[0, j])):.2f} deg (at most "
                f"{np.degrees(limits.stuck_rad):.2f}) and its torque changed by "
                f"{abs(self._torque[j] - self._anchor[1, j]):.1f} N m (friction and load hold {limits.stuck_nm[j]:.1f})"
            )
        if kind == JUMP:
            return (
                f"encoder of joint {j + 1} jumped by more than {limits.jump_counts} counts in one tick, "
                f"at most {limits.jump_counts} are possible"
            )
        assert kind == OVERSPEED
        return (
            f"joint {j + 1} turns at {np.degrees(self._velocity[j]):.0f} deg/s, its limit is "
            f"{np.degrees(limits.speed_max_rad_s[j]):.0f} deg/s"
        )
