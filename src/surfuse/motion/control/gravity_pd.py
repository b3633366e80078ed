"""PD with gravity compensation: proportional and speed action of each joint, plus the weight of the arm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.interfaces import GIVEN_BY_RIG, surrounded
from surfuse.motion.control_law import STANDARD_GAINS, Commands, LawSurroundings, LoopGains, every_tick
from surfuse.motion.newton_euler import newton_euler
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray

SUMMARY = "PD of every joint and the weight of the arm, without integrators"


@dataclass(frozen=True)
class Parameters:
    """`gains`: of each joint.

    `surroundings`: arm and nominal joints, which the rig gives.
    """

    gains: LoopGains = STANDARD_GAINS
    surroundings: LawSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)


class GravityPd:
    """Takegaki and Arimoto, J. Dynamic Systems, Measurement and Control 103(2), 1981, with speed error as damping.

    Stable at every gain, but whatever dry friction holds stays as an error: there is no integrator.
    """

    name = "gravity_pd"
    period_s = 1e-3

    def __init__(self, parameters: Parameters, surroundings: LawSurroundings) -> None:
        gains, dynamics = parameters.gains, surroundings.dynamics
        inertia = np.diag(dynamics.inertia(surroundings.nominal_rad))
        self._kp = inertia * gains.natural_rad_s**2
        self._kd = inertia * 2.0 * gains.damping * gains.natural_rad_s
        # Where dry friction holds what the spring of the error pulls; a quarter more for what the model does not know.
        self.settle_rad = 1.25 * float(np.max(dynamics.coulomb_nm.max(axis=1) / self._kp))
        self._limit_nm = dynamics.torque_max_nm
        self._arguments = dynamics.kernel_arguments()
        self._still = np.zeros(len(dynamics))

    def commands(self, trajectory: Trajectory) -> Commands:
        """The motion at every tick."""
        return every_tick(trajectory, self.period_s)

    def reset(self) -> None:
        """Nothing to forget."""

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
        newton_euler(self._arguments, measured_rad, self._still, self._still, torque_nm)
        _add_pd(
            self._kp,
            self._kd,
            self._limit_nm,
            wanted_rad,
            wanted_rad_s,
            measured_rad,
            measured_rad_s,
            torque_nm,
        )


def create(parameters: Parameters) -> GravityPd:
    """The law for one arm."""
    return GravityPd(parameters, surrounded(parameters.surroundings, GravityPd.name))


@compiled
def _add_pd(
    kp: FloatArray,
    kd: FloatArray,
    limit: FloatArray,
    wanted: FloatArray,
    wanted_speed: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    torque: FloatArray,
) -> None:
    for j in range(kp.shape[0]):
        total = torque[j] + kp[j] * (wanted[j] - measured[j]) + kd[j] * (wanted_speed[j] - measured_speed[j])
        torque[j] = min(max(total, -limit[j]), limit[j])
