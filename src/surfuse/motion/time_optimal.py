"""One smooth pass through many joint positions, as fast as speeds and torques allow (Pham and Pham 2018, by toppra)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.motion.limits import JointLimits
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray

_CHECKS_PER_POINT = 8
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class PassParameters:
    """`torque_share`: share of the torque limits to plan with. `tool_speed_m_s`: highest speed of the tool.

    `grid_per_point`: places per joint position at which limits are imposed.
    """

    torque_share: float = 0.75
    tool_speed_m_s: float = 0.5
    grid_per_point: int = 4

    def __post_init__(self) -> None:
        if not 0.0 < self.torque_share <= 1.0:
            raise ConfigError(f"torque_share = {self.torque_share}", cure="give a share above 0, at most 1")
        if not (np.isfinite(self.tool_speed_m_s) and self.tool_speed_m_s > 0.0):
            raise ConfigError(f"tool_speed_m_s = {self.tool_speed_m_s}", cure="give a speed > 0 m/s")
        if self.grid_per_point < 1:
            raise ConfigError(f"grid_per_point = {self.grid_per_point}", cure="give 1 or more")


class TimeOptimalPass:
    """See `time_optimal_pass`; `times_s` (N,) says when the pass is at each joint position, `slowed` by how much.

    `slowed` is the factor by which the pass was stretched in time because the limits, imposed only at grid points,
    were exceeded between them; 1 means not at all.
    """

    def __init__(self, spline: CubicSpline, parameter: FloatArray, clock: FloatArray, speed: FloatArray, slowed: float):
        self._spline = spline
        self._clock = clock * slowed
        self._parameter = parameter
        self._speed = speed / slowed
        self.slowed = slowed

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return float(self._clock[-1])

    def times_s(self, parameter: FloatArray) -> FloatArray:
        """When the pass is at each path parameter."""
        k = np.clip(np.searchsorted(self._parameter, parameter, side="right") - 1, 0, len(self._parameter) - 2)
        mean = 0.5 * (self._speed[k] + self._state(self._clock[k], parameter)[1])
        gone = np.asarray(parameter) - self._parameter[k]
        return np.asarray(self._clock[k] + np.divide(gone, mean, out=np.zeros_like(gone), where=mean > 0.0))

    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""
        asked = np.ravel(np.asarray(t_s, dtype=np.float64))
        t = np.clip(asked, 0.0, self._clock[-1])
        k = np.clip(np.searchsorted(self._clock, t, side="right") - 1, 0, len(self._clock) - 2)
        span = self._clock[k + 1] - self._clock[k]
        push = (self._speed[k + 1] - self._speed[k]) / span
        h = t - self._clock[k]
        rate = self._speed[k] + push * h
        at = np.clip(self._parameter[k] + h * (self._speed[k] + 0.5 * push * h), 0.0, self._parameter[-1])
        outside = (asked < 0.0) | (asked >= self._clock[-1])
        rate, push = np.where(outside, 0.0, rate)[:, None], np.where(outside, 0.0, push)[:, None]
        along, bend = self._spline(at, 1), self._spline(at, 2)
        return self._spline(at), along * rate, bend * rate**2 + along * push

    def _state(self, t: FloatArray, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Time and path speed at path parameters: v^2 is linear in the parameter between grid points."""
        return t, np.sqrt(np.interp(parameter, self._parameter, self._speed**2))


def time_optimal_pass(
    points_rad: FloatArray,
    dynamics: ArmDynamics,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters = PassParameters(),
) -> tuple[TimeOptimalPass, FloatArray]:
    """The fastest smooth motion through joint positions (N, J), and the time (N,) at which it is at each of them.

    The path is a cubic spline, straight joint-space distance as parameter. `jacobian` maps joints (N, J) to (N, 6, J)
    in world axes. Limits are joint speeds, torques (friction included) and the speed of the tool.

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
    clock = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(grid) / np.maximum(speed[:-1] + speed[1:], 1e-12))])
    planned = TimeOptimalPass(spline, grid, clock, speed, 1.0)
    slowed = _excess(planned, len(grid) * _CHECKS_PER_POINT, dynamics, limits, jacobian, parameters)
    planned = TimeOptimalPass(spline, grid, clock, speed, slowed)
    return planned, planned.times_s(at)


def _refined(at: FloatArray, per_point: int) -> FloatArray:
    inner = np.linspace(at[:-1], at[1:], per_point, endpoint=False, axis=1).ravel()
    return np.append(inner, at[-1])


def _path_speeds(
    spline: CubicSpline,
    grid: FloatArray,
    dynamics: ArmDynamics,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters,
) -> FloatArray:
    """Speed (G,) of the path parameter at every grid point, by reachability analysis."""
    import toppra  # type: ignore[import-not-found,import-untyped,unused-ignore]
    import toppra.algorithm  # type: ignore[import-not-found,import-untyped,unused-ignore]
    import toppra.constraint  # type: ignore[import-not-found,import-untyped,unused-ignore]

    toppra.setup_logging("ERROR")
    path = toppra.SplineInterpolator(spline.x, spline(spline.x), bc_type="clamped" if len(spline.x) > 2 else "natural")
    along = spline(grid, 1)
    tool = np.linalg.norm(np.einsum("nij,nj->ni", jacobian(spline(grid))[:, :3], along), axis=1)
    by_tool = parameters.tool_speed_m_s / np.maximum(tool, 1e-9)

    def speed_limit(s: float) -> FloatArray:
        # One limit of the path speed for all joints at once: that of the tool, as joint speeds at this place.
        share = float(np.interp(s, grid, by_tool)) * np.abs(spline(s, 1))
        bound = np.minimum(limits.velocity_rad_s, np.maximum(share, 1e-6))
        return np.column_stack([-bound, bound])

    torque = parameters.torque_share * dynamics.torque_max_nm
    constraints = [
        toppra.constraint.JointVelocityConstraintVarying(speed_limit),
        toppra.constraint.JointTorqueConstraint(
            lambda q, qd, qdd: dynamics.rigid_torque(q, qd, qdd) + dynamics.viscous_nm_s * qd,
            np.column_stack([-torque, torque]),
            dynamics.coulomb_nm.max(axis=1),
            discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
        ),
    ]
    solver = toppra.algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    _, found, _ = solver.compute_parameterization(0.0, 0.0)
    if found is None or not np.all(np.isfinite(found)):
        raise SafetyStopError(
            f"no motion along {len(spline.x)} joint positions keeps {100 * parameters.torque_share:.0f} percent of the "
            "torque limits",
            cure="raise torque_share, lighten the tool, or scan stop by stop",
        )
    return np.asarray(found, dtype=np.float64)


def _excess(
    planned: TimeOptimalPass,
    checks: int,
    dynamics: ArmDynamics,
    limits: JointLimits,
    jacobian: Callable[[FloatArray], FloatArray],
    parameters: PassParameters,
) -> float:
    """By how much the pass must be stretched so that speeds and torques keep their limits everywhere.

    Stretching time by f divides speeds by f and the torques of motion by f^2; what gravity and friction need stays.
    """
    q, qd, qdd = planned.sample(np.linspace(0.0, planned.duration_s, checks))
    tool = np.linalg.norm(np.einsum("nij,nj->ni", jacobian(q)[:, :3], qd), axis=1)
    fastest = max(float(np.max(np.abs(qd) / limits.velocity_rad_s)), float(np.max(tool)) / parameters.tool_speed_m_s)
    weight = dynamics.gravity(q)
    moving = dynamics.rigid_torque(q, qd, qdd) - weight
    steady = weight + dynamics.friction(qd)
    most = parameters.torque_share * dynamics.torque_max_nm
    # |steady + moving / f^2| <= most, for both signs.
    square = np.maximum(moving / np.maximum(most - steady, 1e-9), -moving / np.maximum(most + steady, 1e-9))
    needed = max(fastest, float(np.sqrt(max(0.0, float(np.max(square))))))
    return needed if needed > 1.0 + _TOLERANCE else 1.0
