"""The real rig of a cell file: its arm, its sensors, its clock. Nothing is opened here, nothing moves."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from surfuse import registry
from surfuse.arms import bridge as bridge_arm
from surfuse.bridge.shared import BridgeClock, SharedBridge
from surfuse.errors import ConfigError
from surfuse.extras import needed_by
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import MACHINE_CLOCK, Arm, Clock, PoseArm, PoseArmSurroundings
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.planners import slowed
from surfuse.records import Fixture, FloatArray
from surfuse.rig.described_sensors import places
from surfuse.rig.devices import JointMotion, Rig
from surfuse.rig.real.base import world_from_base
from surfuse.rig.real.joint_bridge import JointBridgeArm
from surfuse.rig.real.sensors import array_of
from surfuse.rig.real.shape import ArmShape, MoveCheck, sensor_rods, shapeless
from surfuse.settings import Settings

if TYPE_CHECKING:
    from surfuse.arm_models.model_file import ModelFileArm

_PLANNED_M = 1e-3
_SHARED = {"speed_share", "settle_s"}


def real_rig(settings: Settings) -> Rig:
    """The rig that the cell file describes.

    Raises
    ------
    UsageError, ConfigError, DataError : a driver, a sensor, or the arm's file cannot be used as described.
    """
    bridge = _bridge(settings)
    clock: Clock = MACHINE_CLOCK if bridge is None else BridgeClock(bridge)
    array = array_of(settings.sensor, bridge, clock)
    grip = tool_from_grip(*places(settings.sensor))
    motion = _joint_motion(settings, array.fixture, grip, bridge, clock)
    rig = (
        Rig(clock=clock, array=array, motion=motion)
        if motion is not None
        else Rig(clock=clock, array=array, poses=_pose_arm(settings, bridge, clock), tool_from_grip=grip)
    )
    if bridge is None:
        return rig
    # The conversation is asked for when it is needed: the bridge opens later.
    return replace(rig, begin=lambda stage, index: bridge.client.begin(stage, index), guide=bridge.guide)


def _bridge(settings: Settings) -> SharedBridge | None:
    """The bridge of the arm, shared with the sensors; None for an arm with a driver of its own."""
    if settings.arm.driver != "bridge":
        return None
    return bridge_arm.shared_bridge(_bridge_parameters(settings, None))


def _bridge_parameters(settings: Settings, bridge: SharedBridge | None) -> bridge_arm.Parameters:
    surroundings = None if bridge is None else bridge_arm.Surroundings(bridge)
    made = registry.parameters("arms", "bridge", _table(settings, bridge_arm.Parameters), "arm", surroundings)
    assert isinstance(made, bridge_arm.Parameters)
    return made


def _table(settings: Settings, parameters: type) -> dict[str, object]:
    """The driver's keys of the table `[arm]`, and those that it shares with every arm where the user gave them."""
    known = {field.name for field in fields(parameters)}
    given = settings.arm.model_fields_set & known & _SHARED
    return {**{name: getattr(settings.arm, name) for name in given}, **settings.arm.parameters}


def _pose_arm(settings: Settings, bridge: SharedBridge | None, clock: Clock) -> PoseArm:
    """An arm that is sent to poses."""
    if bridge is not None:
        return bridge_arm.create(_bridge_parameters(settings, bridge))
    name = settings.arm.driver or ""
    module = registry.load("arms", name)
    table = _table(settings, module.Parameters)
    made = module.create(registry.parameters("arms", name, table, "arm", PoseArmSurroundings(clock)))
    if not isinstance(made, PoseArm):
        raise ConfigError(
            f"arm.driver = '{name}' takes joints, and nothing says what the arm is",
            cure="give the arm's file: [arm] file = 'arm.urdf', tool = 'flange'",
        )
    return made


def _joint_motion(
    settings: Settings, fixture: Fixture, grip: FloatArray, bridge: SharedBridge | None, clock: Clock
) -> JointMotion | None:
    """An arm whose joints are commanded, with the model and the shape of its file; None without a file."""
    own, model = settings.arm, model_of(settings, grip)
    if model is None:
        return None
    limits, joints = slowed(model.limits, own.speed_share), len(model.joint_names)
    rods = (*model.capsules, *sensor_rods(fixture, grip, joints + 1))
    shape = ArmShape(model.link_poses, rods, limits, lambda: arm.joint_state().position_rad, own.clearance_m)
    # A little less than what is planned with: the arm starts from where it was sent, not quite from where it is.
    check = MoveCheck(shape.clearance, max(own.clearance_m - _PLANNED_M, 0.0))
    surroundings = ArmSurroundings(model, limits, clock, check)
    arm = _joint_arm(settings, surroundings, bridge)
    if not own.collision_check:
        return JointMotion(arm, link_poses=model.link_poses, limits=limits, unchecked="arm.collision_check = false")
    unchecked = shapeless(model.capsules, joints)
    if not model.capsules:
        return JointMotion(arm, link_poses=model.link_poses, limits=limits, unchecked=unchecked)
    return JointMotion(arm, shape.clearance, model.link_poses, check.surround, limits=limits, unchecked=unchecked)


def model_of(settings: Settings, grip: FloatArray) -> ModelFileArm | None:
    """The arm of the file of the configuration where it stands, with the grip (4, 4) in its tool frame; None without.

    Raises
    ------
    ConfigError, DataError : no tool frame is named, a package is missing, or the file is refused.
    """
    own = settings.arm
    if own.file is None:
        return None
    if own.tool is None:
        raise ConfigError("no tool frame is named", cure="name the site, body or link: [arm] tool = 'flange'")
    with needed_by("an arm file", own.file):
        from surfuse.arm_models import model_file
    usual = model_file.Parameters(np.radians(own.joint_speed_deg_s), np.radians(own.joint_acceleration_deg_s2))
    return model_file.create(Path(own.file), own.tool, world_from_base(settings), grip, usual)


def _joint_arm(settings: Settings, surroundings: ArmSurroundings, bridge: SharedBridge | None) -> Arm:
    """The driver of an arm whose joints are commanded."""
    own = settings.arm
    if bridge is not None:
        return JointBridgeArm(bridge, surroundings, None if own.speed_share == 1.0 else own.speed_share)
    name = own.driver or ""
    made: Arm = registry.load("arms", name).create(
        registry.parameters("arms", name, own.parameters, "arm", surroundings)
    )
    return made
