"""What a control law is: it turns a planned motion into commands, and commands with measurements into torques."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surfuse.errors import ConfigError
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.motion.trajectory import Trajectory, ticks
from surfuse.records import FloatArray


@dataclass(frozen=True)
class Commands:
    """What the servo is told at each of its T ticks: position, speed and acceleration (T, J).

    Positions in rad, speeds in rad/s, accelerations in rad/s^2.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray

    def __len__(self) -> int:
        return len(self.position_rad)


class ControlLaw(Protocol):
    """A law of the joint servo, with the period it runs at. It owns its integrators and nothing else."""

    @property
    def name(self) -> str: ...
    @property
    def period_s(self) -> float: ...
    @property
    def settle_rad(self) -> float:
        """How near to its target this law brings every joint for certain, within the time that a stop may take."""

    def commands(self, trajectory: Trajectory) -> Commands:
        """The motion as this controller is told it."""

    def reset(self) -> None:
        """Forget the past."""

    def torque(
        self,
        wanted_rad: FloatArray,
        wanted_rad_s: FloatArray,
        wanted_rad_s2: FloatArray,
        measured_rad: FloatArray,
        measured_rad_s: FloatArray,
        torque_nm: FloatArray,
    ) -> None:
        """Write the joint torques (J,) of this tick into `torque_nm`, within the torque limits.

        All (J,): wanted and measured joints in rad, speeds in rad/s, acceleration in rad/s^2, torques in Nm. Called
        once a period, so that integrators may count calls. The arrays are used again at the next tick: nothing may be
        kept of them.
        """


@dataclass(frozen=True)
class LawSurroundings:
    """The arm as its controller knows it, and the joints (J,) for whose inertia fixed gains hold.

    `dynamics` includes the loads that are known; `nominal_rad` in rad.
    """

    dynamics: ArmDynamics
    nominal_rad: FloatArray


@dataclass(frozen=True)
class LoopGains:
    """Closed loop of one joint: natural frequency (rad/s), damping ratio, and share of integral action.

    The default frequency is half of a lowest structural resonance of 80 rad/s, which is assumed, not measured; half is
    the usual rule for geared arms (Paul, Robot Manipulators, 1981). `integral_share` times the third power of the
    frequency is the integral gain per unit of inertia; below 2 x damping the loop is stable. `dead_band_rad`: errors
    below it are not integrated, so that dry friction and whole encoder counts do not make the joint hunt.
    """

    natural_rad_s: float = 40.0
    damping: float = 1.0
    integral_share: float = 0.5
    dead_band_rad: float = 6e-5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.natural_rad_s) and 0.0 < self.natural_rad_s <= 300.0):
            raise ConfigError(f"natural_rad_s = {self.natural_rad_s}", cure="give a frequency from 0 to 300 rad/s")
        if not (np.isfinite(self.damping) and self.damping > 0.0):
            raise ConfigError(f"damping = {self.damping}", cure="give a positive ratio")
        if not 0.0 <= self.integral_share < 2.0 * self.damping:
            raise ConfigError(
                f"integral_share = {self.integral_share}, the loop is unstable from {2.0 * self.damping:g} on",
                cure="give 0.1 to 0.5",
            )
        if not (np.isfinite(self.dead_band_rad) and self.dead_band_rad >= 0.0):
            raise ConfigError(f"dead_band_rad = {self.dead_band_rad}", cure="give 0 rad or more")


STANDARD_GAINS = LoopGains()
INTEGRATED_RAD = float(np.radians(0.0115))
"""A law that knows the friction and integrates the rest brings a joint nearer than this."""
CREEPING_RAD = 9e-4
"""What an integrator that creeps against dry friction leaves when a stop must begin."""


def every_tick(trajectory: Trajectory, period_s: float) -> Commands:
    """The motion itself, at every tick."""
    return Commands(*trajectory.sample(ticks(trajectory, period_s)))
