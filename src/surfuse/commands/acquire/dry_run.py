"""What a scan would be: its stops, what cannot be reached and why, how long it takes, a picture. Nothing moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.commands.acquire.looking import look_for_part, look_from_here
from surfuse.commands.acquire.plan_page import arm_view, plan_page
from surfuse.commands.acquire.planning import plan_for
from surfuse.commands.acquire.settings_check import doubts, refuse_contradictions
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.durable import write_text
from surfuse.errors import DataError
from surfuse.geometry.poses import inverse
from surfuse.motion.trapezoid import durations_s
from surfuse.plan.scan_plan import skipped_by_kind
from surfuse.records import Outline, ScanPlan
from surfuse.rig.area import nothing_to_scan, outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import Rig
from surfuse.rig.real.neighbourhood import part_height_m
from surfuse.settings import Settings

PICTURE = "plan.html"
_TOOL_SPEED_M_S = 0.1  # of an arm that does not say how fast it is, between stops


def dry_run(settings: Settings, out: Path | None, watcher: Watcher) -> Outcome:
    """Plan the scan of the rig as it stands; `out` is a folder for the picture of the plan.

    Raises
    ------
    SurfuseError : with the exit status of its kind; nothing has moved.
    """
    # A scan would refuse a method that there is not, before it moves; so does its rehearsal.
    create_method(settings.fusion)
    rig = assembled(settings)
    refuse_contradictions(settings, rig.specs)
    with rig.opened():
        outline = _outline(rig, settings, watcher)
        plan = plan_for(rig, settings, outline, watcher)
        reach, collisions = _reach(rig, plan), _collisions(rig, settings)
        part = plan.outline if settings.arm.is_real else outline
        arm = None if out is None else arm_view(rig, settings, part, plan)
    seconds = predicted_s(plan, rig, settings)
    notes = doubts(settings, rig.specs, plan)
    for note in notes:
        watcher.warn(note)
    rows = [
        ("stops", f"{len(plan)} every {1e3 * plan.step_m:.1f} mm, {len(plan.skipped)} left out"),
        *((f"left out, {kind}", str(count)) for kind, count in skipped_by_kind(plan)),
        ("standoff", f"{1e3 * plan.standoff_m:.0f} mm"),
        ("predicted time", f"about {seconds:.0f} s"),
        ("reach", reach),
        ("collisions", collisions),
        ("nothing moved", "leave out --dry-run to scan"),
    ]
    data: dict[str, object] = {
        "stops": len(plan),
        "stops_skipped": len(plan.skipped),
        "skipped": [{"u_m": stop.u_m, "v_m": stop.v_m, "reason": stop.reason} for stop in plan.skipped],
        "predicted_robot_time_s": seconds,
        "reach": reach,
        "collisions": collisions,
        "warnings": list(notes),
    }
    if out is not None:
        path = out / PICTURE if out.suffix == "" else out
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, plan_page(plan, outline, arm), overwrite=path.name == PICTURE)
        data["picture"], rows = str(path), [*rows, ("picture", str(path))]
    return Outcome(data, rows)


def predicted_s(plan: ScanPlan, rig: Rig, settings: Settings) -> float:
    """Time of the scan in s: the ways between the stops, rest and firing at each.

    Of an arm that takes joints with the limits that it keeps to, of another one at a slow speed of the tool.
    """
    if len(plan) == 0:
        return 0.0
    if rig.motion is not None and rig.motion.limits is not None:
        moving_s = float(np.sum(durations_s(plan.joints_rad[:-1], plan.joints_rad[1:], rig.motion.limits)))
    else:
        way_m = float(np.sum(np.linalg.norm(np.diff(plan.world_from_grip[:, :3, 3], axis=0), axis=1)))
        moving_s = way_m / (_TOOL_SPEED_M_S * (settings.arm.speed_share or 1.0))
    at_stop_s = settings.arm.settle_s + sum(spec.firing_time_s for spec in rig.specs)
    return moving_s + len(plan) * at_stop_s


def _outline(rig: Rig, settings: Settings, watcher: Watcher) -> Outline:
    if settings.area is not None:
        return outline_of(settings.area)
    if rig.lookout is None:
        raise nothing_to_scan()
    if not rig.simulated:
        try:
            return look_from_here(rig, settings, watcher).outline
        except DataError as error:
            cure = f"{error.cure}; --dry-run moves nothing: guide the arm to where the camera sees the part"
            raise DataError(error.what, where=error.where, cure=cure) from error
    return look_for_part(rig, settings, watcher).outline


def _reach(rig: Rig, plan: ScanPlan) -> str:
    """Whether somebody said which stops can be reached."""
    if rig.poses is not None:
        poses = plan.world_from_grip[:1] @ inverse(rig.tool_from_grip)
        if rig.poses.reachable(poses) is None:
            return "not checked: the arm does not say what it can reach (a bridge: 'reach' in 'can')"
    return "checked for every stop"


def _collisions(rig: Rig, settings: Settings) -> str:
    """What the arm keeps clear of, and what cannot be looked at."""
    motion = rig.motion
    if motion is None:
        return "not checked: the shape of the arm is not known; tallest_m keeps the sensors above the part"
    if motion.clearance is None:
        return f"not checked: {motion.unchecked or 'the shape of the arm is not known'}"
    if not settings.arm.is_real:
        return "checked for the arm, the array and the table"
    but = f", but {motion.unchecked}" if motion.unchecked else ""
    height_mm = 1e3 * part_height_m(settings)
    return (
        "checked at every stop and on the ways between them, for the arm and its sensors against each other, the "
        f"table, and the part up to {height_mm:.0f} mm{but}"
    )
