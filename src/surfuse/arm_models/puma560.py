"""The PUMA 560: its published constants and its kinematics with all eight inverse solutions in closed form."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from surfuse.arm_models.puma560_closed_form import all_solutions, into_limits
from surfuse.errors import DataError
from surfuse.geometry.chains import Chain
from surfuse.geometry.poses import inverse as inverted
from surfuse.geometry.poses import is_rigid, pose
from surfuse.motion.choice import nearest_configuration
from surfuse.motion.limits import JointLimits
from surfuse.records import BoolArray, FloatArray, IntArray

# Standard Denavit-Hartenberg parameters (Paul and Zhang 1986; Corke, Robotics Toolbox, models/DH/Puma560.py).
# d1 is the height of the shoulder above the foot of the pedestal, 26.45 inches.
D_M = (0.67183, 0.0, 0.15005, 0.4318, 0.0, 0.0)
A_M = (0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0)
ALPHA_RAD = (np.pi / 2, 0.0, -np.pi / 2, np.pi / 2, -np.pi / 2, 0.0)

# Mounting flange in front of the wrist centre (Fu, Gonzalez and Lee, Robotics, 1987); the chain above ends in
# the wrist centre, so the flange belongs to the tool transform.
FLANGE_OFFSET_M = 0.05625

# Position limits: Wang and Chen, IEEE Trans. Robotics and Automation 7(4), 1991. Speeds and accelerations: the data
# set that later papers attribute to Lin, Chang and Luh, IEEE Trans. Automatic Control 28(12), 1983.
LIMITS = JointLimits(
    lower_rad=np.radians([-160.0, -45.0, -225.0, -110.0, -100.0, -266.0]),
    upper_rad=np.radians([160.0, 225.0, 45.0, 170.0, 100.0, 266.0]),
    velocity_rad_s=np.radians([100.0, 95.0, 100.0, 150.0, 130.0, 110.0]),
    acceleration_rad_s2=np.radians([45.0, 40.0, 75.0, 70.0, 90.0, 80.0]),
)

# Joint angle of one encoder count (Trident ROBOT.C v4.3; 800 to 1000 counts a motor turn through the gears).
ENCODER_RAD_PER_COUNT = (1.0035e-4, 7.3156e-5, 1.17e-4, 8.2663e-5, 8.7376e-5, 8.1885e-5)

# Stand under the pedestal in the cell with the ring table (height 1.00 m): a part on the table, scanned from 0.43 m
# with the array 0.08 m in front of the wrist, then lies in the middle of the reach of one configuration (right arm,
# elbow up, wrist flipped), at least 30 degrees from the limits of joints 2 to 6 and far from all singularities.
STAND_HEIGHT_M = 0.50

# Elbow up, forearm folded back, tool level and pointing outwards: clear of the table at every angle of joint 1.
READY_RAD = np.radians([0.0, 80.0, -215.0, 0.0, 45.0, 0.0])
READY_RAD.setflags(write=False)

# Corke's names of the eight configurations: left or right arm, elbow up or down, wrist not flipped or flipped.
CONFIGURATIONS = ("lun", "luf", "ldn", "ldf", "run", "ruf", "rdn", "rdf")

SINGULARITIES = ("shoulder alignment", "elbow", "wrist")

# What a joint's motion costs when solutions are compared: the reach of the arm beyond it, in metres.
JOINT_WEIGHTS = (1.0, 1.0, 0.6, 0.25, 0.25, 0.1)

_UPPER_ARM_M = A_M[1]
_FOREARM_M = float(np.hypot(A_M[2], D_M[3]))
_FOREARM_ANGLE_RAD = float(np.arctan2(D_M[3], A_M[2]))


class Puma560:
    """Kinematics of a PUMA 560 that stands at `world_from_base` and carries a tool at `flange_from_tool`.

    The base frame lies at the foot of the pedestal, z along joint 1. The flange frame has its origin in the flange
    (see `FLANGE_OFFSET_M`), z out of it.
    """

    def __init__(self, world_from_base: FloatArray, flange_from_tool: FloatArray) -> None:
        for name, value in (("world_from_base", world_from_base), ("flange_from_tool", flange_from_tool)):
            if not is_rigid(np.asarray(value, dtype=np.float64)):
                raise DataError(f"{name} of the PUMA 560 is not a right-handed rigid pose")
        wrist_from_tool = pose(np.eye(3), [0.0, 0.0, FLANGE_OFFSET_M]) @ flange_from_tool
        self._chain = Chain(np.array(D_M), np.array(A_M), np.array(ALPHA_RAD), world_from_base, wrist_from_tool)
        self._base_from_world = inverted(self._chain.world_from_base)
        self._tool_from_wrist = inverted(self._chain.flange_from_tool)
        self._sizes = np.array([D_M[0], A_M[1], A_M[2], D_M[2], D_M[3]])

    @property
    def lower_rad(self) -> FloatArray:
        """Lower joint limits (6,)."""
        return LIMITS.lower_rad

    @property
    def upper_rad(self) -> FloatArray:
        """Upper joint limits (6,)."""
        return LIMITS.upper_rad

    @property
    def singularities(self) -> tuple[str, ...]:
        """Names of the singularities, in the order of `singularity_distance`."""
        return SINGULARITIES

    def forward(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Pose of the tool in the world: joints (..., 6) -> (..., 4, 4).

        Joints in rad, lengths in m.
        """
        return self._chain.forward(joints_rad)

    def link_poses(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Poses (..., 8, 4, 4) in the world of base, links 1 to 6 and tool.

        For joints (..., 6) in rad.
        """
        return self._chain.link_poses(joints_rad)

    def jacobian(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Geometric Jacobian (..., 6, 6) of the tool in world axes, linear rows first.

        For joints (..., 6) in rad: m/s and rad/s of the tool per rad/s of a joint.
        """
        return self._chain.jacobian(joints_rad)

    def inverse(self, world_from_tool: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """All eight solutions for poses (N, 4, 4): joints (N, 8, 6), and which (N, 8) lie within the joint limits.

        Column k is configuration `CONFIGURATIONS[k]`. Joints are shifted by whole turns into their limits where that
        is possible; they are nan where the pose is out of reach.
        """
        joints = self.solutions(world_from_tool)
        return joints, into_limits(joints, self.lower_rad, self.upper_rad)

    def solutions(self, world_from_tool: npt.ArrayLike) -> FloatArray:
        """All eight solutions (N, 8, 6) in [-pi, pi], whatever the joint limits; nan where out of reach.

        For poses (N, 4, 4) of the tool in the world.

        Raises
        ------
        DataError : the poses are not (N, 4, 4).
        """
        poses = np.ascontiguousarray(world_from_tool, dtype=np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise DataError(f"poses have shape {poses.shape}, wanted (N, 4, 4)")
        return all_solutions(poses, self._base_from_world, self._tool_from_wrist, self._sizes)

    def nearest_configuration(
        self, solutions_rad: FloatArray, valid: BoolArray, current_rad: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """The valid solution nearest to the current joints: (N, 6) and its index (N,); nan and -1 where none is."""
        return nearest_configuration(solutions_rad, valid, current_rad, self.lower_rad, self.upper_rad, JOINT_WEIGHTS)

    def singularity_distance(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """How far joints (..., 6) are from each singularity: (..., 3) in [0, 1], 0 on it, order `SINGULARITIES`.

        Shoulder alignment: distance of the wrist centre from the plane of joint 1 and the shoulder offset, as a share
        of the longest reach. Elbow: sine of the angle between upper arm and forearm. Wrist: sine of joint 5
        (Lee and Ziegler 1984).
        """
        q = np.asarray(joints_rad, dtype=np.float64)
        bend = q[..., 2] + _FOREARM_ANGLE_RAD
        ahead = _UPPER_ARM_M * np.cos(q[..., 1]) + _FOREARM_M * np.cos(q[..., 1] + bend)
        alignment = np.abs(ahead) / (_UPPER_ARM_M + _FOREARM_M)
        return np.stack([alignment, np.abs(np.sin(bend)), np.abs(np.sin(q[..., 4]))], axis=-1)


def create(world_from_base: FloatArray, flange_from_tool: FloatArray) -> Puma560:
    """The kinematics of a PUMA 560 at this place with this tool.

    Both are poses (4, 4).
    """
    return Puma560(world_from_base, flange_from_tool)
