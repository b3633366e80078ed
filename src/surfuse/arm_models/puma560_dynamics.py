"""Masses, motors, gears and friction of the PUMA 560, and what it carries.

Values: Corke and Armstrong-Helouvry, "A search for consensus among model parameters reported for the PUMA 560 robot",
ICRA 1994, as in the Robotics Toolbox for Python 1.5.0, models/DH/Puma560.py. The inertia of link 3 is kept as
published although no rigid body has it about its centre of gravity (0.066 + 0.0125 < 0.086 kg m^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.arm_models.puma560 import A_M, ALPHA_RAD, D_M, FLANGE_OFFSET_M
from surfuse.errors import ConfigError
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray

# Largest joint torques: full scale of the 12-bit converters over the measured counts per N m (Armstrong, Khatib and
# Burdick 1986, quoted in Trident's ROBOT.C v4.3).
TORQUE_MAX_NM = (97.5, 186.2, 89.4, 24.2, 20.1, 21.3)

# Rated payload of the arm, at the flange.
PAYLOAD_MAX_KG = 2.5

# Jerk limits of the data set that later papers attribute to Lin, Chang and Luh 1983; they go with the speed and
# acceleration limits of `surfuse.arm_models.puma560`.
JERK_RAD_S3 = np.radians([60.0, 60.0, 55.0, 70.0, 75.0, 70.0])

_INERTIA_KG_M2 = (
    (0.0, 0.35, 0.0),
    (0.13, 0.524, 0.539),
    (0.066, 0.086, 0.0125),
    (1.8e-3, 1.3e-3, 1.8e-3),
    (0.3e-3, 0.4e-3, 0.3e-3),
    (0.15e-3, 0.15e-3, 0.04e-3),
)


@dataclass(frozen=True)
class Load:
    """What the wrist carries: mass (kg), its centre ahead of the wrist centre (m), and its size as a solid cylinder.

    The defaults are estimates for four transducers in tubes 20 cm long on a bracket: weigh the real one.

    `mass_kg` at `ahead_m` beyond the wrist centre, as a cylinder of `radius_m` and `length_m` along the last axis.
    """

    mass_kg: float = 0.45
    ahead_m: float = 0.103
    radius_m: float = 0.05
    length_m: float = 0.20

    def __post_init__(self) -> None:
        for name in ("mass_kg", "ahead_m", "radius_m", "length_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ConfigError(f"Load.{name} = {getattr(self, name)}", cure="give a finite value of 0 or more")
        if self.mass_kg > PAYLOAD_MAX_KG:
            raise ConfigError(
                f"a load of {self.mass_kg:g} kg, the PUMA 560 carries {PAYLOAD_MAX_KG:g} kg", cure="lighten the tool"
            )

    @property
    def inertia_kg_m2(self) -> FloatArray:
        """Inertia (3, 3) about its centre, axis along z."""
        across = self.mass_kg * (3.0 * self.radius_m**2 + self.length_m**2) / 12.0
        return np.diag([across, across, 0.5 * self.mass_kg * self.radius_m**2])


FIXTURE = Load()


def extra_load(mass_kg: float) -> Load:
    """A compact load at the flange: a solid cylinder 8 cm wide and 5 cm long."""
    return Load(mass_kg, FLANGE_OFFSET_M + 0.025, 0.04, 0.05)


def bare_puma560() -> ArmDynamics:
    """The arm without tool, as published."""
    return ArmDynamics(
        d_m=np.array(D_M),
        a_m=np.array(A_M),
        alpha_rad=np.array(ALPHA_RAD),
        mass_kg=np.array([0.0, 17.4, 4.8, 0.82, 0.34, 0.09]),
        center_m=np.array(
            [
                [0.0, 0.0, 0.0],
                [-0.3638, 0.006, 0.2275],
                [-0.0203, -0.0141, 0.070],
                [0.0, 0.019, 0.0],
                [0.0, 0.0, 0.0],
                [0.0, 0.0, 0.032],
            ]
        ),
        inertia_kg_m2=np.array([np.diag(row) for row in _INERTIA_KG_M2]),
        motor_inertia_kg_m2=np.array([200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6]),
        gear=np.array([-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686]),
        viscous_motor=np.array([1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6]),
        # In the toolbox the first value holds for a joint that turns forwards, whatever the sign of its gear.
        coulomb_motor_nm=np.array(
            [[0.395, 0.435], [0.126, 0.071], [0.132, 0.105], [11.2e-3, 16.9e-3], [9.26e-3, 14.5e-3], [3.96e-3, 10.5e-3]]
        ),
        torque_max_nm=np.array(TORQUE_MAX_NM),
    )


def loaded_puma560(*loads: Load) -> ArmDynamics:
    """The arm with everything that is bolted to its wrist.

    Raises
    ------
    ConfigError : all loads together exceed the rated payload.
    """
    total = sum(load.mass_kg for load in loads)
    if total > PAYLOAD_MAX_KG:
        raise ConfigError(
            f"loads of {total:g} kg together, the PUMA 560 carries {PAYLOAD_MAX_KG:g} kg", cure="lighten the tool"
        )
    dynamics = bare_puma560()
    for load in loads:
        dynamics = dynamics.with_load(load.mass_kg, [0.0, 0.0, load.ahead_m], load.inertia_kg_m2)
    return dynamics
