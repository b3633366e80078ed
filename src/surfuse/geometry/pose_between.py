"""Poses between two poses: straight lines and shortest turns, both at constant speed."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from surfuse.geometry.poses import FloatArray


def poses_between(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    """Poses (N, 4, 4) at shares (N,) of the way from `first` to `second` (4, 4), 0: the first.

    The turn is the spherical linear interpolation (Shoemake, 1985): a constant speed about the one axis of the shortest
    turn.
    """
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    poses = np.tile(np.eye(4), (len(share), 1, 1))
    poses[:, :3, :3] = first[:3, :3] @ Rotation.from_rotvec(share[:, None] * turn).as_matrix()
    poses[:, :3, 3] = first[:3, 3] + share[:, None] * (second[:3, 3] - first[:3, 3])
    return poses
