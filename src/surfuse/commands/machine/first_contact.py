"""First contact with a real rig: every device is opened and read once, and nothing moves."""

from __future__ import annotations

import math
import time

import numpy as np

from surfuse.acquisition.station import take_sweep
from surfuse.arms.bridge import BridgeArm
from surfuse.commands.machine.checks import HEARS_NOTHING, Check
from surfuse.commands.machine.first_picture import camera_checks
from surfuse.errors import ConfigError, SafetyStopError, SurfuseError
from surfuse.records import FloatArray, Status, Sweep, ToolState
from surfuse.rig.area import area_of, check_faces, outline_of
from surfuse.rig.devices import Rig
from surfuse.settings import Settings

_LOOKS = 5
_PAUSE_S = 0.2
_STILL_M = 0.002
_STILL_RAD = 0.01
_CLOCK_LIMIT_S = 0.05


def first_contact(rig: Rig, settings: Settings) -> list[Check]:
    """Open everything, read everything once, look whether the arm stands still.

    A device that cannot be opened or read is a problem; the checks that need it are left out then.
    """
    try:
        with rig.opened():
            # The clock comes last: every state until then makes it better known.
            found = [*_bridge(rig), *_arm(rig), *_sensors(rig), *camera_checks(rig, settings), *_area(rig, settings)]
            return [*found, *_clock(rig)]
    except SurfuseError as error:
        return [("rig", str(error), False)]


def _bridge(rig: Rig) -> list[Check]:
    if not isinstance(rig.poses, BridgeArm):
        return []
    hello = rig.poses.client.hello
    arm = "no arm that moves" if hello.arm is None else f"{hello.arm.kind.value} arm"
    return [("bridge", f"'{hello.name}': {arm}, sensors {', '.join(hello.sensors) or 'none'}", True)]


def _clock(rig: Rig) -> list[Check]:
    """How well stamps belong together; only where several clocks meet, over an arm in motion, can that be too bad."""
    if (stamps := rig.stamps()) is None:
        return []
    in_motion = isinstance(rig.poses, BridgeArm) and rig.poses.client.hello.arm is None
    close = stamps.clock.keeps_pace and stamps.clock.offset.uncertainty_s < _CLOCK_LIMIT_S
    good = close or not stamps.others or not in_motion
    slow = "" if good else f"; limit {1e3 * _CLOCK_LIMIT_S:.0f} ms, and both must keep pace"
    return [("clock", f"{stamps.in_words()}{slow}", good)]


def _arm(rig: Rig) -> list[Check]:
    """Where the arm is, and whether that changes although nobody sends it anywhere."""
    first = _state(rig)
    off_m, off_rad = 0.0, 0.0
    for _ in range(_LOOKS):
        time.sleep(_PAUSE_S)
        try:
            now = _state(rig)
        except SafetyStopError as error:
            return [("arm", str(error), False)]
        off_m = max(off_m, float(np.linalg.norm(now.world_from_tool[:3, 3] - first.world_from_tool[:3, 3])))
        off_rad = max(off_rad, _angle(now.world_from_tool, first.world_from_tool))
    place = ", ".join(f"{x:.3f}" for x in first.world_from_tool[:3, 3])
    axis = ", ".join(f"{x:.2f}" for x in first.world_from_tool[:3, 2])
    still = off_m < _STILL_M and off_rad < _STILL_RAD
    text = f"tool at ({place}) m, beams along ({axis})"
    if still:
        return [("arm", f"{text}; it stands still to {1e3 * off_m:.2f} mm", True)]
    moved = f"it moved by {1e3 * off_m:.1f} mm and {math.degrees(off_rad):.2f} degrees in {_LOOKS * _PAUSE_S:.0f} s"
    return [("arm", f"{text}; {moved} without a move, limits {1e3 * _STILL_M:.0f} mm, 0.6 degrees", False)]


def _state(rig: Rig) -> ToolState:
    if rig.poses is not None:
        return rig.poses.tool_state()
    arm = rig.joint_motion("the arm").arm
    state = arm.joint_state()
    return ToolState(state.t_s, arm.kinematics.forward(state.position_rad), state.position_rad)


def _angle(one: FloatArray, other: FloatArray) -> float:
    cosine = 0.5 * (float(np.trace(one[:3, :3].T @ other[:3, :3])) - 1.0)
    return math.acos(min(1.0, max(-1.0, cosine)))


def _sensors(rig: Rig) -> list[Check]:
    """One reading each."""
    state = _state(rig)
    grip = ToolState(state.t_s, state.world_from_tool @ rig.tool_from_grip, state.joints_rad)
    sweep = take_sweep(0, 0, grip, rig.array)
    return [_sensor(rig, sweep, number) for number in range(len(sweep.sensor))]


def _sensor(rig: Rig, sweep: Sweep, number: int) -> Check:
    spec, status = rig.specs[number], Status(int(sweep.status[number]))
    limits = f"{spec.kind}, {spec.range_min_m:g} to {spec.range_max_m:g} m"
    if status is Status.OK:
        return (spec.name, f"{sweep.range_m[number]:.4f} m ({limits})", True)
    words = {Status.NO_ECHO: HEARS_NOTHING, Status.TOO_CLOSE: "something is too close", Status.FAULT: "no answer"}
    return (spec.name, f"{words[status]} ({limits})", status is not Status.FAULT)


def _area(rig: Rig, settings: Settings) -> list[Check]:
    if settings.area is None or settings.area.jog:
        return []
    outline = outline_of(area_of(settings))
    if rig.poses is not None:
        try:
            check_faces(outline.world_from_part, _state(rig).world_from_tool @ rig.tool_from_grip)
        except ConfigError as error:
            return [("area", str(error), False)]
    size = 1e3 * np.ptp(outline.vertices_m, axis=0)
    return [("area", f"{size[0]:.0f} x {size[1]:.0f} mm; `surfuse acquire --dry-run` shows its stops", True)]
