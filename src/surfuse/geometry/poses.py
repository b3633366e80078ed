"""Rigid poses as 4x4 arrays named `a_from_b`: `p_a = a_from_b @ p_b`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def pose(rotation: npt.ArrayLike, translation_m: npt.ArrayLike) -> FloatArray:
    """Assemble a pose (4, 4) from a rotation (3, 3) and a translation (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation_m
    return matrix


def inverse(a_from_b: FloatArray) -> FloatArray:
    """Invert poses (..., 4, 4) by the transpose of their rotation: exact for rigid poses.

    `a_from_b` becomes `b_from_a`. What is not rigid is not noticed: see `is_rigid`.
    """
    rotation_t = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    result = np.zeros_like(a_from_b)
    result[..., :3, :3] = rotation_t
    result[..., :3, 3] = -(rotation_t @ a_from_b[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def transform_points(a_from_b: FloatArray, points_b: npt.ArrayLike) -> FloatArray:
    """Points (..., 3) of frame b, expressed in frame a.

    `a_from_b` (4, 4) is one pose for all points.
    """
    points = np.asarray(points_b, dtype=np.float64)
    result: FloatArray = points @ a_from_b[:3, :3].T + a_from_b[:3, 3]
    return result


def rotate_vectors(a_from_b: FloatArray, vectors_b: npt.ArrayLike) -> FloatArray:
    """Free vectors (..., 3) of frame b, expressed in frame a.

    `a_from_b` (4, 4) is one pose for all vectors; only its rotation counts.
    """
    result: FloatArray = np.asarray(vectors_b, dtype=np.float64) @ a_from_b[:3, :3].T
    return result


def rotation_about(axis: npt.ArrayLike, angle_rad: float) -> FloatArray:
    """Rotation matrix (3, 3) about an axis (3,), right-handed (Rodrigues' formula).

    The axis need not have unit length.

    Raises
    ------
    DataError : the axis has no length.
    """
    direction = np.asarray(axis, dtype=np.float64)
    norm = float(np.linalg.norm(direction))
    if not norm > 0.0:
        raise DataError(f"rotation axis {direction.tolist()} has length {norm}", cure="give a non-zero axis")
    x, y, z = direction / norm
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result: FloatArray = np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * (cross @ cross)
    return result


def frame_from_axes(origin_m: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> FloatArray:
    """`world_from_part` from its origin and the directions of its u and v axes; w = u x v.

    u keeps its direction, v is made perpendicular to it.

    `origin_m` (3,) in m, `u` and `v` (3,) of any length, all in the world; the pose is (4, 4).

    Raises
    ------
    DataError : if u and v are zero, not finite, or within 1 degree of parallel.
    """
    u_axis, v_axis = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    origin = np.asarray(origin_m, dtype=np.float64)
    if not (np.all(np.isfinite(u_axis)) and np.all(np.isfinite(v_axis)) and np.all(np.isfinite(origin))):
        raise DataError("a part frame must have finite origin, u and v", cure="check the frame file")
    u_norm, v_norm = float(np.linalg.norm(u_axis)), float(np.linalg.norm(v_axis))
    if not (u_norm > 0.0 and v_norm > 0.0):
        raise DataError("an axis of the part frame has length 0", cure="give u and v as non-zero vectors")
    u_axis, v_axis = u_axis / u_norm, v_axis / v_norm
    v_axis = v_axis - (v_axis @ u_axis) * u_axis
    if float(np.linalg.norm(v_axis)) < np.sin(np.radians(1.0)):
        raise DataError("u and v of the part frame are parallel", cure="give two different directions")
    v_axis = v_axis / np.linalg.norm(v_axis)
    return pose(np.column_stack([u_axis, v_axis, np.cross(u_axis, v_axis)]), origin)


def are_rigid(poses: FloatArray, tolerance: float = 1e-6) -> BoolArray:
    """Which of some 4x4 arrays (..., 4, 4) are right-handed rigid poses: (...).

    Their axes may be off a right angle by `tolerance` (as a cosine), and off unit length by little more.
    """
    # Entry by entry over all poses: a million of them are checked in a moment.
    entries = np.ascontiguousarray(np.moveaxis(poses, (-2, -1), (0, 1)))
    x, y, z = entries[:3, 0], entries[:3, 1], entries[:3, 2]
    with np.errstate(invalid="ignore", over="ignore"):
        good = np.isfinite(entries[0, 3] + entries[1, 3] + entries[2, 3])
        for one in (x, y, z):
            good &= np.abs(_dot(one, one) - 1.0) <= tolerance + 1e-5
        for one, other in ((x, y), (y, z), (z, x)):
            good &= np.abs(_dot(one, other)) <= tolerance
        turned = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
        good &= _dot(turned, z) > 0.0
        for entry, wanted in zip(entries[3], (0.0, 0.0, 0.0, 1.0), strict=True):
            good &= np.abs(entry - wanted) <= 1e-8 + 1e-5 * wanted
    return np.asarray(good, dtype=np.bool_)


def _dot(one: Sequence[FloatArray] | FloatArray, other: FloatArray) -> FloatArray:
    """Scalar products of vectors given by their three entries."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2], dtype=np.float64)


def is_rigid(matrix: FloatArray, tolerance: float = 1e-6) -> bool:
    """Whether a 4x4 array is a right-handed rigid pose.

    `matrix` (4, 4); any other shape is none. `tolerance` as in `are_rigid`.
    """
    return matrix.shape == (4, 4) and bool(are_rigid(matrix, tolerance))
