"""The first picture of a rig's camera: its size, its brightness, whether it shows a part. Nothing moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surfuse.commands.acquire.finding_on_plane import parts_seen, sightings
from surfuse.commands.acquire.locating import finder
from surfuse.commands.machine.checks import Check
from surfuse.errors import SurfuseError
from surfuse.records import CameraFrame, Status
from surfuse.rig.devices import Lookout, Rig, Viewpoints
from surfuse.settings import Settings

_DARK, _BRIGHT = 8.0, 247.0
_SATURATED_SHARE = 0.25


def camera_checks(rig: Rig, settings: Settings) -> list[Check]:
    """One picture from where the camera is, what it shows, and one range of the shoulder's ranger; none without one."""
    lookout = rig.lookout
    if lookout is None:
        return []
    try:
        frame = lookout.look() if isinstance(lookout, Viewpoints) else lookout.look_from_here()[1]
    except SurfuseError as error:
        return [("camera", str(error), False)]
    checks = [_picture(frame), ("search", *_told(lambda: _sees(frame, settings)))]
    if isinstance(lookout, Lookout) and lookout.ranger is not None:
        checks.append((lookout.ranger.spec.name, *_told(lambda: _range(lookout))))
    search = settings.search
    if settings.camera.mounted == "tool" and search.views is None and search.view_joints_deg is None:
        checks.append(("view", *_told(lambda: (_line(rig), True))))
    return checks


def _told(look: Callable[[], tuple[str, bool]]) -> tuple[str, bool]:
    try:
        return look()
    except SurfuseError as error:
        return str(error), False


def _picture(frame: CameraFrame) -> Check:
    """Size, brightness, and where it was taken from."""
    mean = float(frame.image.mean())
    white = float(np.mean(frame.image == 255))
    place = ", ".join(f"{value:.3f}" for value in frame.world_from_camera[:3, 3])
    axis = ", ".join(f"{value:.2f}" for value in frame.world_from_camera[:3, 2] + 0.0)
    height, width = frame.image.shape
    text = (
        f"{width} x {height} pixels, mean grey level {mean:.0f} of 255, {100.0 * white:.0f} % white; "
        f"at ({place}) m, looks along ({axis})"
    )
    if mean < _DARK:
        return ("camera", f"{text}: too dark, wanted {_DARK:.0f} or more; take off its cap, give light", False)
    if mean > _BRIGHT or white > _SATURATED_SHARE:
        return ("camera", f"{text}: too bright, at most {100 * _SATURATED_SHARE:.0f} % white; expose less", False)
    return ("camera", text, True)


def _sees(frame: CameraFrame, settings: Settings) -> tuple[str, bool]:
    """The parts in the picture. None is no problem: the arm may not stand where it looks from."""
    found = finder(settings)(frame)
    if not found:
        return "no part in this picture, from where the camera is now", True
    if settings.search.plane is None:
        return f"parts in this picture: {len(found)}, the largest of {found[0].area_px:.0f} pixels", True
    whole = parts_seen(sightings(frame, found, settings))
    sizes = [1e3 * np.ptp(one.outline.vertices_m, axis=0) for one in whole]
    told = ", ".join(f"{size[0]:.0f} x {size[1]:.0f} mm" for size in sizes)
    cut = len(found) - len(whole)
    return f"parts seen whole: {told or 'none'}; {cut} cut by the border or seen twice", True


def _range(lookout: Lookout) -> tuple[str, bool]:
    assert lookout.ranger is not None
    echo = lookout.ranger.fire()
    if echo.status is Status.OK:
        return f"{echo.range_m:.4f} m (on the shoulder)", True
    return "no range (on the shoulder)", echo.status is not Status.FAULT


def _line(rig: Rig) -> str:
    """The line of a cell file that looks from here: the pose of the tool, or the joints of an arm that takes joints."""
    if rig.motion is not None:
        key, numbers = "view_joints_deg", np.degrees(rig.motion.arm.joint_state().position_rad)
    else:
        assert rig.poses is not None
        key, numbers = "views", rig.poses.tool_state().world_from_tool.ravel()
    row = ", ".join(f"{value:.6f}" for value in numbers + 0.0)
    return f"to look from here: [search] {key} = [[{row}]]"
