"""Computed torque: the arm's own dynamics turn it into independent double integrators, and PID holds these."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import GIVEN_BY_RIG, surrounded
from surfuse.motion.control_law import INTEGRATED_RAD, STANDARD_GAINS, Commands, LawSurroundings, LoopGains, every_tick
from surfuse.motion.newton_euler import RigidArm, newton_euler
from surfuse.motion.trajectory import Trajectory
from surfuse.records import FloatArray

SUMMARY = "inverse dynamics of the arm, PID of what is left (default)"


@dataclass(frozen=True)
class Parameters:
    """`gains`: of each decoupled joint. `friction_share`: how much of the modelled friction is compensated, 0 to 1.

    `breakaway_rad_s`: reference speed at which dry friction is compensated in full. The reference speed is the wanted
    one plus the position error times the natural frequency (Slotine and Li, Int. J. Robotics Research 6(3), 1987), so
    that a joint that sticks short of its target is pushed on.
    """

    gains: LoopGains = STANDARD_GAINS
    friction_share: float = 0.9
    breakaway_rad_s: float = 0.003
    surroundings: LawSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 0.0 <= self.friction_share <= 1.0:
            raise ConfigError(f"friction_share = {self.friction_share}", cure="give a share from 0 to 1")
        if not (np.isfinite(self.breakaway_rad_s) and self.breakaway_rad_s > 0.0):
            raise ConfigError(f"breakaway_rad_s = {self.breakaway_rad_s}", cure="give a speed > 0 rad/s")


TorqueLoop = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Single numbers (7,) in the order of `Gains`; of J joints largest integral, integral, acceleration (J,), viscous
friction (J,), dry friction (J, 2) and largest torque (J,). Integral and acceleration, both in rad/s^2, move on.

A plain tuple, because it is handed over at every tick: the names of a NamedTuple cost half a microsecond.
"""


class Gains(NamedTuple):
    """Of a unit of inertia: `kp` (1/s^2), `kd` (1/s), `ki` (1/s^3).

    `dead_band` (rad): smaller errors are not integrated. `period` in s, `natural` frequency in rad/s; `per_breakaway`
    is one over the speed at which dry friction is compensated in full (s/rad).
    """

    kp: float
    kd: float
    ki: float
    dead_band: float
    period: float
    natural: float
    per_breakaway: float


class ComputedTorque:
    """Paul 1972; Markiewicz 1973; with friction compensation and an integrator for what the model does not know."""

    name = "computed_torque"
    period_s = 1e-3
    settle_rad = INTEGRATED_RAD

    def __init__(self, parameters: Parameters, surroundings: LawSurroundings) -> None:
        dynamics, gains = surroundings.dynamics, parameters.gains
        w = gains.natural_rad_s
        single = Gains(
            kp=w**2,
            kd=2.0 * gains.damping * w,
            ki=gains.integral_share * w**3,
            dead_band=gains.dead_band_rad,
            period=self.period_s,
            natural=w,
            per_breakaway=1.0 / parameters.breakaway_rad_s,
        )
        self._integral = np.zeros(len(dynamics))
        loop = (
            np.array(single),
            # No integrator may hold more than half of the torque as an acceleration of the least inertia.
            0.5 * dynamics.torque_max_nm / dynamics.armature_kg_m2,
            self._integral,
            np.zeros(len(dynamics)),
            parameters.friction_share * dynamics.viscous_nm_s,
            parameters.friction_share * dynamics.coulomb_nm,
            dynamics.torque_max_nm,
        )
        self.memory: tuple[RigidArm, TorqueLoop] = (dynamics.kernel_arguments(), loop)
        """What `computed_torque` takes first: the arm's model, and the loop with its integrators, which move on."""

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
        computed_torque(*self.memory, wanted_rad, wanted_rad_s, wanted_rad_s2, measured_rad, measured_rad_s, torque_nm)


def create(parameters: Parameters) -> ComputedTorque:
    """The law for one arm."""
    return ComputedTorque(parameters, surrounded(parameters.surroundings, ComputedTorque.name))


@compiled
def computed_torque(
    model: RigidArm,
    loop: TorqueLoop,
    wanted: FloatArray,
    wanted_speed: FloatArray,
    wanted_rate: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    torque: FloatArray,
) -> None:
    """Write the joint torques (J,) of one tick in Nm: inverse dynamics of the corrected acceleration, and friction.

    Wanted and measured joints, speeds and accelerations are (J,) in rad, rad/s, rad/s^2.
    """
    single, integral_max, integral, acceleration, viscous, dry, limit = loop
    gains = Gains(single[0], single[1], single[2], single[3], single[4], single[5], single[6])
    for j in range(wanted.shape[0]):
        error = wanted[j] - measured[j]
        if abs(error) > gains.dead_band:
            most = integral_max[j]
            integral[j] = min(max(integral[j] + gains.period * gains.ki * error, -most), most)
        # What the joint must have: the wanted acceleration plus PID of the error.
        acceleration[j] = wanted_rate[j] + gains.kp * error + gains.kd * (wanted_speed[j] - measured_speed[j])
        acceleration[j] += integral[j]
    newton_euler(model, measured, measured_speed, acceleration, torque)
    for j in range(wanted.shape[0]):
        error = wanted[j] - measured[j]
        push = 0.0
        if abs(error) > gains.dead_band or wanted_speed[j] != 0.0:
            push = min(max((wanted_speed[j] + gains.natural * error) * gains.per_breakaway, -1.0), 1.0)
        friction = viscous[j] * wanted_speed[j], (dry[j, 0] if push > 0.0 else dry[j, 1]) * push
        torque[j] = min(max(torque[j] + friction[0] + friction[1], -limit[j]), limit[j])
