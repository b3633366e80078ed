"""One smooth pass through many joint positions, as fast as speeds and torques allow (Pham and Pham 2018)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.motion.limits import JointLimits
from surfuse.motion.path_law import PathLaw
from surfuse.motion.reachability import PathLimits, fastest_speeds
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray

_CHECKS_PER_POINT = 8
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class PassParameters:
    """`torque_share`: share of the torque limits to plan with. `tool_speed_m_s`: highest speed of the tool.

    `grid_per_point`: places per joint position at which limits are imposed. `ramp_s`: accelerations build up over this
    time, which bounds the jerk (0: they jump).
    """

    torque_share: float = 0.75
    tool_speed_m_s: float = 0.5
    grid_per_point: int = 4
    ramp_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.torque_share <= 1.0:
            raise ConfigError(f"torque_share = {self.torque_share}", cure="give a share above 0, at most 1")
        if not (np.isfinite(self.tool_speed_m_s) and self.tool_speed_m_s > 0.0):
            raise ConfigError(f"tool_speed_m_s = {self.tool_speed_m_s}", cure="give a speed > 0 m/s")
        if self.grid_per_point < 1:
            raise ConfigError(f"grid_per_point = {self.grid_per_point}", cure="give 1 or more")
        if not (np.isfinite(self.ramp_s) and 0.0 <= self.ramp_s <= 1.0):
            raise ConfigError(f"ramp_s = {self.ramp_s}", cure="give a time from 0 to 1 s")


class TimeOptimalPass:
    """See `time_optimal_pass`; `slowed` is the factor by which the pass was stretched in time.

    It is needed because the limits, imposed only at grid points, can be exceeded between them; 1 means not at all.
    """

    def __init__(self, spline: CubicSpline, law: PathLaw, slowed: float = 1.0) -> None:
        self._spline = spline
        self._law = law
        self.slowed = slowed

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return self._law.duration_s * self.slowed

    def times_s(self, parameter: FloatArray) -> FloatArray:
        """When the pass is at each path parameter (N,)."""
        return self.slowed * self._law.times_s(parameter)

    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""
        at, rate, push = self._law.sample(np.ravel(np.asarray(t_s, dtype=np.float64)) / self.slowed)
        rate, push = (rate / self.slowed)[:, None], (push / self.slowed**2)[:, None]
        along, bend = self._spline(at, 1), self._spline(at, 2)
        return self._spline(at), along * rate, bend * rate**2 + along * push


def time_optimal_pass(
    points_rad: FloatArray,
    dynamics: ArmDynamics | None,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters = PassParameters(),
) -> tuple[TimeOptimalPass, FloatArray]:
    """The fastest smooth motion through joint positions (N, J), and the time (N,) at which it is at each of them.

    The path is a cubic spline, straight joint-space distance as parameter. `jacobian` maps joints (N, J) to (N, 6, J)
    in world axes. Limits are joint speeds, torques (friction included; for an arm of unknown dynamics its joint
    accelerations instead) and the speed of the tool.

    Raises
    ------
    SafetyStopError : there is no such motion, for example because a posture cannot be held.
    """
    points = np.asarray(points_rad, dtype=np.float64)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 2 or not np.all(np.isfinite(points)) or np.any(step <= 0.0):
        raise ConfigError(f"a pass through {len(points)} joint positions", cure="give two or more, finite, no repeats")
    at = np.concatenate([[0.0], np.cumsum(step)])
    spline = CubicSpline(at, points, bc_type="clamped" if len(points) > 2 else "natural")
    grid = _refined(at, parameters.grid_per_point)
    speed = _path_speeds(spline, grid, dynamics, limits, jacobian, parameters)
    law = PathLaw(grid, speed, parameters.ramp_s)
    planned = TimeOptimalPass(spline, law)
    checks = len(grid) * _CHECKS_PER_POINT
    slowed = _excess(planned, checks, dynamics, limits, jacobian, parameters)
    planned = TimeOptimalPass(spline, law, slowed)
    return planned, planned.times_s(at)


def _refined(at: FloatArray, per_point: int) -> FloatArray:
    inner = np.linspace(at[:-1], at[1:], per_point, endpoint=False, axis=1).ravel()
    return np.append(inner, at[-1])


def _path_speeds(
    spline: CubicSpline,
    grid: FloatArray,
    dynamics: ArmDynamics | None,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters,
) -> FloatArray:
    """Speed (G,) of the path parameter at every grid point, by reachability analysis."""
    along, bend = spline(grid, 1), spline(grid, 2)
    tool = np.linalg.norm(np.einsum("nij,nj->ni", jacobian(spline(grid))[:, :3], along), axis=1)
    by_joints = np.min(limits.velocity_rad_s / np.maximum(np.abs(along), 1e-12), axis=1)
    square = np.minimum(by_joints, parameters.tool_speed_m_s / np.maximum(tool, 1e-9)) ** 2
    if dynamics is None:
        effort = PathLimits(along, bend, np.zeros_like(along), limits.acceleration_rad_s2, square)
    else:
        q, rest = spline(grid), np.zeros_like(along)
        weight = dynamics.gravity(q)
        push = dynamics.rigid_torque(q, rest, along) - weight
        # Viscous friction grows with the speed; taken as growing with its square, it is one more term of b.
        bent = dynamics.rigid_torque(q, along, bend) + dynamics.viscous_nm_s * along - weight
        held = weight + dynamics.coulomb_nm.max(axis=1) * np.sign(along)
        effort = PathLimits(push, bent, held, parameters.torque_share * dynamics.torque_max_nm, square)
    found = fastest_speeds(grid, effort)
    if found is None:
        raise SafetyStopError(
            f"no motion along {len(spline.x)} joint positions keeps {100 * parameters.torque_share:.0f} percent of the "
            "torque limits",
            cure="raise torque_share, lighten the tool, or scan stop by stop",
        )
    return found


def _excess(
    planned: TimeOptimalPass,
    checks: int,
    dynamics: ArmDynamics | None,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters,
) -> float:
    """By how much the pass must be stretched so that it keeps its limits everywhere."""
    q, qd, qdd = planned.sample(np.linspace(0.0, planned.duration_s, checks))
    tool = np.linalg.norm(np.einsum("nij,nj->ni", jacobian(q)[:, :3], qd), axis=1)
    fastest = max(float(np.max(np.abs(qd) / limits.velocity_rad_s)), float(np.max(tool)) / parameters.tool_speed_m_s)
    if dynamics is None:
        square = float(np.max(np.abs(qdd) / limits.acceleration_rad_s2))
    else:
        square = _torque_excess(q, qd, qdd, dynamics, parameters.torque_share)
    needed = max(fastest, float(np.sqrt(max(0.0, square))))
    return needed if needed > 1.0 + _TOLERANCE else 1.0


def _torque_excess(q: FloatArray, qd: FloatArray, qdd: FloatArray, dynamics: ArmDynamics, torque_share: float) -> float:
    """Square of the factor by which time must be stretched so that the torques keep their limits.

    Stretching time by f divides the torques of motion by f^2; what gravity and friction need stays.
    """
    weight = dynamics.gravity(q)
    moving = dynamics.rigid_torque(q, qd, qdd) - weight
    steady = weight + dynamics.friction(qd)
    most = torque_share * dynamics.torque_max_nm
    # |steady + moving / f^2| <= most, for both signs.
    square = np.maximum(moving / np.maximum(most - steady, 1e-9), -moving / np.maximum(most + steady, 1e-9))
    return float(np.max(square))
