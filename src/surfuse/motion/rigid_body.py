"""Rigid-body dynamics of a serial arm as its controller knows it: inverse dynamics, gravity, inertia, friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from surfuse.errors import ConfigError, DataError
from surfuse.motion.newton_euler import RigidArm, newton_euler
from surfuse.records import FloatArray

GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class ArmDynamics:
    """J revolute joints in standard Denavit-Hartenberg form with masses, motors and gears; base upright.

    `d_m`, `a_m`, `alpha_rad` (J,) as in `geometry.chains.Chain`. `mass_kg` (J,), `center_m` (J, 3) centre of gravity
    and `inertia_kg_m2` (J, 3, 3) about it, both in the frame of the link. `motor_inertia_kg_m2`, `gear` (turns of the
    motor for one of the joint; its sign is the direction), `viscous_motor` (N m s/rad) and `coulomb_motor_nm` (J, 2:
    while turning forwards, while turning backwards, both >= 0), all on the motor's side. `torque_max_nm` (J,) on the
    joint's side.
    """

    d_m: FloatArray
    a_m: FloatArray
    alpha_rad: FloatArray
    mass_kg: FloatArray
    center_m: FloatArray
    inertia_kg_m2: FloatArray
    motor_inertia_kg_m2: FloatArray
    gear: FloatArray
    viscous_motor: FloatArray
    coulomb_motor_nm: FloatArray
    torque_max_nm: FloatArray
    gravity_m_s2: float = GRAVITY_M_S2

    def __post_init__(self) -> None:
        j = np.size(self.d_m)
        shapes = {"center_m": (j, 3), "inertia_kg_m2": (j, 3, 3), "coulomb_motor_nm": (j, 2)}
        for name in self.__dataclass_fields__:
            if name == "gravity_m_s2":
                continue
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shapes.get(name, (j,)) or not np.all(np.isfinite(value)):
                raise DataError(f"ArmDynamics.{name} has shape {value.shape}, wanted {shapes.get(name, (j,))}, finite")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        for name in ("mass_kg", "motor_inertia_kg_m2", "viscous_motor", "coulomb_motor_nm"):
            if np.any(getattr(self, name) < 0.0):
                raise ConfigError(f"ArmDynamics.{name} = {getattr(self, name).tolist()}", cure="give 0 or more")
        if np.any(self.torque_max_nm <= 0.0):
            raise ConfigError(f"torque_max_nm = {self.torque_max_nm.tolist()}", cure="give positive torques")

    def __len__(self) -> int:
        return len(self.d_m)

    @property
    def armature_kg_m2(self) -> FloatArray:
        """Motor inertia (J,) as the joint feels it."""
        return np.asarray(self.motor_inertia_kg_m2 * self.gear**2)

    @property
    def viscous_nm_s(self) -> FloatArray:
        """Viscous friction (J,) as the joint feels it, in N m s/rad."""
        return np.asarray(self.viscous_motor * self.gear**2)

    @property
    def coulomb_nm(self) -> FloatArray:
        """Coulomb friction (J, 2) as the joint feels it: while turning forwards, while turning backwards."""
        return np.asarray(self.coulomb_motor_nm * np.abs(self.gear)[:, None])

    def friction(self, velocity_rad_s: npt.ArrayLike) -> FloatArray:
        """Torque (..., J) that the motors spend on friction at joint speeds (..., J); no Coulomb part at rest.

        In Nm; viscous friction in proportion to the speed, dry friction of the direction of motion.
        """
        speed = np.asarray(velocity_rad_s, dtype=np.float64)
        dry = np.where(speed > 0.0, self.coulomb_nm[:, 0], np.where(speed < 0.0, -self.coulomb_nm[:, 1], 0.0))
        return np.asarray(self.viscous_nm_s * speed + dry)

    def rigid_torque(
        self, position_rad: npt.ArrayLike, velocity_rad_s: npt.ArrayLike, acceleration_rad_s2: npt.ArrayLike
    ) -> FloatArray:
        """Torque (..., J) for a motion (..., J) against inertia (motors included), Coriolis force and gravity.

        Recursive Newton-Euler method in the link frames: Luh, Walker and Paul, J. Dynamic Systems, Measurement and
        Control 102(2), 1980.

        Positions in rad, speeds in rad/s, accelerations in rad/s^2, torques in Nm; the shapes are broadcast.

        Raises
        ------
        DataError : the states do not have J joints.
        """
        q, qd, qdd = np.broadcast_arrays(
            np.asarray(position_rad, dtype=np.float64),
            np.asarray(velocity_rad_s, dtype=np.float64),
            np.asarray(acceleration_rad_s2, dtype=np.float64),
        )
        if q.ndim == 0 or q.shape[-1] != len(self):
            raise DataError(f"joint states have shape {q.shape}, wanted (..., {len(self)})")
        rows = [np.ascontiguousarray(value.reshape(-1, len(self))) for value in (q, qd, qdd)]
        torque, arm = np.empty_like(rows[0]), self.kernel_arguments()
        for i in range(len(torque)):
            newton_euler(arm, rows[0][i], rows[1][i], rows[2][i], torque[i])
        return torque.reshape(q.shape)

    def inverse_dynamics(
        self, position_rad: npt.ArrayLike, velocity_rad_s: npt.ArrayLike, acceleration_rad_s2: npt.ArrayLike
    ) -> FloatArray:
        """Torque (..., J) that the motors must give for a motion (..., J), friction included.

        `rigid_torque` and `friction` added up, in Nm.
        """
        rigid = self.rigid_torque(position_rad, velocity_rad_s, acceleration_rad_s2)
        return np.asarray(rigid + self.friction(velocity_rad_s))

    def gravity(self, position_rad: npt.ArrayLike) -> FloatArray:
        """Torque (..., J) that holds the arm at rest.

        In Nm, for joints (..., J) in rad.
        """
        return self.rigid_torque(position_rad, 0.0, 0.0)

    def inertia(self, position_rad: npt.ArrayLike) -> FloatArray:
        """Joint-space inertia (..., J, J), motors included: one column for a unit acceleration of each joint.

        In kg m^2, for joints (..., J) in rad; symmetric and positive definite.
        """
        weightless = replace(self, gravity_m_s2=0.0)
        q = np.asarray(position_rad, dtype=np.float64)[..., None, :]
        return np.swapaxes(weightless.rigid_torque(q, 0.0, np.eye(len(self))), -1, -2)

    def with_load(self, mass_kg: float, center_m: npt.ArrayLike, inertia_kg_m2: npt.ArrayLike) -> ArmDynamics:
        """The same arm with a load bolted to its last link: centre (3,) and inertia (3, 3) about it, in that frame.

        Masses add, centres of gravity average, inertias move to the common centre (Steiner).

        In kg, m and kg m^2.

        Raises
        ------
        ConfigError : the mass is negative or not finite.
        """
        if not (np.isfinite(mass_kg) and mass_kg >= 0.0):
            raise ConfigError(f"mass of the load = {mass_kg} kg", cure="give 0 kg or more")
        if mass_kg == 0.0:
            return self
        total = float(self.mass_kg[-1]) + mass_kg
        center = np.asarray(center_m, dtype=np.float64)
        common = (self.mass_kg[-1] * self.center_m[-1] + mass_kg * center) / total
        inertia = self.inertia_kg_m2[-1] + np.asarray(inertia_kg_m2, dtype=np.float64)
        for mass, place in ((float(self.mass_kg[-1]), self.center_m[-1]), (mass_kg, center)):
            off = place - common
            inertia = inertia + mass * (np.dot(off, off) * np.eye(3) - np.outer(off, off))
        return replace(
            self,
            mass_kg=np.append(self.mass_kg[:-1], total),
            center_m=np.vstack([self.center_m[:-1], common]),
            inertia_kg_m2=np.concatenate([self.inertia_kg_m2[:-1], inertia[None]]),
        )

    def kernel_arguments(self) -> RigidArm:
        """The arm as `newton_euler` takes it."""
        return RigidArm(
            self.d_m,
            self.a_m,
            self.alpha_rad,
            self.mass_kg,
            self.center_m,
            self.inertia_kg_m2,
            self.armature_kg_m2,
            np.array([self.gravity_m_s2]),
        )
