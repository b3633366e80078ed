"""An arm behind TRC004 servo cards: joints are driven by torques at 1 kHz, positions come from encoder counters."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.interfaces import GIVEN_BY_RIG, Kinematics, surrounded
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.control_law import Commands, ControlLaw
from surfuse.motion.limits import check_position, check_velocity
from surfuse.motion.planners import Planner, at_most
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray, JointSamples, JointState
from surfuse.servo_cards.calibration import Calibration, calibrate
from surfuse.servo_cards.registers import CardBus
from surfuse.servo_cards.scales import STANDARD_SCALES, CardScales
from surfuse.servo_cards.servo import JointServo, SettleGoal, TickLoop
from surfuse.servo_cards.supervision import STANDARD_SUPERVISION, Supervision

_TICKS_PER_SAMPLE = 4  # of a motion that is run tick by tick

STANDARD_CALIBRATION = Calibration()
SUMMARY = "a PUMA 560 or its like behind TRC004 servo cards"


@dataclass(frozen=True, kw_only=True)
class Surroundings(ArmSurroundings):
    """The card, and what moves the arm behind it.

    `law` is the control law, `planner` plans a motion between two joint positions (J,). `standing_rad` (J,) is where
    the arm is known to stand when it is opened (None: it calibrates itself). `loop` runs the servo's ticks faster than
    one by one, for a card in software.
    """

    bus: CardBus
    law: ControlLaw
    planner: Planner
    standing_rad: FloatArray | None = None
    loop: TickLoop | None = None


@dataclass(frozen=True)
class Parameters:
    """How the arm comes to rest, and what stops it.

    `settle_rad`: a joint nearer to its target than this has arrived. `settle_ticks`: for how many ticks in a row all
    joints must have. `settle_timeout_s`: longest wait for that. `rest_s`: further rest after it.
    `speed_share`: share in (0, 1] of the joint speeds that the planner was made with.
    `scales`, `supervision`, `calibration`: what was measured on the arm and its cards.
    """

    settle_rad: float = 2e-4
    settle_ticks: int = 20
    settle_timeout_s: float = 3.0
    rest_s: float = 0.0
    speed_share: float = 1.0
    scales: CardScales = STANDARD_SCALES
    supervision: Supervision = STANDARD_SUPERVISION
    calibration: Calibration = STANDARD_CALIBRATION
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        for name in ("settle_rad", "settle_timeout_s"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a positive value")
        if not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        if self.settle_ticks < 1:
            raise ConfigError(f"settle_ticks = {self.settle_ticks}", cure="give 1 or more")
        if not (np.isfinite(self.rest_s) and self.rest_s >= 0.0):
            raise ConfigError(f"rest_s = {self.rest_s}", cure="give a time of 0 s or more")


class TridentArm:
    """Joints driven by torques; it calibrates itself when it is opened, unless it is told where it stands."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        law, limits = surroundings.law, surroundings.limits
        self._kinematics = surroundings.kinematics
        self._bus = surroundings.bus
        self._clock = surroundings.clock
        self._limits = limits
        self._law = law
        self._planner = surroundings.planner
        self._standing_rad = surroundings.standing_rad
        self._parameters = parameters
        self._guard = surroundings.guard
        self._servo = JointServo(self._bus, parameters.scales, law, parameters.supervision, surroundings.loop)
        self._target_rad = np.full(len(limits), np.nan)
        self._motion: Commands | None = None
        self._next = 0
        self._samples: list[tuple[float, FloatArray]] = []

    def __enter__(self) -> Self:
        self._servo.connect()
        if self._standing_rad is None:
            known = self._parameters
            self._target_rad = calibrate(self._bus, self._servo, self._law, known.scales, known.calibration)
        else:
            self._servo.set_position(self._standing_rad)
            self._target_rad = self._servo.power_on()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and self._motion is not None:
            # Something else failed while the arm was on its way.
            self._servo.halt("the program ended in mid-motion")
        self._servo.power_off()

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    @property
    def servo(self) -> JointServo:
        """The servo loop, for studies of the motion itself."""
        return self._servo

    @property
    def target_rad(self) -> FloatArray:
        """Where the arm was last told to be (J,)."""
        return self._target_rad.copy()

    def joint_state(self) -> JointState:
        """What the encoders show, in whole counts."""
        return JointState(self._servo.read_position(), self._clock.now_s())

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there and settle; `speed_share` as in `Arm`: the motion of the planner, stretched.

        Raises
        ------
        SafetyStopError : the target is outside a limit or the guard refuses the way, and the arm has not moved; or
            supervision stopped the arm on the way (at rest, power off, brakes on).
        DeviceError : the card does not answer, or a joint did not settle.
        """
        check_position(joints_rad, self._limits)
        self._check_running()
        target = np.array(joints_rad, dtype=np.float64)
        if self._guard is not None:
            self._guard(self._target_rad, target)
        self.follow(at_most(self._planner(self._target_rad, target), self._parameters.speed_share, speed_share))
        self.settle()
        return self.joint_state()

    def follow(self, trajectory: Trajectory) -> None:
        """Run a motion that begins where the arm is, without waiting for it to settle.

        Raises
        ------
        SafetyStopError, DeviceError : as `move_to`.
        """
        self._check_running()
        commands = self._checked(trajectory)
        if len(commands):
            self._target_rad = commands.position_rad[-1].copy()
            self._servo.run(commands)

    def begin(self, trajectory: Trajectory) -> float:
        """Make a motion ready to be run tick by tick with `run_until`, and return the time at which it begins.

        The card's watchdog must be fed all the while: a real cell calls `run_until` from a thread that does nothing
        else.

        Raises
        ------
        SafetyStopError : the motion does not begin where the arm is or breaks a limit, or the arm is stopped.
        """
        self._check_running()
        begin = trajectory.sample([0.0])[0][0]
        off = np.abs(begin - self._target_rad)
        if not np.all(off <= self._parameters.settle_rad):
            j = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
            raise SafetyStopError(
                f"the motion begins with joint {j + 1} at {np.degrees(begin[j]):.3f} deg, the arm stands at "
                f"{np.degrees(self._target_rad[j]):.3f} deg",
                cure="move to where it begins first",
            )
        self._motion, self._next, self._samples = self._checked(trajectory), 0, []
        return self._clock.now_s()

    def run_until(self, t_s: float) -> None:
        """Run the ticks of the motion that end by this time of the clock; after its end the arm is held there.

        Raises
        ------
        SafetyStopError, DeviceError : as `move_to`.
        """
        if self._motion is None:
            return
        period, motion = self._law.period_s, self._motion
        while self._clock.now_s() + period <= t_s + 1e-9:
            self._tick_of(motion)

    def samples_since(self, t_s: float) -> JointSamples:
        """Encoder samples of the motion, from the last one at or before a time until the tick that has just ended."""
        first = max((i for i, (at, _) in enumerate(self._samples) if at <= t_s), default=0)
        kept = self._samples[first:]
        if not kept:
            return JointSamples(np.zeros(0), np.zeros((0, len(self._limits))))
        return JointSamples(np.array([at for at, _ in kept]), np.array([joints for _, joints in kept]))

    def finish(self) -> JointState:
        """Run what is left of the motion and settle, without further rest.

        Raises
        ------
        SafetyStopError, DeviceError : as `move_to`.
        """
        self._check_running()
        if self._motion is not None:
            while self._next < len(self._motion):
                self._tick_of(self._motion)
            self._target_rad, self._motion = self._end_of(self._motion), None
        self.settle(0.0)
        return self.joint_state()

    def _tick_of(self, motion: Commands) -> None:
        """One tick of a motion, or of the rest after it; the encoders are read at its beginning."""
        now_s, i = self._clock.now_s(), self._next
        if i < len(motion):
            self._servo.tick(motion.position_rad[i], motion.velocity_rad_s[i], motion.acceleration_rad_s2[i])
        else:
            self._servo.hold(self._end_of(motion), 1)
        # The sample of the last tick is always there; only every so many stay.
        if self._samples and (i - 1) % _TICKS_PER_SAMPLE:
            self._samples.pop()
        self._samples.append((now_s, self._servo.position_rad))
        self._next += 1

    def _end_of(self, motion: Commands) -> FloatArray:
        return motion.position_rad[-1].copy() if len(motion) else self._target_rad

    def _checked(self, trajectory: Trajectory) -> Commands:
        """A motion as the control law is told it, within the limits of the joints."""
        commands = self._law.commands(trajectory)
        if len(commands):
            for end in (commands.position_rad.min(axis=0), commands.position_rad.max(axis=0)):
                check_position(end, self._limits)
            check_velocity(commands.velocity_rad_s, self._limits)
        return commands

    def settle(self, rest_s: float | None = None) -> None:
        """Hold the target until every joint is there and stays, and then for a further rest (None: the usual one).

        Raises
        ------
        DeviceError : a joint did not arrive in time.
        """
        period, wanted = self._law.period_s, self._parameters
        most = int(wanted.settle_timeout_s / period)
        if self._servo.hold_until(self._target_rad, SettleGoal(wanted.settle_rad, wanted.settle_ticks, most)):
            self._servo.hold(self._target_rad, round((wanted.rest_s if rest_s is None else rest_s) / period))
            return
        off = np.abs(self._target_rad - self._servo.position_rad)
        j = int(np.argmax(off))
        raise DeviceError(
            f"joint {j + 1} is still {np.degrees(off[j]):.3f} deg from its target after {wanted.settle_timeout_s:g} s, "
            f"at most {np.degrees(wanted.settle_rad):.3f} deg",
            cure="allow more (arm.settle_deg), or take a control law that overcomes friction (arm.law)",
        )

    def emergency_stop(self, why: str = "emergency stop asked for by the program") -> JointState:
        """Bring all joints to rest at once and cut the power; returns where that is. Moves are refused until `recover`.

        See `JointServo.halt`.
        """
        self._servo.halt(why)
        return self.joint_state()

    def recover(self) -> JointState:
        """After a stop whose cause is gone: power on, hold where the arm is. The counters have not lost the position.

        Raises
        ------
        DeviceError : the card gives no power.
        """
        if not self._servo.running:
            self._target_rad = self._servo.power_on()
        return self.joint_state()

    def _check_running(self) -> None:
        if not self._servo.running:
            raise SafetyStopError(
                f"the arm is stopped: {self._servo.stopped_because}", cure="find the cause, then recover the arm"
            )


def create(parameters: Parameters) -> TridentArm:
    """An arm behind a servo card."""
    return TridentArm(parameters, surrounded(parameters.surroundings, "trident"))
