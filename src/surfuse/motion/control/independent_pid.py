"""Independent joint PID: every joint for itself, gains for one fixed inertia; what the cards were first used with."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.interfaces import GIVEN_BY_RIG, surrounded
from surfuse.motion.control_law import CREEPING_RAD, STANDARD_GAINS, Commands, LawSurroundings, LoopGains, every_tick
from surfuse.motion.joint_gains import DAMPING, INTEGRAL, LIMIT, STIFFNESS, joint_gains
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray

SUMMARY = "PID of every joint for itself, gains for one fixed inertia"


@dataclass(frozen=True)
class Parameters:
    """`gains`: of each joint.

    `surroundings`: arm and nominal joints, which the rig gives.
    """

    gains: LoopGains = STANDARD_GAINS
    surroundings: LawSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)


class IndependentPid:
    """PID on position and speed error of every joint at 1 kHz; gravity and coupling are left to the integrators.

    `dynamics` gives the inertia at `nominal_rad` (J,), for which the gains hold, and the torque limits.
    """

    name = "independent_pid"
    period_s = 1e-3
    # Its integrator creeps against dry friction: this much is left when a stop must begin.
    settle_rad = CREEPING_RAD

    def __init__(self, parameters: Parameters, surroundings: LawSurroundings) -> None:
        gains, dynamics = parameters.gains, surroundings.dynamics
        inertia = np.diag(dynamics.inertia(surroundings.nominal_rad))
        self._gains = joint_gains(gains, inertia, dynamics.torque_max_nm, self.period_s)
        self._dead_band_rad = gains.dead_band_rad
        self._integral = np.zeros(len(dynamics))

    def commands(self, trajectory: Trajectory) -> Commands:
        """The motion at every tick."""
        return every_tick(trajectory, self.period_s)

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
        """See `ControlLaw.torque`."""
        loop = self._gains, self._dead_band_rad, self._integral
        _pid(*loop, wanted_rad, wanted_rad_s, measured_rad, measured_rad_s, torque_nm)


def create(parameters: Parameters) -> IndependentPid:
    """The law for one arm."""
    return IndependentPid(parameters, surrounded(parameters.surroundings, IndependentPid.name))


@compiled
def _pid(
    gains: FloatArray,
    dead_band: float,
    integral: FloatArray,
    wanted: FloatArray,
    wanted_speed: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    torque: FloatArray,
) -> None:
    """Write the joint torques (J,) of one tick in Nm, and move the integrators (J,) in Nm on; `gains` are (4, J)."""
    kp, kd, ki, limit = gains[STIFFNESS], gains[DAMPING], gains[INTEGRAL], gains[LIMIT]
    for j in range(kp.shape[0]):
        error = wanted[j] - measured[j]
        if abs(error) > dead_band:
            # The integrator holds a torque; it never asks for more than the joint has.
            integral[j] = min(max(integral[j] + ki[j] * error, -limit[j]), limit[j])
        total = kp[j] * error + kd[j] * (wanted_speed[j] - measured_speed[j]) + integral[j]
        torque[j] = min(max(total, -limit[j]), limit[j])
