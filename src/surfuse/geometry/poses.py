"""Rigid poses as 4x4 arrays named `a_from_b`: `p_a = a_from_b @ p_b`."""

from __future__ import annotations

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
    """Invert poses (..., 4, 4) by the transpose of their rotation: exact for rigid poses."""
    rotation_t = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    result = np.zeros_like(a_from_b)
    result[..., :3, :3] = rotation_t
    result[..., :3, 3] = -(rotation_t @ a_from_b[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def transform_points(a_from_b: FloatArray, points_b: npt.ArrayLike) -> FloatArray:
    """Points (..., 3) of frame b, expressed in frame a."""
    points = np.asarray(points_b, dtype=np.float64)
    result: FloatArray = points @ a_from_b[:3, :3].T + a_from_b[:3, 3]
    return result


def rotate_vectors(a_from_b: FloatArray, vectors_b: npt.ArrayLike) -> FloatArray:
    """Free vectors (..., 3) of frame b, expressed in frame a."""
    result: FloatArray = np.asarray(vectors_b, dtype=np.float64) @ a_from_b[:3, :3].T
    return result


def rotation_about(axis: npt.ArrayLike, angle_rad: float) -> FloatArray:
    """Rotation matrix (3, 3) about an axis (3,), right-handed (Rodrigues' formula)."""
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
    """Which of some 4x4 arrays (..., 4, 4) are right-handed rigid poses: (...)."""
    rotation = poses[..., :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        square = rotation @ np.swapaxes(rotation, -1, -2)
        orthogonal = np.all(np.abs(square - np.eye(3)) <= tolerance + 1e-5 * np.eye(3), axis=(-1, -2))
        right = np.einsum("...k,...k->...", np.cross(rotation[..., 0], rotation[..., 1]), rotation[..., 2]) > 0.0
        end = np.array([0.0, 0.0, 0.0, 1.0])
        last = np.all(np.abs(poses[..., 3, :] - end) <= 1e-8 + 1e-5 * end, axis=-1)
    return np.asarray(orthogonal & right & last & np.all(np.isfinite(poses), axis=(-1, -2)), dtype=np.bool_)


def is_rigid(matrix: FloatArray, tolerance: float = 1e-6) -> bool:
    """Whether a 4x4 array is a right-handed rigid pose."""
    return matrix.shape == (4, 4) and bool(are_rigid(matrix, tolerance))
