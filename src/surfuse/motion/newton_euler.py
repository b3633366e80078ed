"""The recursive Newton-Euler method as kernels, in the frames of the links (standard Denavit-Hartenberg form)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


class RigidArm(NamedTuple):
    """An arm of J joints as kernels take it, links in standard Denavit-Hartenberg form, SI units.

    `d`, `a` (m) and `alpha` (rad) (J,), `mass` (J,) in kg; `center` (J, 3) in m and `inertia` (J, 3, 3) in kg m^2 about
    it, in the frame of the link; `armature` (J,) in kg m^2, the motors as the joints see them; `gravity` (1,) in m/s^2
    along -z of the base.
    """

    d: FloatArray
    a: FloatArray
    alpha: FloatArray
    mass: FloatArray
    center: FloatArray
    inertia: FloatArray
    armature: FloatArray
    gravity: FloatArray


@compiled
def newton_euler(arm: RigidArm, q: FloatArray, qd: FloatArray, qdd: FloatArray, torque: FloatArray) -> None:
    """Write the torques (J,) of a motion (J,) into `torque`: Luh, Walker and Paul 1980, equations in link frames.

    `q` in rad, `qd` in rad/s, `qdd` in rad/s^2, torques in Nm; friction is not part of them.
    """
    d, a, alpha, mass = arm.d, arm.a, arm.alpha, arm.mass
    center, inertia, armature, gravity = arm.center, arm.inertia, arm.armature, arm.gravity
    n = q.shape[0]
    turn = np.empty((n, 3, 3))
    force = np.empty((n, 3))
    moment = np.empty((n, 3))
    spin = np.zeros(3)
    spin_rate = np.zeros(3)
    # An upward acceleration of the base is the same as gravity.
    lift = np.array([0.0, 0.0, gravity[0]])
    for j in range(n):
        _link_turn(q[j], alpha[j], turn[j])
        # w = R^T (w + z qd), and the same for its derivative.
        sx, sy, sz = spin_rate[0] + spin[1] * qd[j], spin_rate[1] - spin[0] * qd[j], spin_rate[2] + qdd[j]
        wx, wy, wz = spin[0], spin[1], spin[2] + qd[j]
        gx, gy, gz = lift[0], lift[1], lift[2]
        for r in range(3):
            spin_rate[r] = turn[j, 0, r] * sx + turn[j, 1, r] * sy + turn[j, 2, r] * sz
            spin[r] = turn[j, 0, r] * wx + turn[j, 1, r] * wy + turn[j, 2, r] * wz
            lift[r] = turn[j, 0, r] * gx + turn[j, 1, r] * gy + turn[j, 2, r] * gz
        _add_point(spin, spin_rate, a[j], d[j] * math.sin(alpha[j]), d[j] * math.cos(alpha[j]), lift)
        at_center = lift.copy()
        _add_point(spin, spin_rate, center[j, 0], center[j, 1], center[j, 2], at_center)
        for r in range(3):
            force[j, r] = mass[j] * at_center[r]
        _angular(inertia[j], spin, spin_rate, moment[j])
    _outside_in(arm, turn, force, moment, torque)
    for j in range(n):
        torque[j] += armature[j] * qdd[j]


@compiled
def _link_turn(q: float, alpha: float, turn: FloatArray) -> None:
    """Rotation of link j in the frame of link j - 1: Rz(q) Rx(alpha)."""
    cq, sq, ca, sa = math.cos(q), math.sin(q), math.cos(alpha), math.sin(alpha)
    turn[0, 0], turn[0, 1], turn[0, 2] = cq, -sq * ca, sq * sa
    turn[1, 0], turn[1, 1], turn[1, 2] = sq, cq * ca, -cq * sa
    turn[2, 0], turn[2, 1], turn[2, 2] = 0.0, sa, ca


@compiled
def _add_point(spin: FloatArray, rate: FloatArray, x: float, y: float, z: float, acceleration: FloatArray) -> None:
    """Add what spin and its rate give to the acceleration of a point: rate x p + spin x (spin x p)."""
    ux, uy, uz = spin[1] * z - spin[2] * y, spin[2] * x - spin[0] * z, spin[0] * y - spin[1] * x
    acceleration[0] += rate[1] * z - rate[2] * y + spin[1] * uz - spin[2] * uy
    acceleration[1] += rate[2] * x - rate[0] * z + spin[2] * ux - spin[0] * uz
    acceleration[2] += rate[0] * y - rate[1] * x + spin[0] * uy - spin[1] * ux


@compiled
def _angular(inertia: FloatArray, spin: FloatArray, rate: FloatArray, moment: FloatArray) -> None:
    """Euler's equation: I rate + spin x (I spin)."""
    hx = inertia[0, 0] * spin[0] + inertia[0, 1] * spin[1] + inertia[0, 2] * spin[2]
    hy = inertia[1, 0] * spin[0] + inertia[1, 1] * spin[1] + inertia[1, 2] * spin[2]
    hz = inertia[2, 0] * spin[0] + inertia[2, 1] * spin[1] + inertia[2, 2] * spin[2]
    for r in range(3):
        moment[r] = inertia[r, 0] * rate[0] + inertia[r, 1] * rate[1] + inertia[r, 2] * rate[2]
    moment[0] += spin[1] * hz - spin[2] * hy
    moment[1] += spin[2] * hx - spin[0] * hz
    moment[2] += spin[0] * hy - spin[1] * hx


@compiled
def _outside_in(arm: RigidArm, turn: FloatArray, force: FloatArray, moment: FloatArray, torque: FloatArray) -> None:
    """Pass forces and moments from the tip to the base; the part along each joint axis is its torque."""
    d, a, alpha, center = arm.d, arm.a, arm.alpha, arm.center
    n = torque.shape[0]
    f = np.zeros(3)
    m = np.zeros(3)
    for step in range(n):
        j = n - 1 - step
        px, py, pz = a[j], d[j] * math.sin(alpha[j]), d[j] * math.cos(alpha[j])
        cx, cy, cz = px + center[j, 0], py + center[j, 1], pz + center[j, 2]
        # f and m of link j + 1 act at the origin of frame j; about the origin of frame j - 1 they gain p x f.
        mx = m[0] + py * f[2] - pz * f[1] + cy * force[j, 2] - cz * force[j, 1] + moment[j, 0]
        my = m[1] + pz * f[0] - px * f[2] + cz * force[j, 0] - cx * force[j, 2] + moment[j, 1]
        mz = m[2] + px * f[1] - py * f[0] + cx * force[j, 1] - cy * force[j, 0] + moment[j, 2]
        fx, fy, fz = f[0] + force[j, 0], f[1] + force[j, 1], f[2] + force[j, 2]
        for r in range(3):
            f[r] = turn[j, r, 0] * fx + turn[j, r, 1] * fy + turn[j, r, 2] * fz
            m[r] = turn[j, r, 0] * mx + turn[j, r, 1] * my + turn[j, r, 2] * mz
        torque[j] = m[2]
