"""The real rig of a cell file: its arm, its sensors, its clock. Nothing is opened here, nothing moves."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from surfuse import registry
from surfuse.arms import bridge as bridge_arm
from surfuse.bridge.patience import Patience
from surfuse.bridge.shared import BridgeClock, SharedBridge
from surfuse.errors import ConfigError
from surfuse.extras import needed_by
from surfuse.geometry.poses import is_rigid
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import MACHINE_CLOCK, Arm, Clock, PoseArm, PoseArmSurroundings
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.planners import slowed
from surfuse.records import FloatArray
from surfuse.rig.described_sensors import described_spec, places
from surfuse.rig.devices import JointMotion, Rig, Stamps
from surfuse.rig.real.camera import real_lookout
from surfuse.rig.real.joint_bridge import JointBridgeArm
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.sensors import array_of, assumed_spec
from surfuse.rig.real.sources import BRIDGE
from surfuse.settings import Settings

if TYPE_CHECKING:
    from surfuse.arm_models.model_file import ModelFileArm

_SHARED = {"speed_share", "settle_s"}
_PATIENT = 2.0  # times the time that the sensors say they need, until a sweep is given up


def real_rig(settings: Settings) -> Rig:
    """The rig that the cell file describes.

    Raises
    ------
    UsageError, ConfigError, DataError : a driver, a sensor, or the arm's file cannot be used as described.
    """
    bridge, recordings = _bridge(settings), Recordings(settings.arm.parameters)
    clock = _clock(settings, bridge, recordings)
    array = array_of(settings, bridge, clock, recordings)
    grip = tool_from_grip(*places(settings.sensor))
    joints = _joint_arm(settings, grip, bridge, clock, recordings)

    def begin(stage: str, index: int) -> None:
        recordings.begin(stage, index)
        if bridge is not None:
            # The conversation is asked for when it is needed: the bridge opens later.
            bridge.client.begin(stage, index)

    rig = (
        Rig(clock=clock, array=array, motion=_joint_motion(joints), begin=begin)
        if joints is not None
        else Rig(
            clock=clock,
            array=array,
            poses=_pose_arm(settings, bridge, clock, recordings, grip),
            tool_from_grip=grip,
            begin=begin,
        )
    )
    rig = replace(rig, lookout=real_lookout(settings, rig, bridge, clock, recordings))
    rig = replace(rig, counters=(lambda: array.counters) if array.has_bus else None)
    if bridge is None:
        return rig
    return replace(rig, guide=bridge.guide, stamps=lambda: _stamps(settings, bridge))


def _clock(settings: Settings, bridge: SharedBridge | None, recordings: Recordings) -> Clock:
    """The clock to which all stamps are brought: that of what says where the arm is, else this machine's."""
    if settings.arm.driver == Recordings.DRIVER:
        return recordings.clock
    return MACHINE_CLOCK if bridge is None else BridgeClock(bridge)


def _stamps(settings: Settings, bridge: SharedBridge) -> Stamps:
    """How well the sensors' stamps belong to the bridge's clock now."""
    names = tuple(sensor.name for sensor in settings.sensor)
    return Stamps(bridge.clock, names, tuple(sensor.name for sensor in settings.sensor if sensor.driver != BRIDGE))


def _joint_motion(joints: Arm) -> JointMotion:
    # Whether an arm behind a bridge has moved while the array fired is only known by asking.
    if isinstance(joints, JointBridgeArm):
        return JointMotion(joints, look_again=joints.joint_state)
    return JointMotion(joints)


def _bridge(settings: Settings) -> SharedBridge | None:
    """The bridge of the arm, shared with the sensors; None for an arm with a driver of its own."""
    if settings.arm.driver != "bridge":
        return None
    parameters = _bridge_parameters(settings, None)
    if parameters.sweep_timeout_s is None:
        parameters = replace(parameters, sweep_timeout_s=sweep_timeout_s(settings))
    return bridge_arm.shared_bridge(parameters)


def sweep_timeout_s(settings: Settings) -> float:
    """Twice the time that the sensors behind the bridge need one after the other, at least the usual patience."""
    behind = [described_spec(one, assumed_spec(one)) for one in settings.sensor if one.driver == BRIDGE]
    firing_s = sum(spec.firing_time_s for spec in behind)
    return max(Patience.sweep_timeout_s, _PATIENT * firing_s)


def _bridge_parameters(settings: Settings, bridge: SharedBridge | None) -> bridge_arm.Parameters:
    surroundings = None if bridge is None else bridge_arm.Surroundings(bridge)
    made = registry.parameters("arms", "bridge", _table(settings, bridge_arm.Parameters), "arm", surroundings)
    assert isinstance(made, bridge_arm.Parameters)
    return made


def _table(settings: Settings, parameters: type) -> dict[str, object]:
    """The driver's keys of the table `[arm]`, and those that it shares with every arm where the user gave them."""
    known = {field.name for field in fields(parameters)}
    given = {name: getattr(settings.arm, name) for name in settings.arm.model_fields_set & known & _SHARED}
    return {**{name: value for name, value in given.items() if value is not None}, **settings.arm.parameters}


def _pose_arm(
    settings: Settings, bridge: SharedBridge | None, clock: Clock, recordings: Recordings, grip: FloatArray
) -> PoseArm:
    """An arm that is sent to poses."""
    if bridge is not None:
        return bridge_arm.create(_bridge_parameters(settings, bridge))
    if settings.arm.driver == Recordings.DRIVER:
        return recordings.pose_arm(grip)
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


def _joint_arm(
    settings: Settings, grip: FloatArray, bridge: SharedBridge | None, clock: Clock, recordings: Recordings
) -> Arm | None:
    """An arm whose joints are commanded, with the model of its file; None without a file."""
    own = settings.arm
    if own.file is None:
        return None
    model = described_model(settings, grip)
    name = own.driver or ""
    if bridge is not None:
        around = ArmSurroundings(model, slowed(model.limits, own.share_of_speed), clock)
        return JointBridgeArm(bridge, around, own.speed_share)
    if name == Recordings.DRIVER:
        return recordings.joint_arm(ArmSurroundings(model, model.limits, clock))
    module = registry.load("arms", name)
    # All that it shares with every arm, given or not: a resumed run, whose file says all keys, moves as it did before.
    known = {"speed_share": own.share_of_speed, "settle_s": own.settle_s}
    shared = {field.name: known[field.name] for field in fields(module.Parameters) if field.name in known}
    table = {**shared, **own.parameters}
    # A driver that knows the share of the speed slows its moves itself.
    around = ArmSurroundings(model, slowed(model.limits, 1.0 if "speed_share" in shared else own.share_of_speed), clock)
    made: Arm = module.create(registry.parameters("arms", name, table, "arm", around))
    return made


def described_model(settings: Settings, tool_from_grip: FloatArray) -> ModelFileArm:
    """The arm of `arm.file` where the cell file puts it, with the grip at `tool_from_grip` (4, 4) as its tool.

    Raises
    ------
    ConfigError, DataError : no tool frame is named, or the file cannot be used.
    """
    own = settings.arm
    if own.tool is None:
        raise ConfigError("no tool frame is named", cure="name the site, body or link: [arm] tool = 'flange'")
    with needed_by("an arm file", own.file or ""):
        from surfuse.arm_models import model_file
    limits = model_file.Parameters(np.radians(own.joint_speed_deg_s), np.radians(own.joint_acceleration_deg_s2))
    return model_file.create(Path(own.file or ""), own.tool, _base(settings), tool_from_grip, limits)


def _base(settings: Settings) -> FloatArray:
    """Pose (4, 4) of the arm's base in the world."""
    numbers = settings.arm.world_from_base
    if numbers is None:
        return np.eye(4)
    if len(numbers) != 16 or not is_rigid(np.array(numbers).reshape(4, 4)):
        raise ConfigError(
            f"arm.world_from_base has {len(numbers)} numbers that are no rigid pose",
            cure="give 16 numbers: a 4 x 4 pose, row by row, right-handed",
        )
    return np.array(numbers, dtype=np.float64).reshape(4, 4)
