"""The camera of a real rig, and what brings it to where it looks from. Nothing is opened here, nothing moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial

import numpy as np

from surfuse import registry
from surfuse.bridge.messages import MoveTo, State
from surfuse.bridge.shared import SharedBridge
from surfuse.cameras import bridge as bridge_camera
from surfuse.errors import ConfigError, DeviceError, UnreachableError, nearest
from surfuse.geometry.poses import inverse, pose
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import Arm, Camera, CameraSurroundings, Clock, PoseArm
from surfuse.motion.choice import nearest_configuration
from surfuse.records import FloatArray, JointState
from surfuse.rig.described_sensors import places
from surfuse.rig.description import camera_model, camera_mount, ranger_mount, turn_of
from surfuse.rig.devices import JointMover, Lookout, Rig, Viewpoints
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.shoulder_ranger import ShoulderRanger, shoulder_ranger
from surfuse.settings import Settings

BRIDGE = "bridge"
LOOKING_SHARE = 0.2
"""Share of the arm's speed on the way to a place to look from."""
_UPRIGHT = 0.9999


class BridgeJoints:
    """The joints of an arm behind a bridge of which no model is known; see `JointMover`."""

    def __init__(self, bridge: SharedBridge, speed_share: float | None) -> None:
        self._bridge, self._speed_share = bridge, min(speed_share or 1.0, LOOKING_SHARE)

    def joint_state(self) -> JointState:
        """What the bridge says of the joints."""
        return _joints(self._bridge.client.state())

    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Go there, slowly."""
        return _joints(self._bridge.client.move(MoveTo(joints_rad=joints_rad, speed_share=self._speed_share)))


class SlowJoints:
    """The joints of an arm with a model, on the way to a place to look from; see `JointMover`."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def joint_state(self) -> JointState:
        """What the arm says of its joints."""
        return self._arm.joint_state()

    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Go there, slowly."""
        return self._arm.move_to(joints_rad, LOOKING_SHARE)


def _joints(state: State) -> JointState:
    if state.joints_rad is None:
        raise DeviceError(
            "the bridge does not say the joints of the arm, which bring the camera to where it looks from",
            cure="let it answer 'joints_rad'; or mount the camera on the tool, or fixed",
        )
    return JointState(state.joints_rad, state.t_s)


def real_lookout(
    settings: Settings, rig: Rig, bridge: SharedBridge | None, clock: Clock, recordings: Recordings
) -> Lookout | Viewpoints | None:
    """What looks for the part in a real rig: the camera of the cell file, on tool, shoulder, or fixed.

    None where the cell file names no camera, or where it says the area to scan, so that nothing is looked for.

    Raises
    ------
    UsageError, ConfigError : no such camera, keys that it does not have, or an arm that cannot bring it to its views.
    """
    if settings.area is not None or not settings.camera.is_real:
        return None
    camera = _camera(settings, bridge, clock)
    joints = None if rig.motion is None else rig.motion.arm
    if settings.camera.mounted == "shoulder":
        ranger = shoulder_ranger(settings, bridge, clock, recordings)
        return _on_shoulder(settings, camera, joints, bridge, ranger)
    if settings.search.plane is None:
        raise ConfigError(
            f"camera.mounted = '{settings.camera.mounted}', and nothing says how far away the part is",
            cure="give the table that it lies on: [search] plane = {origin_m = [0.0, 0.0, 0.0], normal = [0, 0, 1]}",
        )
    if settings.camera.mounted == "fixed":
        return Viewpoints(camera, partial(np.copy, _pose(settings.camera.world_from_camera)))
    return _on_tool(settings, camera, rig, joints, bridge)


def _camera(settings: Settings, bridge: SharedBridge | None, clock: Clock) -> Camera:
    name, table = settings.camera.driver or "", settings.camera.parameters
    module = registry.load("cameras", name)
    own = [field.name for field in fields(module.Parameters) if field.name != "surroundings"]
    for key in table:
        if key not in own:
            known = {*own, *type(settings.camera).model_fields} - {"parameters"}
            raise ConfigError(f"unknown key 'camera.{key}'", cure=nearest(key, known))
    model = camera_model(settings)
    surroundings = CameraSurroundings(model, clock)
    if name == BRIDGE:
        if bridge is None:
            raise ConfigError(
                "camera.driver = 'bridge', but the arm has none",
                cure="give [arm] driver = 'bridge', or the camera's own driver",
            )
        surroundings = bridge_camera.Surroundings(model=model, clock=clock, bridge=bridge)
    made: Camera = module.create(registry.parameters("cameras", name, table, "camera", surroundings))
    return made


def _mover(settings: Settings, joints: Arm | None, bridge: SharedBridge | None) -> JointMover:
    if joints is not None:
        return SlowJoints(joints)
    if bridge is None:
        what = "camera.mounted = 'shoulder'" if settings.camera.mounted == "shoulder" else "search.view_joints_deg"
        raise ConfigError(
            f"{what} needs an arm whose joints are commanded, arm.driver = '{settings.arm.driver}' is sent to poses",
            cure="give the arm's file ([arm] file = ..., tool = ...), or views of a camera on the tool, or a fixed one",
        )
    return BridgeJoints(bridge, settings.arm.speed_share)


def _on_shoulder(
    settings: Settings, camera: Camera, joints: Arm | None, bridge: SharedBridge | None, ranger: ShoulderRanger | None
) -> Lookout:
    ready = settings.arm.ready_deg
    limits = (-np.pi, np.pi)
    if joints is not None:
        limits = (float(joints.kinematics.lower_rad[0]), float(joints.kinematics.upper_rad[0]))
    return Lookout(
        arm=_mover(settings, joints, bridge),
        camera=camera,
        turn_rad=turn_of(settings, *limits),
        ready_rad=None if ready is None else np.radians(ready),
        shoulder_from_camera=camera_mount(settings).shoulder_from_device,
        ranger=ranger,
        shoulder_from_ranger=None if ranger is None else ranger_mount(settings).shoulder_from_device,
        world_from_floor=_floor(settings),
    )


def _floor(settings: Settings) -> FloatArray | None:
    """Where the frame that turns with joint 1 is at joint 1 = 0: below the arm's base, on the floor."""
    if settings.arm.world_from_base is None:
        return None
    base = _pose(settings.arm.world_from_base)
    if base[2, 2] < _UPRIGHT:
        raise ConfigError(
            f"arm.world_from_base leans by {float(np.degrees(np.arccos(base[2, 2]))):.1f} degrees",
            cure="a camera on the shoulder needs an upright first axis: mount it on the tool, or fixed",
        )
    return pose(base[:3, :3], [base[0, 3], base[1, 3], 0.0])


def _on_tool(
    settings: Settings, camera: Camera, rig: Rig, joints: Arm | None, bridge: SharedBridge | None
) -> Viewpoints:
    grip_from_tool = inverse(tool_from_grip(*places(settings.sensor)))
    tool_from_camera = _pose(settings.camera.tool_from_camera)

    def place() -> FloatArray:
        if joints is not None:
            world_from_grip = joints.kinematics.forward(joints.joint_state().position_rad)
            return np.asarray(world_from_grip @ grip_from_tool @ tool_from_camera)
        assert rig.poses is not None
        return np.asarray(rig.poses.tool_state().world_from_tool @ tool_from_camera)

    moves: list[Callable[[], object]] = []
    for view in settings.search.views or ():
        if joints is not None:
            moves.append(partial(_to_pose, joints, _pose(view) @ inverse(grip_from_tool)))
        elif rig.poses is not None:
            moves.append(partial(_sent, rig.poses, _pose(view)))
    if settings.search.view_joints_deg is not None:
        mover = _mover(settings, joints, bridge)
        moves += [partial(mover.move_to, np.radians(view)) for view in settings.search.view_joints_deg]
    return Viewpoints(camera, place, tuple(moves))


def _sent(arm: PoseArm, world_from_tool: FloatArray) -> object:
    return arm.move_to_pose(world_from_tool, LOOKING_SHARE)


def _to_pose(arm: Arm, world_from_grip: FloatArray) -> object:
    """To the joints of a pose that are nearest to where the arm stands."""
    kinematics = arm.kinematics
    solutions, valid = kinematics.inverse(world_from_grip[None])
    if not valid.any():
        place = ", ".join(f"{value:.3f}" for value in world_from_grip[:3, 3])
        raise UnreachableError(f"the arm cannot bring the grip to ({place}) m", cure="give a view within its reach")
    here = arm.joint_state().position_rad
    found, _ = nearest_configuration(solutions, valid, here, kinematics.lower_rad, kinematics.upper_rad)
    return arm.move_to(np.asarray(found[0], dtype=np.float64), LOOKING_SHARE)


def _pose(numbers: list[float] | None) -> FloatArray:
    assert numbers is not None
    return np.array(numbers, dtype=np.float64).reshape(4, 4)
