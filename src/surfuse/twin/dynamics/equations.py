"""Equations of motion of a serial arm in world axes: composite bodies for the inertia, Newton and Euler for the rest.

The twin has its own formulas, unlike those of the controllers, so that a mistake in one shows against the other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled, inlined
from surfuse.records import FloatArray


class Bodies(NamedTuple):
    """The J links of an arm in standard Denavit-Hartenberg form.

    `d`, `a` (m), `alpha` (rad) and `mass` (kg) are (J,); `center` (J, 3) in m and `inertia` (J, 3, 3) in kg m^2, about
    the centre, are in the frame of the link. `gravity` in m/s^2, along -z of the base.
    """

    d: FloatArray
    a: FloatArray
    alpha: FloatArray
    mass: FloatArray
    center: FloatArray
    inertia: FloatArray
    gravity: float


class Frames(NamedTuple):
    """Where the links are, in world axes: written anew for every position.

    `axis` (J, 3) unit vectors of the joints, `origin` (J + 1, 3) of the base and of the link frames in m, `place`
    (J, 3) centres of gravity in m, `spun` (J, 3, 3) inertias about them in kg m^2.
    """

    axis: FloatArray
    origin: FloatArray
    place: FloatArray
    spun: FloatArray


class Scratch(NamedTuple):
    """Memory of `motion_terms`, made once: asking for it at every step would take as long as the step.

    Room for forces and moments of the links (2, J, 3), for six vectors (6, 3), for two matrices (2, 3, 3).
    """

    frames: Frames
    forces: FloatArray
    small: FloatArray
    square: FloatArray


def scratch_of(joints: int) -> Scratch:
    """Memory for an arm of J joints; its content does not matter."""
    frames = Frames(np.empty((joints, 3)), np.empty((joints + 1, 3)), np.empty((joints, 3)), np.empty((joints, 3, 3)))
    return Scratch(frames, np.empty((2, joints, 3)), np.empty((6, 3)), np.empty((2, 3, 3)))


@inlined
def motion_terms(
    bodies: Bodies, q: FloatArray, qd: FloatArray, matrix: FloatArray, bias: FloatArray, scratch: Scratch
) -> None:
    """Write inertia (J, J) without motors and bias torques (J,) (Coriolis, centrifugal, gravity) of a state (J,).

    The inertia is that of composite bodies (Walker and Orin, J. Dynamic Systems, Measurement and Control 104(3),
    1982): column j is the momentum of everything beyond joint j when that joint alone turns at unit speed.
    `scratch` is what `scratch_of(J)` gives; its content does not matter.

    `q` (J,) in rad, `qd` (J,) in rad/s; inertia in kg m^2, torques in Nm.
    """
    _links(bodies, q, scratch.frames, scratch.square)
    _composite(scratch.frames, bodies.mass, matrix, scratch.small, scratch.square)
    _bias(bodies, scratch.frames, qd, bias, scratch.forces, scratch.small)


@inlined
def _links(bodies: Bodies, q: FloatArray, frames: Frames, square: FloatArray) -> None:
    """Write where the links are at joints (J,) in rad."""
    d, a, alpha, center, inertia = bodies.d, bodies.a, bodies.alpha, bodies.center, bodies.inertia
    axis, origin, place, spun = frames
    turn, half = square[0], square[1]
    turn[:] = 0.0
    turn[0, 0], turn[1, 1], turn[2, 2] = 1.0, 1.0, 1.0
    origin[0] = 0.0
    for j in range(q.shape[0]):
        cq, sq, ca, sa = math.cos(q[j]), math.sin(q[j]), math.cos(alpha[j]), math.sin(alpha[j])
        for r in range(3):
            x, y, z = turn[r, 0], turn[r, 1], turn[r, 2]
            axis[j, r] = z
            along, across = x * cq + y * sq, y * cq - x * sq
            turn[r, 0], turn[r, 1], turn[r, 2] = along, across * ca + z * sa, z * ca - across * sa
            origin[j + 1, r] = origin[j, r] + a[j] * along + d[j] * z
        for r in range(3):
            place[j, r] = (
                origin[j + 1, r] + turn[r, 0] * center[j, 0] + turn[r, 1] * center[j, 1] + turn[r, 2] * center[j, 2]
            )
            for c in range(3):
                half[r, c] = (
                    turn[r, 0] * inertia[j, 0, c] + turn[r, 1] * inertia[j, 1, c] + turn[r, 2] * inertia[j, 2, c]
                )
        for r in range(3):
            for c in range(3):
                spun[j, r, c] = half[r, 0] * turn[c, 0] + half[r, 1] * turn[c, 1] + half[r, 2] * turn[c, 2]


@inlined
def _composite(frames: Frames, mass: FloatArray, matrix: FloatArray, small: FloatArray, square: FloatArray) -> None:
    """Write the inertia (J, J); mass and moments of the links beyond a joint are summed up from the tip."""
    axis, origin, place, spun = frames
    n = mass.shape[0]
    total = 0.0
    first, second = small[0], square[0]
    first[:] = 0.0
    second[:] = 0.0
    for step in range(n):
        j = n - 1 - step
        m = mass[j]
        c = place[j]
        squared = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        total += m
        for r in range(3):
            first[r] += m * c[r]
            for k in range(3):
                second[r, k] += spun[j, r, k] - m * c[r] * c[k]
            second[r, r] += m * squared
        z, o = axis[j], origin[j]
        hx, hy, hz = first[0] - total * o[0], first[1] - total * o[1], first[2] - total * o[2]
        px, py, pz = z[1] * hz - z[2] * hy, z[2] * hx - z[0] * hz, z[0] * hy - z[1] * hx
        ux, uy, uz = z[1] * o[2] - z[2] * o[1], z[2] * o[0] - z[0] * o[2], z[0] * o[1] - z[1] * o[0]
        # Angular momentum about the world's origin: second z - first x (z x o).
        lx = second[0, 0] * z[0] + second[0, 1] * z[1] + second[0, 2] * z[2] - (first[1] * uz - first[2] * uy)
        ly = second[1, 0] * z[0] + second[1, 1] * z[1] + second[1, 2] * z[2] - (first[2] * ux - first[0] * uz)
        lz = second[2, 0] * z[0] + second[2, 1] * z[1] + second[2, 2] * z[2] - (first[0] * uy - first[1] * ux)
        for i in range(j + 1):
            s, b = axis[i], origin[i]
            value = s[0] * (lx - b[1] * pz + b[2] * py)
            value += s[1] * (ly - b[2] * px + b[0] * pz)
            value += s[2] * (lz - b[0] * py + b[1] * px)
            matrix[i, j] = value
            matrix[j, i] = value


@inlined
def _bias(
    bodies: Bodies, frames: Frames, qd: FloatArray, bias: FloatArray, forces: FloatArray, small: FloatArray
) -> None:
    """Write the torques (J,) that speeds (J,) and weight need: accelerations outwards, then forces and moments inwards.

    An upward acceleration of the base is the same as gravity.
    """
    axis, origin, place, spun = frames
    mass, gravity = bodies.mass, bodies.gravity
    n = mass.shape[0]
    force, moment = forces[0], forces[1]
    w, e, point, there, f, m = small[0], small[1], small[2], small[3], small[4], small[5]
    small[:] = 0.0
    point[2] = gravity
    for j in range(n):
        z = axis[j]
        e[0] += (w[1] * z[2] - w[2] * z[1]) * qd[j]
        e[1] += (w[2] * z[0] - w[0] * z[2]) * qd[j]
        e[2] += (w[0] * z[1] - w[1] * z[0]) * qd[j]
        for r in range(3):
            w[r] += z[r] * qd[j]
        _carry(w, e, origin[j], place[j], point, there)
        h = spun[j]
        lx = h[0, 0] * w[0] + h[0, 1] * w[1] + h[0, 2] * w[2]
        ly = h[1, 0] * w[0] + h[1, 1] * w[1] + h[1, 2] * w[2]
        lz = h[2, 0] * w[0] + h[2, 1] * w[1] + h[2, 2] * w[2]
        for r in range(3):
            force[j, r] = mass[j] * there[r]
            moment[j, r] = h[r, 0] * e[0] + h[r, 1] * e[1] + h[r, 2] * e[2]
        c = place[j]
        moment[j, 0] += w[1] * lz - w[2] * ly + c[1] * force[j, 2] - c[2] * force[j, 1]
        moment[j, 1] += w[2] * lx - w[0] * lz + c[2] * force[j, 0] - c[0] * force[j, 2]
        moment[j, 2] += w[0] * ly - w[1] * lx + c[0] * force[j, 1] - c[1] * force[j, 0]
        _carry(w, e, origin[j], origin[j + 1], point, there)
        for r in range(3):
            point[r] = there[r]
    for step in range(n):
        j = n - 1 - step
        for r in range(3):
            f[r] += force[j, r]
            m[r] += moment[j, r]
        z, o = axis[j], origin[j]
        bias[j] = z[0] * (m[0] - o[1] * f[2] + o[2] * f[1])
        bias[j] += z[1] * (m[1] - o[2] * f[0] + o[0] * f[2])
        bias[j] += z[2] * (m[2] - o[0] * f[1] + o[1] * f[0])


@compiled
def _carry(
    w: FloatArray, e: FloatArray, start: FloatArray, end: FloatArray, known: FloatArray, out: FloatArray
) -> None:
    """Acceleration of a point of a body from that of another: known + e x r + w x (w x r)."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    ux, uy, uz = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    out[0] = known[0] + e[1] * z - e[2] * y + w[1] * uz - w[2] * uy
    out[1] = known[1] + e[2] * x - e[0] * z + w[2] * ux - w[0] * uz
    out[2] = known[2] + e[0] * y - e[1] * x + w[0] * uy - w[1] * ux
