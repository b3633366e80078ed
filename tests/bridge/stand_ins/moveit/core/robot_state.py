"""What moveit_py offers in RobotState, as far as the example uses it."""

import math

import numpy as np
from geometry_msgs.msg import Pose


def matrix_of(pose):
    """4 x 4 of a message (the formula of the quaternion's rotation matrix)."""
    x, y, z, w = (getattr(pose.orientation, name) for name in "xyzw")
    assert abs(x * x + y * y + z * z + w * w - 1.0) < 1e-9, "a quaternion of unit length"
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return matrix


class RobotState:
    def __init__(self, robot_model):
        assert robot_model == "model"
        self._tip, self.dirty = np.eye(4), True

    def set_from_ik(self, joint_model_group_name, geometry_pose, tip_name, timeout=0.0):
        assert isinstance(geometry_pose, Pose)
        assert (joint_model_group_name, tip_name) == ("manipulator", "tool0")
        where = geometry_pose.position
        self._tip, self.dirty = matrix_of(geometry_pose), True
        return math.hypot(where.x, where.y, where.z) <= 0.9

    def update(self, force=False, type="all"):
        self.dirty = False

    def get_global_link_transform(self, link_name):
        assert link_name == "tool0"
        assert not self.dirty, "update() comes first"
        return self._tip
