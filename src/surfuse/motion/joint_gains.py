"""Gains of joints that are controlled one by one, as kernels take them."""

from __future__ import annotations

import numpy as np

from surfuse.motion.control_law import LoopGains
from surfuse.records import FloatArray

STIFFNESS, DAMPING, INTEGRAL, LIMIT = 0, 1, 2, 3
"""Rows of the gains of J joints, in Nm/rad, Nm s/rad, Nm/rad a tick, and Nm (largest torque)."""


def joint_gains(gains: LoopGains, inertia_kg_m2: FloatArray, limit_nm: FloatArray, period_s: float) -> FloatArray:
    """Gains (4, J) of the wanted natural frequency and damping, for joints of fixed inertia (J,), see the rows.

    With the inertia I and the natural frequency w: stiffness I w^2, damping 2 I damping w, integral action
    I integral_share w^3 times the period. `limit_nm` (J,) is the largest torque of each joint. One array, because the
    law hands it to its kernel at every tick, and every array more costs a tenth of a microsecond.
    """
    w = gains.natural_rad_s
    stiffness, damping = inertia_kg_m2 * w**2, inertia_kg_m2 * 2.0 * gains.damping * w
    return np.array([stiffness, damping, period_s * (inertia_kg_m2 * gains.integral_share * w**3), limit_nm])
