"""Any arm from a file: MJCF or URDF with a named tool frame, read by MuJoCo (extra `dynamics`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from surfuse.arm_models.arm_file import ArmChain, read_arm
from surfuse.arm_models.closed_form import closed_form, in_columns
from surfuse.arm_models.screw_chain import distinct, place_many, solve_along, spread
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import inverse as inverted
from surfuse.geometry.poses import is_rigid
from surfuse.motion.body import Capsule
from surfuse.motion.limits import JointLimits
from surfuse.records import BoolArray, FloatArray

SINGULARITIES = ("loss of a direction",)

_COLUMNS = 16  # configurations of a closed form: eight, and room for those that come and go

_SPARE_STARTS = 3  # few: every pose out of reach pays for all of them


@dataclass(frozen=True)
class Parameters:
    """What an arm file does not say, and how hard the inverse is searched for.

    `velocity_rad_s`, `acceleration_rad_s2`: limits of every joint. `configurations`: most solutions that are followed
    through a list of poses; `starts`: joint positions, spread over the limits, from which they are looked for.
    `reach_m`: length that makes angles and distances comparable in `singularity_distance`. `closed_form`: use one
    where there is one.
    """

    velocity_rad_s: float = 1.0
    acceleration_rad_s2: float = 1.0
    configurations: int = 8
    starts: int = 64
    reach_m: float = 0.5
    closed_form: bool = True

    def __post_init__(self) -> None:
        for name in ("velocity_rad_s", "acceleration_rad_s2", "configurations", "starts", "reach_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a positive value")


class ModelFileArm:
    """Kinematics of the arm of a file that stands at `world_from_base` and carries a tool at `frame_from_tool`."""

    def __init__(
        self, chain: ArmChain, world_from_base: FloatArray, frame_from_tool: FloatArray, parameters: Parameters
    ) -> None:
        for name, value in (("world_from_base", world_from_base), ("frame_from_tool", frame_from_tool)):
            if not is_rigid(np.asarray(value, dtype=np.float64)):
                raise DataError(f"{name} of the arm is not a right-handed rigid pose")
        self._chain = chain
        self._world_from_base = np.array(world_from_base, dtype=np.float64)
        self._base_from_world = inverted(self._world_from_base)
        self._home = chain.home.copy()
        self._home[-1] = chain.home[-1] @ frame_from_tool
        self._parameters = parameters
        self._closed = closed_form(chain.axis, chain.point, self._home) if parameters.closed_form else None
        self._turn = np.zeros((6, 6))
        self._turn[:3, :3] = self._turn[3:, 3:] = self._world_from_base[:3, :3]

    @property
    def has_closed_form(self) -> bool:
        """Whether the inverse is solved in closed form, by EAIK; else by damped least squares."""
        return self._closed is not None

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the file, from the base on."""
        return self._chain.joint_names

    @property
    def capsules(self) -> tuple[Capsule, ...]:
        """The outer shape, for `link_poses`: base, links, tool."""
        return self._chain.capsules

    @property
    def screw_arguments(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """What the kernels of `models.screw_chain` take: axes, points, frames at angle 0, lower and upper limits.

        Axes and points (J, 3) in m, frames (J + 1, 4, 4), limits (J,) in rad.
        """
        return self._chain.axis, self._chain.point, self._home, self.lower_rad, self.upper_rad

    @property
    def limits(self) -> JointLimits:
        """Position limits of the file, speed and acceleration limits of the parameters."""
        every = np.ones(len(self._chain.joint_names))
        return JointLimits(
            self.lower_rad,
            self.upper_rad,
            self._parameters.velocity_rad_s * every,
            self._parameters.acceleration_rad_s2 * every,
        )

    @property
    def lower_rad(self) -> FloatArray:
        """Lower joint limits (J,)."""
        return self._chain.lower_rad

    @property
    def upper_rad(self) -> FloatArray:
        """Upper joint limits (J,)."""
        return self._chain.upper_rad

    @property
    def singularities(self) -> tuple[str, ...]:
        """One name: an arbitrary arm has no named singularities."""
        return SINGULARITIES

    def forward(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Pose of the tool in the world: joints (..., J) -> (..., 4, 4).

        Joints in rad, lengths in m.
        """
        return self.link_poses(joints_rad)[..., -1, :, :]

    def link_poses(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Poses (..., J + 2, 4, 4) in the world of base, links and tool.

        For joints (..., J) in rad; the frame of link j is the one behind joint j.
        """
        rows, lead = self._rows(joints_rad)
        frames, _ = place_many(self._chain.axis, self._chain.point, self._home, rows)
        poses = np.empty((len(rows), frames.shape[1] + 1, 4, 4))
        poses[:, 0] = self._world_from_base
        poses[:, 1:] = self._world_from_base @ frames
        return poses.reshape(*lead, *poses.shape[1:])

    def jacobian(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """Geometric Jacobian (..., 6, J) of the tool in world axes, linear rows first.

        For joints (..., J) in rad: m/s and rad/s of the tool per rad/s of a joint.
        """
        rows, lead = self._rows(joints_rad)
        _, jacobians = place_many(self._chain.axis, self._chain.point, self._home, rows)
        return np.asarray((self._turn @ jacobians).reshape(*lead, *jacobians.shape[1:]))

    def inverse(self, world_from_tool: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Solutions for poses (N, 4, 4): joints (N, K, J), and which (N, K) reach the pose within the joint limits.

        Column k is one configuration, followed from pose to pose. Where the arm has a closed form (and EAIK is
        installed) all solutions are found, else those whose configuration the first reachable pose has. An arm with
        more than six joints has endlessly many solutions, of which each column is one.

        Joints in rad; nan in the columns that do not reach a pose.

        Raises
        ------
        DataError : the poses are not (N, 4, 4).
        """
        poses = np.ascontiguousarray(world_from_tool, dtype=np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise DataError(f"poses have shape {poses.shape}, wanted (N, 4, 4)")
        targets = np.ascontiguousarray(self._base_from_world @ poses)
        if self._closed is not None:
            return in_columns(self._closed(targets), self.lower_rad, self.upper_rad, _COLUMNS)
        chain = self.screw_arguments
        spare = spread(_SPARE_STARTS, self.lower_rad, self.upper_rad)
        return solve_along(*chain, targets, self._configurations(targets), spare)

    def _configurations(self, targets: FloatArray) -> FloatArray:
        """Joints (K, J) of the first reachable target in different configurations; else the spread starts."""
        chain = self.screw_arguments
        starts = spread(self._parameters.starts, self.lower_rad, self.upper_rad)
        for target in targets:
            found, reached = solve_along(*chain, target[None], starts, starts[:0])
            if reached.any():
                kept = distinct(found[0], 0.05)[: self._parameters.configurations]
                return np.ascontiguousarray(found[0, kept])
        return starts[: self._parameters.configurations]

    def singularity_distance(self, joints_rad: npt.ArrayLike) -> FloatArray:
        """How far joints (..., J) are from losing a direction of motion: (..., 1) in [0, 1].

        Smallest over largest singular value of the Jacobian, angles scaled by `reach_m` (Yoshikawa 1985).
        """
        jacobian = self.jacobian(joints_rad)
        finite = np.all(np.isfinite(jacobian), axis=(-2, -1), keepdims=True)
        scaled = np.where(finite, jacobian, 0.0)
        scaled[..., 3:, :] *= self._parameters.reach_m
        values = np.linalg.svd(scaled, compute_uv=False)
        least = values[..., 5] if values.shape[-1] == 6 else np.zeros(values.shape[:-1])
        largest = values[..., 0]
        ratio = np.divide(least, largest, out=np.zeros_like(largest), where=largest > 0.0)
        return np.asarray(np.where(finite[..., 0, 0], ratio, np.nan)[..., None])

    def _rows(self, joints_rad: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        joints = np.ascontiguousarray(joints_rad, dtype=np.float64)
        count = len(self._chain.joint_names)
        if joints.ndim == 0 or joints.shape[-1] != count:
            raise DataError(f"joint positions have shape {joints.shape}, wanted (..., {count})")
        return joints.reshape(-1, count), joints.shape[:-1]


def create(
    path: Path,
    tool_frame: str,
    world_from_base: FloatArray,
    frame_from_tool: FloatArray,
    parameters: Parameters = Parameters(),
) -> ModelFileArm:
    """The kinematics of the arm of a file whose base stands at `world_from_base` (4, 4).

    `tool_frame` names a site, body or link of the file, `frame_from_tool` (4, 4) is the grip in that frame.

    Raises
    ------
    DataError : the file is refused (see `arms.models.arm_file.read_arm`), or a pose is not rigid.
    """
    return ModelFileArm(read_arm(path, tool_frame), world_from_base, frame_from_tool, parameters)
