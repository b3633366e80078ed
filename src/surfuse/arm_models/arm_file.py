"""Arm files (MJCF or URDF) read by MuJoCo: the chain from the base to a named tool frame, or a clear refusal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco  # type: ignore[import-not-found,import-untyped,unused-ignore]
import numpy as np

from surfuse.errors import DataError, nearest
from surfuse.geometry.poses import pose
from surfuse.motion.body import Capsule
from surfuse.records import FloatArray

FILE_LIMIT_BYTES = 4 * 1024 * 1024
JOINTS_MAX = 12

_ROUND = (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE))
_CYLINDER, _CYLINDER_AXIS = int(mujoco.mjtGeom.mjGEOM_CYLINDER), 2
_CLOSING = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


@dataclass(frozen=True)
class ArmChain:
    """A chain of J revolute joints at joint angles 0: names, axes and points (J, 3) in the base frame, limits (J,).

    `home` (J + 1, 4, 4): frames of the links behind each joint and of the tool. `capsules`: outer shape, link index 0
    for the base, j for the link behind joint j.

    `axis` are unit vectors about which the joints turn, `point` (J, 3) in m lies on each axis, limits in rad.
    """

    joint_names: tuple[str, ...]
    axis: FloatArray
    point: FloatArray
    home: FloatArray
    lower_rad: FloatArray
    upper_rad: FloatArray
    capsules: tuple[Capsule, ...]


def read_arm(path: Path, tool_frame: str) -> ArmChain:
    """Read an arm file; `tool_frame` names a site (MJCF), body (MJCF) or link (URDF).

    Raises
    ------
    DataError : unreadable or hostile file, missing meshes, closed chains, no such tool frame, joints that are not
        revolute, without limits, or too many.
    """
    _check_text(path)
    model = _compiled(path)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    if model.neq and np.any(np.isin(model.eq_type, _CLOSING)):
        raise DataError(
            f"{model.neq} equality constraints close a chain", where=str(path), cure="give an arm that is an open chain"
        )
    body, base_from_tool = _tool(model, data, tool_frame, path)
    joints = _joints_to(model, body, path, tool_frame)
    return _chain(model, data, joints, base_from_tool, path)


def _check_text(path: Path) -> None:
    """Refuse what no arm file is before a parser sees it."""
    try:
        size = path.stat().st_size
        text = path.read_text(encoding="utf-8") if size <= FILE_LIMIT_BYTES else ""
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"cannot read the arm file: {error}", where=str(path), cure="give an MJCF or URDF file"
        ) from error
    if size > FILE_LIMIT_BYTES:
        raise DataError(f"{size} bytes, at most {FILE_LIMIT_BYTES}", where=str(path), cure="give the arm alone")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DataError("the file defines document types or entities", where=str(path), cure="remove them")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise DataError(f"not well-formed XML: {error}", where=str(path), cure="give an MJCF or URDF file") from error
    if root.tag not in ("mujoco", "robot"):
        raise DataError(
            f"the root element is <{root.tag}>", where=str(path), cure="give <mujoco> (MJCF) or <robot> (URDF)"
        )
    for element in root.iter():
        name = element.get("filename") or element.get("file") or ""
        if name.startswith(("package://", "model://", "http://", "https://")):
            raise DataError(
                f"mesh '{name}' cannot be resolved without other software",
                where=str(path),
                cure="give mesh paths relative to the file, or remove the meshes",
            )


def _compiled(path: Path) -> mujoco.MjModel:
    # Without a handler the library writes warnings into a file in the working folder.
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignored)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        # Fixed links of URDF files would vanish into their parents, the tool frame among them.
        spec.compiler.fusestatic = False
        # Only the geometry is used: links without mass are no fault.
        spec.compiler.boundmass, spec.compiler.boundinertia = 1e-6, 1e-9
        spec.compiler.balanceinertia = True
        return spec.compile()
    except (ValueError, RuntimeError) as error:
        words = " ".join(str(error).split())
        cure = "put the mesh beside the file, or remove it" if "open" in words.lower() else "correct the file"
        raise DataError(f"MuJoCo refuses the arm: {words}", where=str(path), cure=cure) from error
    finally:
        mujoco.set_mju_user_warning(handler)


def _ignored(message: str) -> None:
    """Everything that matters is checked afterwards."""


def _tool(model: mujoco.MjModel, data: mujoco.MjData, name: str, path: Path) -> tuple[int, FloatArray]:
    """The body that carries the tool frame, and the frame in the world of the file."""
    sites = {model.site(i).name: i for i in range(model.nsite)}
    bodies = {model.body(i).name: i for i in range(1, model.nbody)}
    if name in sites:
        i = sites[name]
        return int(model.site_bodyid[i]), pose(data.site_xmat[i].reshape(3, 3), data.site_xpos[i])
    if name in bodies:
        i = bodies[name]
        return i, pose(data.xmat[i].reshape(3, 3), data.xpos[i])
    named = [known for known in (*sites, *bodies) if known]
    raise DataError(f"there is no tool frame '{name}'", where=str(path), cure=nearest(name, named))


def _joints_to(model: mujoco.MjModel, body: int, path: Path, tool_frame: str) -> list[int]:
    """Indices of the joints between the base and a body, from the base on."""
    joints: list[int] = []
    while body > 0:
        first = int(model.body_jntadr[body])
        joints[:0] = range(first, first + int(model.body_jntnum[body])) if first >= 0 else []
        body = int(model.body_parentid[body])
    if not joints:
        raise DataError(f"no joint moves the tool frame '{tool_frame}'", where=str(path), cure="name another frame")
    if len(joints) > JOINTS_MAX:
        raise DataError(f"{len(joints)} joints, at most {JOINTS_MAX}", where=str(path), cure="give an arm with fewer")
    for i in joints:
        name = model.joint(i).name or f"number {i + 1}"
        if int(model.jnt_type[i]) != int(mujoco.mjtJoint.mjJNT_HINGE):
            raise DataError(f"joint '{name}' is not revolute", where=str(path), cure="give an arm of revolute joints")
        low, high = (float(value) for value in model.jnt_range[i])
        if not model.jnt_limited[i]:
            raise DataError(f"joint '{name}' has no limits", where=str(path), cure="give a range for every joint")
        if not (np.isfinite([low, high]).all() and low < high):
            raise DataError(
                f"joint '{name}' has the limits {low:g} to {high:g} rad", where=str(path), cure="correct them"
            )
    return joints


def _chain(
    model: mujoco.MjModel, data: mujoco.MjData, joints: list[int], base_from_tool: FloatArray, path: Path
) -> ArmChain:
    links = [int(model.jnt_bodyid[i]) for i in joints]
    frames = [pose(data.xmat[b].reshape(3, 3), data.xpos[b]) for b in links]
    axis, point = np.array([data.xaxis[i] for i in joints]), np.array([data.xanchor[i] for i in joints])
    if not np.all(np.isfinite(axis)) or not np.all(np.isfinite(point)):
        raise DataError("joint axes are not finite", where=str(path), cure="correct the file")
    return ArmChain(
        tuple(model.joint(i).name or f"joint{k + 1}" for k, i in enumerate(joints)),
        axis,
        point,
        np.array([*frames, base_from_tool]),
        np.array([model.jnt_range[i][0] for i in joints]),
        np.array([model.jnt_range[i][1] for i in joints]),
        _capsules(model, links),
    )


def _capsules(model: mujoco.MjModel, links: list[int]) -> tuple[Capsule, ...]:
    """Every shape on the chain as a capsule that contains it: along the longest side of its box."""
    capsules: list[Capsule] = []
    for g in range(model.ngeom):
        link, frame = _carrier(model, int(model.geom_bodyid[g]), links)
        kind = int(model.geom_type[g])
        if link < 0 or kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
            continue
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[g])
        placed = frame @ pose(turn.reshape(3, 3), model.geom_pos[g])
        center, half = model.geom_aabb[g][:3], model.geom_aabb[g][3:]
        along = int(np.argmax(half))
        reach = np.zeros(3)
        if kind in _ROUND:
            radius = float(model.geom_size[g][0])
            reach[along] = max(float(half[along]) - radius, 0.0)
        elif kind == _CYLINDER and along == _CYLINDER_AXIS:
            radius, reach[along] = float(model.geom_size[g][0]), float(half[along])
        else:
            # The corners of a box lie outside a capsule that ends where the box does.
            radius = float(np.linalg.norm(np.delete(half, along)))
            reach[along] = float(half[along])
        ends = [placed[:3, :3] @ (center + sign * reach) + placed[:3, 3] for sign in (-1.0, 1.0)]
        start, end = ((float(e[0]), float(e[1]), float(e[2])) for e in ends)
        capsules.append(Capsule(f"link {link}" if link else "base", link, start, end, max(radius, 1e-4)))
    return tuple(capsules)


def _carrier(model: mujoco.MjModel, body: int, links: list[int]) -> tuple[int, FloatArray]:
    """Index of the link (0: base) that a body is fixed to, -1 for side branches, and the body's frame in it."""
    frame = np.eye(4)
    while body > 0:
        if body in links:
            return len(links) - links[::-1].index(body), frame
        if model.body_jntnum[body]:
            return -1, frame
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_quat[body])
        frame = pose(turn.reshape(3, 3), model.body_pos[body]) @ frame
        body = int(model.body_parentid[body])
    return 0, frame
