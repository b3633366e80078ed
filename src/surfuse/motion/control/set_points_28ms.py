"""The arm's old controller: a set point every 28 ms, straight lines in between, fixed-gain joint loops at 0.875 ms.

Structure: the computer gives set points, the joint servos interpolate linearly to 32 times their rate; position error
is amplified and summed with a speed signal from the joint (Unimation, description of the Unimate 500 controller,
1977), so speed is damped but not fed forward, and a moving joint lags behind. An integrator works near the target.
The gains of the real boards are not published: the loops here have the same bandwidth as the new laws.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.interfaces import GIVEN_BY_RIG, surrounded
from surfuse.motion.control_law import CREEPING_RAD, STANDARD_GAINS, Commands, LawSurroundings, LoopGains
from surfuse.motion.joint_gains import DAMPING, INTEGRAL, LIMIT, STIFFNESS, joint_gains
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray

SET_POINT_S = 28e-3
INTERPOLATED = 32
INTEGRAL_BAND_RAD = 0.02  # a joint further away is on its way, and its lag must not be integrated
SUMMARY = "the arm's old controller: a set point every 28 ms, fixed-gain loops"


@dataclass(frozen=True)
class Parameters:
    """`gains`: of each joint.

    `surroundings`: arm and nominal joints, which the rig gives.
    """

    gains: LoopGains = STANDARD_GAINS
    surroundings: LawSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)


class SetPoints28ms:
    """Fixed-gain joint loops that follow straight lines between set points; inertia as in `IndependentPid`."""

    name = "set_points_28ms"
    period_s = SET_POINT_S / INTERPOLATED
    # Its integrator works near the target only, and creeps: this much is left when a stop must begin.
    settle_rad = CREEPING_RAD

    def __init__(self, parameters: Parameters, surroundings: LawSurroundings) -> None:
        gains, dynamics = parameters.gains, surroundings.dynamics
        inertia = np.diag(dynamics.inertia(surroundings.nominal_rad))
        self._gains = joint_gains(gains, inertia, dynamics.torque_max_nm, self.period_s)
        # Friction of the motor damps, too; the boards were adjusted with it.
        self._gains[DAMPING] = np.maximum(self._gains[DAMPING] - dynamics.viscous_nm_s, 0.0)
        self._dead_band_rad = gains.dead_band_rad
        self._integral = np.zeros(len(dynamics))

    def commands(self, trajectory: Trajectory) -> Commands:
        """Set points at whole multiples of 28 ms, interpolated; the last one is the first at or after the end."""
        count = int(np.ceil(trajectory.duration_s / SET_POINT_S - 1e-9))
        points, _, _ = trajectory.sample(SET_POINT_S * np.arange(count + 1))
        at = np.arange(1, count * INTERPOLATED + 1) / INTERPOLATED
        position = np.column_stack([np.interp(at, np.arange(count + 1), column) for column in points.T])
        return Commands(position, np.zeros_like(position), np.zeros_like(position))

    def reset(self) -> None:
        """Empty the integrators."""
        self._integral[:] = 0.0

    def torque(
        self,
        wanted_rad: FloatArray,
        wanted_rad_s: FloatArray,
        wanted_rad_s2: FloatArray,
        measured_rad: FloatArray,
        measured_rad_s: FloatArray,
        torque_nm: FloatArray,
    ) -> None:
        """See `ControlLaw.torque`; wanted speed and acceleration are not known to this controller."""
        loop = self._gains, self._dead_band_rad, self._integral
        _damped(*loop, wanted_rad, measured_rad, measured_rad_s, torque_nm)


def create(parameters: Parameters) -> SetPoints28ms:
    """The law for one arm."""
    return SetPoints28ms(parameters, surrounded(parameters.surroundings, SetPoints28ms.name))


@compiled
def _damped(
    gains: FloatArray,
    dead_band: float,
    integral: FloatArray,
    wanted: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    torque: FloatArray,
) -> None:
    """Write the joint torques (J,) of one tick in Nm; `gains` are (4, J).

    The integrators (J,) in Nm move on where a joint is near its set point.
    """
    kp, kd, ki, limit = gains[STIFFNESS], gains[DAMPING], gains[INTEGRAL], gains[LIMIT]
    for j in range(kp.shape[0]):
        error = wanted[j] - measured[j]
        if dead_band < abs(error) < INTEGRAL_BAND_RAD:
            integral[j] = min(max(integral[j] + ki[j] * error, -limit[j]), limit[j])
        total = kp[j] * error - kd[j] * measured_speed[j] + integral[j]
        torque[j] = min(max(total, -limit[j]), limit[j])
