"""The twin's arm as a MuJoCo model, generated from the same parameters: an independent engine to check against."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco  # type: ignore[import-not-found,import-untyped,unused-ignore]
import numpy as np

from surfuse.geometry.poses import pose
from surfuse.motion.body import Capsule
from surfuse.motion.limits import JointLimits
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray

TOOL_SITE = "tool"
_TINY = 1e-12  # MuJoCo refuses moving bodies without mass


def mjcf(
    dynamics: ArmDynamics,
    limits: JointLimits,
    capsules: Sequence[Capsule] = (),
    wrist_from_tool: FloatArray | None = None,
    base_height_m: float = 0.0,
) -> str:
    """The arm in MuJoCo's format: joints with limits, motor inertia, friction and torque limits; links with masses.

    `capsules` are the outer shape, arm, bracket and tubes (`Capsule.link` 0 is the base, J + 1 the tool). They
    have no mass of their own: all mass is in `dynamics`, loads included. Dry friction is the mean of both directions,
    the only kind that MuJoCo has.

    `wrist_from_tool` (4, 4) places the tool behind the last link (None: there is none); the base stands `base_height_m`
    above the floor.
    """
    root = Element("mujoco", model="arm")
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity=_numbers([0.0, 0.0, -dynamics.gravity_m_s2]), timestep="0.00025")
    world = SubElement(root, "worldbody")
    body = SubElement(world, "body", name="base", pos=_numbers([0.0, 0.0, base_height_m]))
    _shapes(body, 0, capsules, np.eye(4))
    actuators = Element("actuator")
    for j in range(len(dynamics)):
        body = _link(body, dynamics, limits, j)
        _shapes(body, j + 1, capsules, np.eye(4))
        reach = _numbers([-dynamics.torque_max_nm[j], dynamics.torque_max_nm[j]])
        SubElement(actuators, "motor", name=f"motor{j + 1}", joint=f"joint{j + 1}", ctrlrange=reach)
    tool = np.eye(4) if wrist_from_tool is None else wrist_from_tool
    SubElement(body, "site", {"name": TOOL_SITE, **_place(tool)})
    _shapes(body, len(dynamics) + 1, capsules, tool)
    root.append(actuators)
    return tostring(root, encoding="unicode")


def _link(parent: Element, dynamics: ArmDynamics, limits: JointLimits, j: int) -> Element:
    """Link j + 1 with its joint, in the frame that turns with the joint's motor, before the link's own constant part.

    The body's frame is the link's frame at joint angle 0; the joint's axis is the z axis of the frame before it.
    """
    d, a, alpha = float(dynamics.d_m[j]), float(dynamics.a_m[j]), float(dynamics.alpha_rad[j])
    ca, sa = np.cos(alpha), np.sin(alpha)
    before_from_link = pose([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]], [a, 0.0, d])
    body = SubElement(parent, "body", {"name": f"link{j + 1}", **_place(before_from_link)})
    joint: dict[str, str] = {
        "name": f"joint{j + 1}",
        "type": "hinge",
        "axis": _numbers(before_from_link[2, :3]),
        "pos": _numbers(-before_from_link[:3, :3].T @ before_from_link[:3, 3]),
        "range": _numbers([limits.lower_rad[j], limits.upper_rad[j]]),
        "armature": _numbers([dynamics.armature_kg_m2[j]]),
        "damping": _numbers([dynamics.viscous_nm_s[j]]),
        "frictionloss": _numbers([float(np.mean(dynamics.coulomb_nm[j]))]),
    }
    SubElement(body, "joint", joint)
    mass = _numbers([max(float(dynamics.mass_kg[j]), _TINY)])
    SubElement(body, "inertial", mass=mass, pos=_numbers(dynamics.center_m[j]), diaginertia=_numbers([_TINY] * 3))
    return body


def _shapes(body: Element, link: int, capsules: Sequence[Capsule], body_from_frame: FloatArray) -> None:
    for k, capsule in enumerate(capsules):
        if capsule.link != link:
            continue
        ends = [body_from_frame[:3, :3] @ end + body_from_frame[:3, 3] for end in (capsule.start_m, capsule.end_m)]
        size = _numbers([capsule.radius_m])
        name = f"{capsule.name} {k}"
        if capsule.start_m == capsule.end_m:
            SubElement(body, "geom", name=name, type="sphere", mass="0", size=size, pos=_numbers(ends[0]))
        else:
            SubElement(
                body, "geom", name=name, type="capsule", mass="0", size=size, fromto=_numbers([*ends[0], *ends[1]])
            )


def _place(frame: FloatArray) -> dict[str, str]:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(frame[:3, :3]).ravel())
    return {"pos": _numbers(frame[:3, 3]), "quat": _numbers(quaternion)}


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


class MujocoArm:
    """The arm in MuJoCo: dynamics at a state, and forward simulation under joint torques."""

    def __init__(self, dynamics: ArmDynamics, limits: JointLimits, capsules: Sequence[Capsule] = ()) -> None:
        self._model = mujoco.MjModel.from_xml_string(mjcf(dynamics, limits, capsules))
        # The compiler refuses the published inertia of link 3, which no rigid body has; the engine does not mind.
        for j in range(len(dynamics)):
            body = self._model.body(f"link{j + 1}").id
            principal, axes = np.linalg.eigh(dynamics.inertia_kg_m2[j])
            axes[:, 0] *= np.linalg.det(axes)
            mujoco.mju_mat2Quat(self._model.body_iquat[body], np.ascontiguousarray(axes).ravel())
            self._model.body_inertia[body] = principal
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)

    def set_state(self, position_rad: FloatArray, velocity_rad_s: FloatArray) -> None:
        """Put the arm into a state (J,)."""
        self._data.qpos[:] = position_rad
        self._data.qvel[:] = velocity_rad_s
        self._data.qacc_warmstart[:] = 0.0
        mujoco.mj_forward(self._model, self._data)

    @property
    def position_rad(self) -> FloatArray:
        """Joint positions (J,)."""
        return np.array(self._data.qpos)

    @property
    def velocity_rad_s(self) -> FloatArray:
        """Joint speeds (J,)."""
        return np.array(self._data.qvel)

    def inertia(self, position_rad: FloatArray) -> FloatArray:
        """Joint-space inertia (J, J), motors included."""
        self.set_state(position_rad, np.zeros(self._model.nv))
        full = np.zeros((self._model.nv, self._model.nv))
        mujoco.mj_fullM(self._model, self._data, full)
        return full

    def smooth_torque(
        self, position_rad: FloatArray, velocity_rad_s: FloatArray, acceleration_rad_s2: FloatArray
    ) -> FloatArray:
        """Torque (J,) for a motion (J,) without dry friction: inertia, Coriolis, gravity and viscous friction."""
        self.set_state(position_rad, velocity_rad_s)
        inertial = np.zeros(self._model.nv)
        self._data.qacc[:] = acceleration_rad_s2
        mujoco.mj_rne(self._model, self._data, 1, inertial)
        armature = np.asarray(self._model.dof_armature) * acceleration_rad_s2
        return np.asarray(inertial + armature - np.asarray(self._data.qfrc_damper))

    def step(self, torque_nm: FloatArray, duration_s: float) -> None:
        """Let joint torques (J,) act for a while."""
        self._data.ctrl[:] = torque_nm
        for _ in range(max(1, round(duration_s / self._model.opt.timestep))):
            mujoco.mj_step(self._model, self._data)
