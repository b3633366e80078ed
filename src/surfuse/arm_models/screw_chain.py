"""Kinematics of any chain of revolute joints as products of exponentials, and their inverse by damped least squares."""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray

_ROUNDS = 60
_DONE_M_RAD = 1e-10
_STEP_RAD = 0.5


@compiled
def _turn(axis: FloatArray, point: FloatArray, angle: float, out: FloatArray) -> None:
    """Rotation about a line in space as a pose: Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k
    for r in range(3):
        out[r, 3] = point[r] - out[r, 0] * point[0] - out[r, 1] * point[1] - out[r, 2] * point[2]


@compiled
def _product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    for r in range(3):
        for c in range(4):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]
        out[r, 3] += a[r, 3]


@compiled
def place(
    axis: FloatArray, point: FloatArray, q: FloatArray, home: FloatArray, frames: FloatArray, jacobian: FloatArray
) -> None:
    """Poses of the frames of links 1 to J and of the tool (J + 1, 4, 4), and the tool's Jacobian (6, J) in base axes.

    `axis`, `point` (J, 3): joint axes at angle 0; `home` (J + 1, 4, 4): the frames there (Brockett 1984; Lynch and
    Park, Modern Robotics, 2017, chapter 4).
    """
    n = q.shape[0]
    moved = np.zeros((4, 4))
    before = np.zeros((4, 4))
    one = np.zeros((4, 4))
    for r in range(3):
        moved[r, r] = 1.0
    for j in range(n):
        for r in range(3):
            jacobian[3 + r, j] = moved[r, 0] * axis[j, 0] + moved[r, 1] * axis[j, 1] + moved[r, 2] * axis[j, 2]
            jacobian[r, j] = (
                moved[r, 0] * point[j, 0] + moved[r, 1] * point[j, 1] + moved[r, 2] * point[j, 2] + moved[r, 3]
            )
        _turn(axis[j], point[j], q[j], one)
        before[:, :] = moved
        _product(before, one, moved)
        _product(moved, home[j], frames[j])
        frames[j, 3, 3] = 1.0
    _product(moved, home[n], frames[n])
    frames[n, 3, 3] = 1.0
    for j in range(n):
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        x = frames[n, 0, 3] - jacobian[0, j]
        y = frames[n, 1, 3] - jacobian[1, j]
        z = frames[n, 2, 3] - jacobian[2, j]
        jacobian[0, j], jacobian[1, j], jacobian[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


@compiled
def _error(target: FloatArray, tool: FloatArray, error: FloatArray) -> float:
    """Twist (6,) from the tool to the target in base axes, and its size (metres and radians alike)."""
    w = np.empty(3)
    trace = 0.0
    for r in range(3):
        error[r] = target[r, 3] - tool[r, 3]
        for c in range(3):
            trace += target[r, c] * tool[r, c]
    # Antisymmetric part of target tool^T.
    for r in range(3):
        a, b = (r + 1) % 3, (r + 2) % 3
        total = 0.0
        for c in range(3):
            total += target[b, c] * tool[a, c] - target[a, c] * tool[b, c]
        w[r] = 0.5 * total
    sine = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    angle = math.atan2(sine, 0.5 * (trace - 1.0))
    if sine > 1e-9:
        for r in range(3):
            error[3 + r] = w[r] * angle / sine
    elif trace < 0.0:
        # Half a turn has no unique axis: any will do to get away from it.
        error[3], error[4], error[5] = angle, 0.0, 0.0
    else:
        for r in range(3):
            error[3 + r] = w[r]
    total = 0.0
    for r in range(6):
        total += error[r] * error[r]
    return math.sqrt(total)


@compiled
def solve(
    axis: FloatArray,
    point: FloatArray,
    home: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    target: FloatArray,
    q: FloatArray,
) -> bool:
    """Move joints (J,) until the tool is at the target, within the limits; says whether it got there.

    Damped least squares (Levenberg and Marquardt; Wampler, IEEE Trans. Systems, Man and Cybernetics 16(1), 1986) with
    the damping tied to the error (Sugihara, IEEE Trans. Robotics 27(5), 2011).

    `axis`, `point` (J, 3), `home` (J + 1, 4, 4), `lower`, `upper` (J,) as in `ArmChain`; `target` (4, 4) is the pose of
    the tool in the base frame. `q` (J,) in rad is the start, and is moved in place also where it fails.
    """
    n = q.shape[0]
    frames = np.zeros((n + 1, 4, 4))
    jacobian = np.zeros((6, n))
    error = np.zeros(6)
    for _ in range(_ROUNDS):
        place(axis, point, q, home, frames, jacobian)
        size = _error(target, frames[n], error)
        if size < _DONE_M_RAD:
            return True
        square = np.zeros((6, 6))
        for r in range(6):
            for c in range(6):
                for j in range(n):
                    square[r, c] += jacobian[r, j] * jacobian[c, j]
            square[r, r] += 0.01 * size * size + 1e-12
        y = np.linalg.solve(square, error)
        step = np.zeros(n)
        longest = 0.0
        for j in range(n):
            for r in range(6):
                step[j] += jacobian[r, j] * y[r]
            longest = max(longest, abs(step[j]))
        shrink = min(1.0, _STEP_RAD / longest) if longest > 0.0 else 1.0
        for j in range(n):
            q[j] = min(max(q[j] + shrink * step[j], lower[j]), upper[j])
    return False


@compiled
def solve_along(
    axis: FloatArray,
    point: FloatArray,
    home: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    targets: FloatArray,
    seeds: FloatArray,
    spare: FloatArray,
) -> tuple[FloatArray, BoolArray]:
    """Joints (N, K, J) for targets (N, 4, 4): column k starts at seed k (K, J) and follows the targets from row to row.

    Where that fails the seed itself and then the spare starts (S, J) are tried. nan where none gets there; the next
    row then starts from the last one that did.

    `axis`, `point` (J, 3), `home` (J + 1, 4, 4), `lower`, `upper` (J,) as in `ArmChain`; also returned is which (N, K)
    got there. All joints in rad.
    """
    count, columns, n = targets.shape[0], seeds.shape[0], seeds.shape[1]
    joints = np.full((count, columns, n), np.nan)
    reached = np.zeros((count, columns), dtype=np.bool_)
    for k in range(columns):
        last = seeds[k].copy()
        for i in range(count):
            for attempt in range(2 + spare.shape[0]):
                q = last.copy() if attempt == 0 else (seeds[k].copy() if attempt == 1 else spare[attempt - 2].copy())
                if solve(axis, point, home, lower, upper, targets[i], q):
                    joints[i, k] = q
                    reached[i, k] = True
                    last = q
                    break
    return joints, reached


@compiled
def place_many(axis: FloatArray, point: FloatArray, home: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frames (N, J + 1, 4, 4) and Jacobians (N, 6, J) for joints (N, J)."""
    count, n = q.shape
    frames = np.zeros((count, n + 1, 4, 4))
    jacobians = np.zeros((count, 6, n))
    for i in range(count):
        place(axis, point, q[i], home, frames[i], jacobians[i])
    return frames, jacobians


def spread(count: int, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Joints (count, J) spread evenly over their limits: the middle, then the R sequence (Roberts 2018).

    `lower` and `upper` (J,) in rad.
    """
    n = len(lower)
    golden = 1.5
    for _ in range(60):
        golden = (1.0 + golden) ** (1.0 / (n + 1.0))
    step = golden ** -np.arange(1.0, n + 1.0)
    share = (0.5 + np.arange(count)[:, None] * step) % 1.0
    return np.asarray(lower + share * (upper - lower))


def distinct(joints: FloatArray, apart_rad: float) -> IntArray:
    """Indices of joint positions (N, J) that differ from all kept before them, nan left out."""
    kept: list[int] = []
    for i in range(len(joints)):
        if np.all(np.isfinite(joints[i])) and all(
            np.max(np.abs(np.angle(np.exp(1j * (joints[i] - joints[k]))))) > apart_rad for k in kept
        ):
            kept.append(i)
    return np.array(kept, dtype=np.int64)
