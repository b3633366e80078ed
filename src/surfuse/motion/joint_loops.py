"""The loops of joints that are controlled one by one, as kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.motion.control_law import LoopGains
from surfuse.records import FloatArray


class JointLoops(NamedTuple):
    """PID of J joints at a fixed period. `integral` (J,) in Nm moves on; the rest is constant.

    `kp` (Nm/rad), `kd` (Nm s/rad), `ki` (Nm/(rad s)) and `limit` (Nm, largest torque) are (J,). `dead_band` (rad):
    smaller errors are not integrated. `period` in s.
    """

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    limit: FloatArray
    integral: FloatArray
    dead_band: float
    period: float


def joint_loops(gains: LoopGains, inertia_kg_m2: FloatArray, limit_nm: FloatArray, period_s: float) -> JointLoops:
    """Loops of the wanted natural frequency and damping for joints of fixed inertia (J,), with empty integrators.

    With the inertia I and the natural frequency w: kp = I w^2, kd = 2 I damping w, ki = I integral_share w^3.
    `limit_nm` (J,) is the largest torque of each joint.
    """
    w = gains.natural_rad_s
    return JointLoops(
        kp=inertia_kg_m2 * w**2,
        kd=inertia_kg_m2 * 2.0 * gains.damping * w,
        ki=inertia_kg_m2 * gains.integral_share * w**3,
        limit=limit_nm,
        integral=np.zeros(len(inertia_kg_m2)),
        dead_band=gains.dead_band_rad,
        period=period_s,
    )
