"""A kinematic arm in the twin: limits, trapezoidal move times, repeatability error, encoders of finite resolution.

Two joint positions exist at every moment. The true one is where the links are: target plus the error that the world
makes at this stop (`World.repeatability`: servo dead band, gears, elastic links). The measured one is what the
encoders show: the true one rounded to whole counts. So a log differs from the truth by half a count a joint at
most (0.03 mm at the tool), and reached and commanded positions differ by the repeatability.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, Kinematics, World, surrounded
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.limits import check_position
from surfuse.motion.planners import at_most, trapezoidal, within_tool_speed
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray, JointSamples, JointState

_SAMPLE_S = 4e-3  # between two encoder samples of a motion: a straight line between them is off by a dt^2 / 8
_SAME_RAD = 1e-6

SUMMARY = "an arm in the simulated rig, without dynamics"


@dataclass(frozen=True, kw_only=True)
class Surroundings(ArmSurroundings):
    """The world of the twin, and the joints (J,) at which the arm stands in the beginning."""

    world: World
    start_rad: FloatArray


@dataclass(frozen=True)
class Parameters:
    """How the simulated arm moves.

    `settle_s`: rest after each move, in s. `speed_share`: share in (0, 1] of the joint speeds and accelerations.
    `encoder_rad_per_count`: joint angle of one count, one value for every joint or one for each, in rad.
    `tool_speed_max_m_s`: moves that would be faster at the tool are slowed.
    """

    settle_s: float = 0.15
    speed_share: float = 1.0
    encoder_rad_per_count: tuple[float, ...] = (1e-4,)
    tool_speed_max_m_s: float = np.inf
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.settle_s) and self.settle_s >= 0.0):
            raise ConfigError(f"settle_s = {self.settle_s}", cure="give a time of 0 s or more")
        if not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        if not self.tool_speed_max_m_s > 0.0:
            raise ConfigError(f"tool_speed_max_m_s = {self.tool_speed_max_m_s}", cure="give a speed > 0 m/s")
        if not all(np.isfinite(count) and count > 0.0 for count in self.encoder_rad_per_count):
            raise ConfigError(
                f"encoder_rad_per_count = {self.encoder_rad_per_count}", cure="give positive angles in rad"
            )


class SimulatedArm(AlwaysOpen):
    """Moves in the time that its limits allow, and arrives with the error that the world makes."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        kinematics, limits, start_rad = surroundings.kinematics, surroundings.limits, surroundings.start_rad
        check_position(start_rad, limits)
        self._kinematics = kinematics
        self._world = surroundings.world
        self._clock = surroundings.clock
        self._limits = replace(
            limits,
            velocity_rad_s=parameters.speed_share * limits.velocity_rad_s,
            acceleration_rad_s2=parameters.speed_share * limits.acceleration_rad_s2,
        )
        self._parameters = parameters
        self._planner = within_tool_speed(trapezoidal(self._limits), kinematics, parameters.tool_speed_max_m_s)
        self._guard = surroundings.guard
        self._target_rad = np.array(start_rad, dtype=np.float64)
        self._true_rad = self._target_rad
        self._motion: Trajectory | None = None
        self._between_rad = np.zeros(len(self._target_rad))
        self._began_s = 0.0

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    @property
    def true_joints_rad(self) -> FloatArray:
        """Where the joints (J,) truly are: for simulated devices that ride on the arm, never for the log."""
        return np.asarray(self._true_at(np.array([self._clock.now_s()]))[0])

    def true_tool_pose(self) -> FloatArray:
        """`world_from_tool` (4, 4) at the true joints: for simulated devices that ride on the arm."""
        return self._kinematics.forward(self.true_joints_rad)

    def begin_stop(self) -> None:
        """Nothing to forget: a move of this arm has no history."""

    def joint_state(self) -> JointState:
        """What the encoders show, in whole counts."""
        return JointState(self._in_counts(self.true_joints_rad), self._clock.now_s())

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there and settle: the clock moves on by the time of the trapezoidal move and the rest after it.

        `speed_share` as in `Arm`: the same move, stretched.

        Raises
        ------
        SafetyStopError : the target is outside a limit, or the guard refuses the way; the arm has not moved.
        """
        check_position(joints_rad, self._limits)
        self._end_motion()
        target = np.array(joints_rad, dtype=np.float64)
        if self._guard is not None:
            self._guard(self._target_rad, target)
        # From target to target: the time of a move must not depend on the errors of the moves before it.
        motion = at_most(self._planner(self._target_rad, target), self._parameters.speed_share, speed_share)
        self._clock.advance(motion.duration_s + self._parameters.settle_s)
        self._target_rad = target
        self._true_rad = target + self._world.repeatability(len(target))
        return self.joint_state()

    def start(self, trajectory: Trajectory) -> float:
        """Begin a motion; see `MovingArm.start`. The error of the arm is the same all along it."""
        begin = trajectory.sample([0.0])[0][0]
        self._end_motion()
        off = np.abs(begin - self._target_rad)
        if not np.all(off <= _SAME_RAD):
            j = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
            raise SafetyStopError(
                f"the motion begins with joint {j + 1} at {np.degrees(begin[j]):.3f} deg, the arm stands at "
                f"{np.degrees(self._target_rad[j]):.3f} deg",
                cure="move to where it begins first",
            )
        self._between_rad = self._world.repeatability(len(begin))
        self._motion, self._began_s = trajectory, self._clock.now_s()
        return self._began_s

    def wait_until(self, t_s: float) -> None:
        """Let the clock run to this time."""
        self._clock.advance(max(0.0, t_s - self._clock.now_s()))

    def samples_since(self, t_s: float) -> JointSamples:
        """Encoder samples of this motion; see `MovingArm.samples_since`."""
        now_s = self._clock.now_s()
        first = max(0, int(np.floor((t_s - self._began_s) / _SAMPLE_S)))
        times = self._began_s + _SAMPLE_S * np.arange(first, (now_s - self._began_s) / _SAMPLE_S)
        # The last moment is sampled too, so that a reading that has just fired lies between two samples.
        times = np.append(times[times < now_s], now_s)
        return JointSamples(times, self._in_counts(self._true_at(times)))

    def finish(self) -> JointState:
        """Wait for the end of the motion; there is nothing to settle."""
        if self._motion is not None:
            self.wait_until(self._began_s + self._motion.duration_s)
            self._end_motion()
        return self.joint_state()

    def _end_motion(self) -> None:
        """The arm stands where its motion has brought it."""
        if self._motion is not None:
            now = np.array([self._clock.now_s() - self._began_s])
            self._target_rad = self._motion.sample(now)[0][0]
            self._true_rad = self._target_rad + self._between_rad
            self._motion = None

    def _true_at(self, t_s: FloatArray) -> FloatArray:
        """True joints (T, J) at times (T,) of the motion, or of the rest."""
        if self._motion is None:
            return np.tile(self._true_rad, (len(t_s), 1))
        return self._motion.sample(t_s - self._began_s)[0] + self._between_rad

    def _in_counts(self, joints_rad: FloatArray) -> FloatArray:
        count = np.asarray(self._parameters.encoder_rad_per_count)
        return np.asarray(np.round(joints_rad / count) * count)


def create(parameters: Parameters) -> SimulatedArm:
    """A simulated arm at rest."""
    return SimulatedArm(parameters, surrounded(parameters.surroundings, "simulated"))
