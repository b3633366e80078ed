"""Limits of the joints, and the checks that refuse a motion before it starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.records import FloatArray

_ROUNDING_RAD = 1e-9  # an angle that a computation puts this far over its limit is on the limit


@dataclass(frozen=True)
class JointLimits:
    """Position (rad), speed (rad/s) and acceleration (rad/s^2) limits of J joints, each (J,).

    `lower_rad` and `upper_rad` are positions. Speeds and accelerations hold in both directions.
    """

    lower_rad: FloatArray
    upper_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray

    def __post_init__(self) -> None:
        joints = np.size(self.lower_rad)
        for name in ("lower_rad", "upper_rad", "velocity_rad_s", "acceleration_rad_s2"):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != (joints,) or not np.all(np.isfinite(value)):
                raise ConfigError(f"JointLimits.{name} = {value.tolist()}", cure=f"give {joints} finite numbers")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        for j in range(joints):
            if not self.lower_rad[j] < self.upper_rad[j]:
                low, high = np.degrees([self.lower_rad[j], self.upper_rad[j]])
                raise ConfigError(
                    f"limits of joint {j + 1} contradict each other: {low:.1f} to {high:.1f} deg",
                    cure="give the lower limit first",
                )
            if not (self.velocity_rad_s[j] > 0.0 and self.acceleration_rad_s2[j] > 0.0):
                raise ConfigError(
                    f"joint {j + 1} has speed limit {self.velocity_rad_s[j]:g} rad/s and acceleration limit "
                    f"{self.acceleration_rad_s2[j]:g} rad/s^2",
                    cure="give positive limits",
                )

    def __len__(self) -> int:
        return len(self.lower_rad)


def first_outside(joints_rad: FloatArray, limits: JointLimits) -> npt.NDArray[np.int64]:
    """Index (...) of the first joint of joints (..., J) outside its limits, -1 where all are inside; nan is outside.

    A limit itself is inside, and so is what rounding adds to it.
    """
    inside = (joints_rad >= limits.lower_rad - _ROUNDING_RAD) & (joints_rad <= limits.upper_rad + _ROUNDING_RAD)
    return np.where(np.all(inside, axis=-1), -1, np.argmin(inside, axis=-1)).astype(np.int64)


def check_position(joints_rad: FloatArray, limits: JointLimits) -> None:
    """Refuse a joint position (J,) that has the wrong length, is not finite, or breaks a limit.

    Raises
    ------
    SafetyStopError : names the joint, its value and its limit.
    """
    joints = np.asarray(joints_rad, dtype=np.float64)
    if joints.shape != (len(limits),):
        raise SafetyStopError(
            f"a joint target of shape {joints.shape}, the arm has {len(limits)} joints", cure="give one angle a joint"
        )
    j = int(first_outside(joints, limits))
    if j < 0:
        return
    if not np.isfinite(joints[j]):
        raise SafetyStopError(f"target of joint {j + 1} is {joints[j]}", cure="give a finite angle")
    low, high = np.degrees([limits.lower_rad[j], limits.upper_rad[j]])
    raise SafetyStopError(
        f"target of joint {j + 1} is {np.degrees(joints[j]):.2f} deg, its limits are {low:.1f} to {high:.1f} deg",
        cure="choose another target or configuration",
    )


def check_velocity(velocity_rad_s: FloatArray, limits: JointLimits) -> None:
    """Refuse joint speeds (J,) or (N, J) above their limits.

    Raises
    ------
    SafetyStopError : names the joint, its speed and its limit.
    """
    fastest = np.max(np.abs(np.atleast_2d(velocity_rad_s)), axis=0)
    # Written so that nan counts as too fast.
    too_fast = ~(fastest <= limits.velocity_rad_s * (1.0 + 1e-9))
    if np.any(too_fast):
        j = int(np.argmax(too_fast))
        raise SafetyStopError(
            f"joint {j + 1} would turn at {np.degrees(fastest[j]):.1f} deg/s, "
            f"its limit is {np.degrees(limits.velocity_rad_s[j]):.1f} deg/s",
            cure="move slower",
        )
