"""How fast a joint move may accelerate so that no motor is asked for more torque than it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.motion.limits import JointLimits
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray

_STILL_RAD = 1e-9
_FREE_RAD_S2 = 1e4  # for joints that do not take part in the move


def within_torque(
    dynamics: ArmDynamics,
    start_rad: FloatArray,
    end_rad: FloatArray,
    limits: JointLimits,
    torque_share: float = 0.75,
    samples: int = 9,
) -> JointLimits:
    """Limits whose accelerations (J,) take the straight joint move from start to end (J,) to its torque limit.

    Speed limits stay. On a straight line the torque is linear in the acceleration of the path coordinate (Bobrow,
    Dubowsky and Gibson, Int. J. Robotics Research 4(3), 1985), so the largest one follows directly, at `samples`
    places, at rest and at the highest speed. `torque_share`: share of the torque limits that may be planned with;
    the rest is for the control law.

    Raises
    ------
    SafetyStopError : gravity and friction alone need more torque than that.
    """
    if not 0.0 < torque_share <= 1.0:
        raise ConfigError(f"torque_share = {torque_share}", cure="give a share above 0, at most 1")
    change = np.subtract(end_rad, start_rad)
    size = np.abs(change)
    if not np.any(size > _STILL_RAD):
        return limits
    fastest = float(np.min(limits.velocity_rad_s / np.maximum(size, _STILL_RAD)))
    place = start_rad + np.linspace(0.0, 1.0, samples)[:, None] * change
    per_push = dynamics.rigid_torque(place, 0.0, change) - dynamics.gravity(place)
    room = np.inf
    for rate in (0.0, fastest):
        steady = dynamics.rigid_torque(place, rate * change, 0.0)
        dry = dynamics.friction(np.where(size > _STILL_RAD, np.sign(change) * 1e-12, 0.0))
        needed = steady + dry + dynamics.viscous_nm_s * rate * change
        left = torque_share * dynamics.torque_max_nm - np.abs(needed)
        if np.any(left <= 0.0):
            i, j = np.unravel_index(int(np.argmin(left / dynamics.torque_max_nm)), left.shape)
            raise SafetyStopError(
                f"joint {j + 1} needs {abs(needed[i, j]):.1f} N m against gravity and friction, "
                f"{torque_share * dynamics.torque_max_nm[j]:.1f} N m may be planned with",
                cure="lighten the tool, or move through another posture",
            )
        room = min(room, float(np.min(left / np.maximum(np.abs(per_push), 1e-12))))
    acceleration = np.where(size > _STILL_RAD, room * size, _FREE_RAD_S2)
    return replace(limits, acceleration_rad_s2=acceleration)
