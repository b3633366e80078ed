"""A real arm whose joints are commanded, because its file says what they do: model, driver, collision check."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from surfuse import registry
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError
from surfuse.extras import needed_by
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import Arm, Clock
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.planners import slowed
from surfuse.records import Fixture, FloatArray
from surfuse.rig.described_sensors import places
from surfuse.rig.devices import JointMotion
from surfuse.rig.real.base import world_from_base
from surfuse.rig.real.joint_bridge import JointBridgeArm
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.shape import ArmShape, MoveCheck, sensor_rods, shapeless
from surfuse.settings import Settings

if TYPE_CHECKING:
    from surfuse.arm_models.model_file import ModelFileArm

SHARED = {"speed_share", "settle_s"}
"""Keys of every arm that the Parameters of a driver may have too."""
_PLANNED_M = 1e-3


def joint_motion(
    settings: Settings, fixture: Fixture, bridge: SharedBridge | None, clock: Clock, recordings: Recordings
) -> JointMotion | None:
    """An arm whose joints are commanded, with the model and the shape of its file; None without a file.

    Raises
    ------
    ConfigError, DataError : its file or its driver cannot be used as described.
    """
    own, grip = settings.arm, tool_from_grip(*places(settings.sensor))
    if own.file is None:
        return None
    model = described_model(settings, grip)
    if own.driver == Recordings.DRIVER:
        recorded = recordings.joint_arm(ArmSurroundings(model, model.limits, clock))
        return JointMotion(recorded, link_poses=model.link_poses, unchecked="a recorded arm moves nothing")
    joints = len(model.joint_names)
    rods = (*model.capsules, *sensor_rods(fixture, grip, joints + 1))
    shape = ArmShape(model.link_poses, rods, model.limits, lambda: arm.joint_state().position_rad, own.clearance_m)
    # A little less than what is planned with: the arm starts from where it was sent, not quite from where it is.
    check = MoveCheck(shape.clearance, max(own.clearance_m - _PLANNED_M, 0.0))
    arm = _commanded(settings, ArmSurroundings(model, model.limits, clock, check), bridge)
    motion = JointMotion(arm, link_poses=model.link_poses, limits=slowed(model.limits, own.share_of_speed))
    if isinstance(arm, JointBridgeArm):
        # Whether an arm behind a bridge has moved while the array fired is only known by asking.
        motion = replace(motion, look_again=arm.joint_state)
    if not own.collision_check:
        return replace(motion, unchecked="arm.collision_check = false")
    motion = replace(motion, unchecked=shapeless(model.capsules, joints))
    return replace(motion, clearance=shape.clearance, surround=check.surround) if model.capsules else motion


def described_model(settings: Settings, tool_from_grip: FloatArray) -> ModelFileArm:
    """The arm of `arm.file` where the cell file puts it, with the grip at `tool_from_grip` (4, 4) as its tool.

    Raises
    ------
    ConfigError, DataError : no file or tool frame is named, a package is missing, or the file is refused.
    """
    own = settings.arm
    if own.file is None:
        raise ConfigError("nothing says what the arm is", cure="give [arm] file = 'arm.urdf', tool = 'flange'")
    if own.tool is None:
        raise ConfigError("no tool frame is named", cure="name the site, body or link: [arm] tool = 'flange'")
    with needed_by("an arm file", own.file):
        from surfuse.arm_models import model_file
    usual = model_file.Parameters(np.radians(own.joint_speed_deg_s), np.radians(own.joint_acceleration_deg_s2))
    return model_file.create(Path(own.file), own.tool, world_from_base(settings), tool_from_grip, usual)


def _commanded(settings: Settings, around: ArmSurroundings, bridge: SharedBridge | None) -> Arm:
    """The driver of the arm; `around` has the limits of its whole speed."""
    own = settings.arm
    slow = replace(around, limits=slowed(around.limits, own.share_of_speed))
    if bridge is not None:
        return JointBridgeArm(bridge, slow, own.speed_share)
    name = own.driver or ""
    module = registry.load("arms", name)
    # All that it shares with every arm, given or not: a resumed run, whose file says all keys, moves as it did before.
    known = {"speed_share": own.share_of_speed, "settle_s": own.settle_s}
    shared = {field.name: known[field.name] for field in fields(module.Parameters) if field.name in known}
    # A driver that knows the share of the speed slows its moves itself.
    surroundings = around if "speed_share" in shared else slow
    made: Arm = module.create(registry.parameters("arms", name, {**shared, **own.parameters}, "arm", surroundings))
    return made
