"""Ways to plan a joint move from one position to another, for drivers that are given one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from surfuse.interfaces import Kinematics
from surfuse.motion.jerk_limited import JerkLimitedMove
from surfuse.motion.limits import JointLimits
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.motion.time_optimal import PassParameters, time_optimal_pass
from surfuse.motion.torque_limits import within_torque
from surfuse.motion.trajectory import Trajectory
from surfuse.motion.trapezoid import TrapezoidalMove
from surfuse.records import FloatArray

Planner = Callable[[FloatArray, FloatArray], Trajectory]
LinePlanner = Callable[[FloatArray], tuple[Trajectory, FloatArray]]
"""Plans a motion from rest to rest through joint positions (N, J), and says when (N,) it is at each of them."""

_PLACES = 81  # of a move at which the speed of the tool is looked at
_PEAK = 1.02
_STEP_RAD = 1e-5  # of the difference quotients of the tool's place


@dataclass(frozen=True)
class Stretched:
    """A motion that takes `factor` times as long."""

    motion: Trajectory
    factor: float

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return self.factor * self.motion.duration_s

    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""
        position, speed, acceleration = self.motion.sample(np.asarray(t_s, dtype=np.float64) / self.factor)
        return position, speed / self.factor, acceleration / self.factor**2


def at_most(motion: Trajectory, set_share: float, wanted_share: float | None) -> Trajectory:
    """A motion that was planned with the share `set_share` of the speeds, with a smaller share where that is wanted."""
    if wanted_share is None or wanted_share >= set_share:
        return motion
    return Stretched(motion, set_share / wanted_share)


def within_tool_speed(planner: Planner, kinematics: Kinematics, tool_speed_m_s: float) -> Planner:
    """The same moves, slowed where the tool would be faster than this."""

    def plan(start_rad: FloatArray, end_rad: FloatArray) -> Trajectory:
        motion = planner(start_rad, end_rad)
        if tool_speed_m_s == np.inf:
            return motion
        t = np.linspace(0.0, motion.duration_s, _PLACES)
        # The mean between two places may hide a little of the peak.
        fastest = _PEAK * tool_speed(kinematics, t, motion.sample(t)[0])
        return motion if fastest <= tool_speed_m_s else Stretched(motion, fastest / tool_speed_m_s)

    return plan


def tool_speed(kinematics: Kinematics, t_s: FloatArray, joints_rad: FloatArray) -> float:
    """Highest mean speed (m/s) of the tool between joints (T, J) at times (T,)."""
    if len(t_s) < 2 or t_s[-1] <= t_s[0]:
        return 0.0
    places = kinematics.forward(joints_rad)[:, :3, 3]
    return float(np.max(np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(t_s)))


def through_lines(
    kinematics: Kinematics,
    limits: JointLimits,
    dynamics: ArmDynamics | None,
    tool_speed_m_s: float,
    torque_share: float = 0.75,
    ramp_s: float = 0.03,
) -> LinePlanner:
    """One motion through all points, as fast as tool speed, joint speeds and torques allow.

    Without `dynamics` the joint accelerations are limited instead of the torques.
    """
    parameters = PassParameters(torque_share, tool_speed_m_s, ramp_s=ramp_s)

    def plan(points_rad: FloatArray) -> tuple[Trajectory, FloatArray]:
        return time_optimal_pass(points_rad, dynamics, limits, partial(tool_jacobian, kinematics), parameters)

    return plan


def tool_jacobian(kinematics: Kinematics, joints_rad: FloatArray) -> FloatArray:
    """How the tool's place changes with the joints: joints (N, J) -> (N, 3, J), by central differences."""
    joints = np.atleast_2d(joints_rad)
    steps = _STEP_RAD * np.eye(joints.shape[1])
    around = np.concatenate([joints[:, None] + steps, joints[:, None] - steps], axis=1)
    places = kinematics.forward(around)[..., :3, 3]
    count = joints.shape[1]
    return np.asarray(np.swapaxes(places[:, :count] - places[:, count:], 1, 2) / (2.0 * _STEP_RAD))


def trapezoidal(limits: JointLimits) -> Planner:
    """Trapezoidal speed, published speed and acceleration limits."""

    def plan(start_rad: FloatArray, end_rad: FloatArray) -> Trajectory:
        return TrapezoidalMove(start_rad, end_rad, limits)

    return plan


def jerk_limited(limits: JointLimits, jerk_rad_s3: FloatArray) -> Planner:
    """Limited jerk (J,), too."""

    def plan(start_rad: FloatArray, end_rad: FloatArray) -> Trajectory:
        return JerkLimitedMove(start_rad, end_rad, limits, jerk_rad_s3)

    return plan


def slowed(limits: JointLimits, speed_share: float) -> JointLimits:
    """The limits with a share in (0, 1] of their speeds and accelerations."""
    return replace(
        limits,
        velocity_rad_s=speed_share * limits.velocity_rad_s,
        acceleration_rad_s2=speed_share * limits.acceleration_rad_s2,
    )


def torque_limited(
    dynamics: ArmDynamics,
    limits: JointLimits,
    torque_share: float = 0.75,
    ramp_s: float = 0.03,
    speed_share: float = 1.0,
) -> Planner:
    """As fast as `torque_share` of the motors' torque allows, acceleration built up over `ramp_s`.

    `speed_share` in (0, 1] is the share of the speed limits, and of the accelerations that the torque allows.
    """

    def plan(start_rad: FloatArray, end_rad: FloatArray) -> Trajectory:
        able = slowed(within_torque(dynamics, start_rad, end_rad, limits, torque_share), speed_share)
        return JerkLimitedMove(start_rad, end_rad, able, able.acceleration_rad_s2 / ramp_s)

    return plan
