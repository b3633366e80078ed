"""Every motion is checked before it starts: joint limits, speeds, singularities, and all that it must not touch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.interfaces import Kinematics
from surfuse.motion.clearance import ClearanceModel, check_move
from surfuse.motion.limits import JointLimits, check_position, check_velocity, first_outside
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.planners import LinePlanner, tool_speed
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray

_ROUNDING = 1.0 + 1e-3  # limits that were imposed at grid points only are exceeded by as much between them
_SAMPLES_MAX = 20_000


@dataclass(frozen=True)
class GuardParameters:
    """What a motion must keep.

    `clearance_min_m`: least distance to obstacles and own links. `tool_speed_max_m_s`: highest speed of the tool.
    `singularity_min`: least distance to a singularity, in [0, 1], on motions that follow a path of the tool (a straight
    move in joint space may pass one: its joints are no faster there). `resolution_rad`: largest joint angle between the
    places that are looked at.
    """

    clearance_min_m: float = 0.005
    tool_speed_max_m_s: float = 1.0
    singularity_min: float = 0.05
    resolution_rad: float = 0.02

    def __post_init__(self) -> None:
        if not (np.isfinite(self.clearance_min_m) and self.clearance_min_m >= 0.0):
            raise ConfigError(f"clearance_min_m = {self.clearance_min_m}", cure="give 0 m or more")
        if not 0.0 <= self.singularity_min < 1.0:
            raise ConfigError(f"singularity_min = {self.singularity_min}", cure="give a share from 0 to below 1")
        for name in ("tool_speed_max_m_s", "resolution_rad"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a positive value")


class MotionGuard:
    """The check that an arm asks before each motion; what stands around it can change while the job goes on.

    `clearance` makes the collision check for a list of obstacles, `around` are those known from the start.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        limits: JointLimits,
        clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel],
        around: tuple[Obstacle, ...],
        parameters: GuardParameters = GuardParameters(),
    ) -> None:
        self._kinematics, self._limits, self._parameters = kinematics, limits, parameters
        self._make = clearance
        self._clearance = clearance(around)

    def surround(self, obstacles: tuple[Obstacle, ...]) -> None:
        """From now on these are the obstacles."""
        self._clearance = self._make(obstacles)

    def __call__(self, start_rad: FloatArray, end_rad: FloatArray) -> None:
        """Check a straight move in joint space.

        Both ends (J,) in rad, moved to along the straight line between them.

        Raises
        ------
        SafetyStopError : names joint or part, value and limit; nothing has moved.
        """
        for joints in (start_rad, end_rad):
            check_position(joints, self._limits)
        own = self._parameters
        check_move(self._clearance, start_rad, end_rad, own.clearance_min_m, own.resolution_rad)

    def check(self, trajectory: Trajectory) -> None:
        """Check a motion along a path.

        Raises
        ------
        SafetyStopError : names joint or part, value and limit; nothing has moved.
        """
        own, kinematics = self._parameters, self._kinematics
        t, joints, speed = self._sampled(trajectory)
        outside = first_outside(joints, self._limits)
        if np.any(outside >= 0):
            check_position(joints[int(np.argmax(outside >= 0))], self._limits)
        check_velocity(speed / _ROUNDING, self._limits)
        self._check_tool(t, joints)
        away = kinematics.singularity_distance(joints)
        # Written so that nan counts as too near.
        if not np.all(away >= own.singularity_min):
            worst = int(np.argmin(np.where(np.isnan(away), -1.0, away)))
            i, k = divmod(worst, away.shape[1])
            raise SafetyStopError(
                f"the motion comes within {away[i, k]:.3f} of the {kinematics.singularities[k]} singularity at "
                f"{np.degrees(joints[i]).round(1).tolist()} deg, at least {own.singularity_min:g} must be kept",
                cure="move the part, or choose another standoff",
            )
        gaps = self._clearance(joints)
        i = int(np.argmin(gaps.distance_m))
        if not gaps.distance_m[i] >= own.clearance_min_m:
            raise SafetyStopError(
                f"{gaps.describe(i)}, {t[i]:.2f} s into a motion of {t[-1]:.2f} s; at least "
                f"{1e3 * own.clearance_min_m:.0f} mm must be kept",
                cure="move the part, or scan stop by stop",
            )

    def checked(self, planner: LinePlanner) -> LinePlanner:
        """The same planner, whose motions are checked before they are handed on."""

        def plan(points_rad: FloatArray) -> tuple[Trajectory, FloatArray]:
            motion, at_s = planner(points_rad)
            self.check(motion)
            return motion, at_s

        return plan

    def _sampled(self, trajectory: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times (T,), positions and speeds (T, J), no joint turning further than the resolution in between."""
        if not np.isfinite(trajectory.duration_s):
            raise SafetyStopError(f"the motion takes {trajectory.duration_s} s", cure="give finite set points")
        coarse = np.linspace(0.0, trajectory.duration_s, 201)
        q, qd, _ = trajectory.sample(coarse)
        if not np.all(np.isfinite(q)) or not np.all(np.isfinite(qd)):
            raise SafetyStopError("the motion is not finite everywhere", cure="give finite set points")
        count = trajectory.duration_s * float(np.max(np.abs(qd))) / self._parameters.resolution_rad
        t = np.linspace(0.0, trajectory.duration_s, int(min(max(np.ceil(1.2 * count), 200), _SAMPLES_MAX)) + 1)
        return t, *trajectory.sample(t)[:2]

    def _check_tool(self, t: FloatArray, joints: FloatArray) -> None:
        limit = self._parameters.tool_speed_max_m_s
        fastest = tool_speed(self._kinematics, t, joints)
        if not fastest <= limit * _ROUNDING:
            raise SafetyStopError(
                f"the tool would move at {fastest:.2f} m/s, its limit is {limit:.2f} m/s",
                cure="lower scan.speed_m_s or arm.speed_share",
            )
