"""A kinematic arm in the twin: limits, trapezoidal move times, repeatability error, encoders of finite resolution.

Two joint positions exist at every moment. The true one is where the links are: target plus the error that the world
makes at this stop (`World.repeatability`: servo dead band, gears, elastic links). The measured one is what the
encoders show: the true one rounded to whole counts. So a log differs from the truth by half a count a joint at
most (0.03 mm at the tool), and reached and commanded positions differ by the repeatability.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import AlwaysOpen, Clock, Kinematics, World
from surfuse.motion.limits import JointLimits, check_position
from surfuse.motion.trapezoid import durations_s
from surfuse.records import FloatArray, JointState

Guard = Callable[[FloatArray, FloatArray], None]


@dataclass(frozen=True)
class Parameters:
    """How the simulated arm moves.

    `settle_s`: rest after each move, in s. `speed_share`: share in (0, 1] of the joint speeds and accelerations.
    `encoder_rad_per_count`: joint angle of one count, one value for every joint or one for each, in rad.
    """

    settle_s: float = 0.15
    speed_share: float = 1.0
    encoder_rad_per_count: tuple[float, ...] = (1e-4,)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.settle_s) and self.settle_s >= 0.0):
            raise ConfigError(f"settle_s = {self.settle_s}", cure="give a time of 0 s or more")
        if not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        if not all(np.isfinite(count) and count > 0.0 for count in self.encoder_rad_per_count):
            raise ConfigError(
                f"encoder_rad_per_count = {self.encoder_rad_per_count}", cure="give positive angles in rad"
            )


class SimulatedArm(AlwaysOpen):
    """See `create`."""

    def __init__(
        self,
        kinematics: Kinematics,
        world: World,
        clock: Clock,
        limits: JointLimits,
        start_rad: FloatArray,
        parameters: Parameters,
        guard: Guard | None,
    ) -> None:
        check_position(start_rad, limits)
        self._kinematics = kinematics
        self._world = world
        self._clock = clock
        self._limits = replace(
            limits,
            velocity_rad_s=parameters.speed_share * limits.velocity_rad_s,
            acceleration_rad_s2=parameters.speed_share * limits.acceleration_rad_s2,
        )
        self._parameters = parameters
        self._guard = guard
        self._target_rad = np.array(start_rad, dtype=np.float64)
        self._true_rad = self._target_rad

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    @property
    def true_joints_rad(self) -> FloatArray:
        """Where the joints (J,) truly are: for simulated devices that ride on the arm, never for the log."""
        return self._true_rad.copy()

    def true_tool_pose(self) -> FloatArray:
        """`world_from_tool` (4, 4) at the true joints: for simulated devices that ride on the arm."""
        return self._kinematics.forward(self._true_rad)

    def begin_stop(self) -> None:
        """Nothing to forget: a move of this arm has no history."""

    def joint_state(self) -> JointState:
        """What the encoders show, in whole counts."""
        count = np.asarray(self._parameters.encoder_rad_per_count)
        return JointState(np.round(self._true_rad / count) * count, self._clock.now_s())

    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Go there and settle: the clock moves on by the time of the trapezoidal move and the rest after it.

        Raises
        ------
        SafetyStopError : the target is outside a limit, or the guard refuses the way; the arm has not moved.
        """
        check_position(joints_rad, self._limits)
        target = np.array(joints_rad, dtype=np.float64)
        if self._guard is not None:
            self._guard(self._target_rad, target)
        # From target to target: the time of a move must not depend on the errors of the moves before it.
        duration = float(durations_s(self._target_rad, target, self._limits))
        self._clock.advance(duration + self._parameters.settle_s)
        self._target_rad = target
        self._true_rad = target + self._world.repeatability(len(target))
        return self.joint_state()


def create(
    kinematics: Kinematics,
    world: World,
    clock: Clock,
    limits: JointLimits,
    start_rad: FloatArray,
    parameters: Parameters = Parameters(),
    guard: Guard | None = None,
) -> SimulatedArm:
    """A simulated arm at joints `start_rad` (J,).

    `guard` is called with start and target joints before every move and raises `SafetyStopError` to refuse it (see
    `surfuse.motion.clearance.check_move`).
    """
    return SimulatedArm(kinematics, world, clock, limits, start_rad, parameters, guard)
