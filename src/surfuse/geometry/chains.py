"""Serial chains of revolute joints in standard Denavit-Hartenberg form: link poses, tool pose, Jacobian."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.compiled import compiled

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """J revolute joints: link j is Rz(q_j) Tz(d_j) Tx(a_j) Rx(alpha_j) (standard Denavit-Hartenberg, Paul 1981).

    `d_m`, `a_m`, `alpha_rad` (J,); `world_from_base` and `flange_from_tool` (4, 4) stand before the first and
    after the last link.
    """

    d_m: FloatArray
    a_m: FloatArray
    alpha_rad: FloatArray
    world_from_base: FloatArray
    flange_from_tool: FloatArray

    def __post_init__(self) -> None:
        joints = np.size(self.d_m)
        for name, shape in (
            ("d_m", (joints,)),
            ("a_m", (joints,)),
            ("alpha_rad", (joints,)),
            ("world_from_base", (4, 4)),
            ("flange_from_tool", (4, 4)),
        ):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise DataError(f"Chain.{name} has shape {value.shape}, wanted {shape} with finite values")
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def link_poses(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Poses (..., J + 2, 4, 4) in the world of base, link 1 .. link J, tool, for joints (..., J)."""
        joints, lead = self._rows(joints_rad)
        poses = _link_poses(self.d_m, self.a_m, self.alpha_rad, self.world_from_base, self.flange_from_tool, joints)
        return poses.reshape(*lead, len(self.d_m) + 2, 4, 4)

    def forward(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Pose of the tool in the world: joints (..., J) -> (..., 4, 4)."""
        joints, lead = self._rows(joints_rad)
        poses = _tool_poses(self.d_m, self.a_m, self.alpha_rad, self.world_from_base, self.flange_from_tool, joints)
        return poses.reshape(*lead, 4, 4)

    def jacobian(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Geometric Jacobian (..., 6, J) of the tool's origin in world axes: rows vx, vy, vz, wx, wy, wz per rad/s."""
        links = self.link_poses(joints_rad)
        # Joint j turns about the z axis of link j - 1.
        axis, origin = links[..., :-2, :3, 2], links[..., :-2, :3, 3]
        linear = np.cross(axis, links[..., -1:, :3, 3] - origin)
        return np.swapaxes(np.concatenate([linear, axis], axis=-1), -1, -2)

    def _rows(self, joints_rad: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        # A copy of one's own: a kernel is compiled anew for arrays that are read-only.
        joints = np.array(joints_rad, dtype=np.float64, order="C")
        if joints.ndim == 0 or joints.shape[-1] != len(self.d_m):
            raise DataError(f"joint positions have shape {joints.shape}, wanted (..., {len(self.d_m)})")
        return joints.reshape(-1, len(self.d_m)), joints.shape[:-1]


@compiled
def _copy(pose: FloatArray, result: FloatArray) -> None:
    """Write a pose into result, entry by entry: a slice that is assigned takes a second to compile."""
    for r in range(4):
        for c in range(4):
            result[r, c] = pose[r, c]


@compiled
def _times_link(pose: FloatArray, q: float, d: float, a: float, alpha: float, result: FloatArray) -> None:
    """Write pose @ Rz(q) Tz(d) Tx(a) Rx(alpha) into result; pose and result may be the same array."""
    cq, sq, ca, sa = math.cos(q), math.sin(q), math.cos(alpha), math.sin(alpha)
    for r in range(3):
        x, y, z = pose[r, 0], pose[r, 1], pose[r, 2]
        forward = x * cq + y * sq
        sideways = y * cq - x * sq
        result[r, 3] = pose[r, 3] + a * forward + d * z
        result[r, 0] = forward
        result[r, 1] = sideways * ca + z * sa
        result[r, 2] = z * ca - sideways * sa


@compiled
def _times_pose(a: FloatArray, b: FloatArray, result: FloatArray) -> None:
    """Write the product of two rigid poses into result, which must be neither of them."""
    for r in range(3):
        for c in range(4):
            result[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]
        result[r, 3] += a[r, 3]


@compiled
def _link_poses(
    d: FloatArray, a: FloatArray, alpha: FloatArray, base: FloatArray, tool: FloatArray, joints: FloatArray
) -> FloatArray:
    n, j = joints.shape
    poses = np.zeros((n, j + 2, 4, 4))
    poses[:, :, 3, 3] = 1.0
    for i in range(n):
        _copy(base, poses[i, 0])
        for k in range(j):
            _times_link(poses[i, k], joints[i, k], d[k], a[k], alpha[k], poses[i, k + 1])
        _times_pose(poses[i, j], tool, poses[i, j + 1])
    return poses


@compiled
def _tool_poses(
    d: FloatArray, a: FloatArray, alpha: FloatArray, base: FloatArray, tool: FloatArray, joints: FloatArray
) -> FloatArray:
    n, j = joints.shape
    poses = np.zeros((n, 4, 4))
    link = np.empty((4, 4))
    for i in range(n):
        _copy(base, link)
        for k in range(j):
            _times_link(link, joints[i, k], d[k], a[k], alpha[k], link)
        _times_pose(link, tool, poses[i])
        poses[i, 3, 3] = 1.0
    return poses
