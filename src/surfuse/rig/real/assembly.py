"""The real rig of a cell file: its arm, its sensors, its clock. Nothing is opened here, nothing moves."""

from __future__ import annotations

from dataclasses import fields, replace

from surfuse import registry
from surfuse.arms import bridge as bridge_arm
from surfuse.bridge.patience import Patience
from surfuse.bridge.shared import BridgeClock, SharedBridge
from surfuse.errors import ConfigError
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.interfaces import MACHINE_CLOCK, Clock, PoseArm, PoseArmSurroundings
from surfuse.records import FloatArray
from surfuse.rig.described_sensors import described_spec, places
from surfuse.rig.devices import Rig, Stamps
from surfuse.rig.real.camera import real_lookout
from surfuse.rig.real.joint_arm import SHARED, joint_motion
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.sensors import array_of, assumed_spec
from surfuse.rig.real.sources import BRIDGE
from surfuse.settings import Settings

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
    motion = joint_motion(settings, array.fixture, bridge, clock, recordings)

    def begin(stage: str, index: int) -> None:
        recordings.begin(stage, index)
        if bridge is not None:
            # The conversation is asked for when it is needed: the bridge opens later.
            bridge.client.begin(stage, index)

    rig = (
        Rig(clock=clock, array=array, motion=motion, begin=begin)
        if motion is not None
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
    given = {name: getattr(settings.arm, name) for name in settings.arm.model_fields_set & known & SHARED}
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
