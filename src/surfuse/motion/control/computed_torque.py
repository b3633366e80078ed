"""Computed torque: the arm's own dynamics turn it into independent double integrators, and PID holds these."""

from __future__ import annotations

from dataclasses import dataclass, field

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


class ComputedTorque:
    """Paul 1972; Markiewicz 1973; with friction compensation and an integrator for what the model does not know."""

    name = "computed_torque"
    period_s = 1e-3
    settle_rad = INTEGRATED_RAD

    def __init__(self, parameters: Parameters, surroundings: LawSurroundings) -> None:
        dynamics = surroundings.dynamics
        w = parameters.gains.natural_rad_s
        self._gains = np.array(
            [
                w**2,
                2.0 * parameters.gains.damping * w,
                parameters.gains.integral_share * w**3,
                parameters.gains.dead_band_rad,
                self.period_s,
                w,
                1.0 / parameters.breakaway_rad_s,
            ]
        )
        self._viscous = parameters.friction_share * dynamics.viscous_nm_s
        self._dry = parameters.friction_share * dynamics.coulomb_nm
        self._limit_nm = dynamics.torque_max_nm
        self._arguments = dynamics.kernel_arguments()
        self._integral = np.zeros(len(dynamics))
        # No integrator may hold more than half of the torque as an acceleration of the least inertia.
        self._integral_max = 0.5 * dynamics.torque_max_nm / dynamics.armature_kg_m2
        self._acceleration = np.zeros(len(dynamics))

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

    @property
    def memory(self) -> tuple[RigidArm, tuple[FloatArray, ...]]:
        """What `computed_torque` takes first: the arm's model, and the loop with its integrators, which move on."""
        return self._arguments, (
            self._gains,
            self._integral_max,
            self._integral,
            self._acceleration,
            self._viscous,
            self._dry,
            self._limit_nm,
        )


def create(parameters: Parameters) -> ComputedTorque:
    """The law for one arm."""
    return ComputedTorque(parameters, surrounded(parameters.surroundings, ComputedTorque.name))


@compiled
def computed_torque(
    model: RigidArm,
    loop: tuple[FloatArray, ...],
    wanted: FloatArray,
    wanted_speed: FloatArray,
    wanted_rate: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    torque: FloatArray,
) -> None:
    """Write the joint torques (J,) of one tick."""
    gains, integral_max, integral, acceleration, viscous, dry, limit = loop
    _reference(gains, integral_max, wanted, wanted_speed, wanted_rate, measured, measured_speed, integral, acceleration)
    newton_euler(model, measured, measured_speed, acceleration, torque)
    _add_friction(gains, viscous, dry, limit, wanted, wanted_speed, measured, torque)


@compiled
def _reference(
    gains: FloatArray,
    most: FloatArray,
    wanted: FloatArray,
    wanted_speed: FloatArray,
    wanted_rate: FloatArray,
    measured: FloatArray,
    measured_speed: FloatArray,
    integral: FloatArray,
    acceleration: FloatArray,
) -> None:
    """Acceleration that the joints must have: the wanted one plus PID of the error."""
    for j in range(wanted.shape[0]):
        error = wanted[j] - measured[j]
        if abs(error) > gains[3]:
            integral[j] = min(max(integral[j] + gains[4] * gains[2] * error, -most[j]), most[j])
        acceleration[j] = wanted_rate[j] + gains[0] * error + gains[1] * (wanted_speed[j] - measured_speed[j])
        acceleration[j] += integral[j]


@compiled
def _add_friction(
    gains: FloatArray,
    viscous: FloatArray,
    dry: FloatArray,
    limit: FloatArray,
    wanted: FloatArray,
    wanted_speed: FloatArray,
    measured: FloatArray,
    torque: FloatArray,
) -> None:
    for j in range(wanted.shape[0]):
        error = wanted[j] - measured[j]
        push = 0.0
        if abs(error) > gains[3] or wanted_speed[j] != 0.0:
            push = min(max((wanted_speed[j] + gains[5] * error) * gains[6], -1.0), 1.0)
        total = torque[j] + viscous[j] * wanted_speed[j] + (dry[j, 0] if push > 0.0 else dry[j, 1]) * push
        torque[j] = min(max(total, -limit[j]), limit[j])
