"""What a scan would be: its stops, what cannot be reached and why, how long it takes, a picture. Nothing moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from surfuse.arms.bridge import BridgeArm
from surfuse.commands.acquire.looking import look_for_part, look_from_here
from surfuse.commands.acquire.planning import plan_for
from surfuse.commands.acquire.settings_check import doubts, refuse_contradictions
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.durable import write_text
from surfuse.errors import DataError
from surfuse.plan.scan_plan import skipped_by_kind
from surfuse.records import Outline, ScanPlan, SensorSpec
from surfuse.report.content import plan_view
from surfuse.report.markup import Markup, element
from surfuse.report.plan_drawing import plan_chart
from surfuse.report.skeleton import stylesheet
from surfuse.rig.area import nothing_to_scan, outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import Rig
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
        reach = _reach(rig)
    seconds = predicted_s(plan, rig.specs, settings)
    notes = doubts(settings, rig.specs, plan)
    for note in notes:
        watcher.warn(note)
    rows = [
        ("stops", f"{len(plan)} every {1e3 * plan.step_m:.1f} mm, {len(plan.skipped)} left out"),
        *((f"left out, {kind}", str(count)) for kind, count in skipped_by_kind(plan)),
        ("standoff", f"{1e3 * plan.standoff_m:.0f} mm"),
        ("predicted time", f"about {seconds:.0f} s"),
        ("reach", reach),
        ("collisions", _collisions(rig)),
        ("nothing moved", "leave out --dry-run to scan"),
    ]
    data: dict[str, object] = {
        "stops": len(plan),
        "stops_skipped": len(plan.skipped),
        "skipped": [{"u_m": stop.u_m, "v_m": stop.v_m, "reason": stop.reason} for stop in plan.skipped],
        "predicted_robot_time_s": seconds,
        "warnings": list(notes),
    }
    if out is not None:
        path = out / PICTURE if out.suffix == "" else out
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, _page(plan, outline))
        data["picture"], rows = str(path), [*rows, ("picture", str(path))]
    return Outcome(data, rows)


def _page(plan: ScanPlan, outline: Outline) -> str:
    """The plan as a page without a script."""
    title = "Plan of a scan"
    head = [element("meta", {"charset": "utf-8"}), element("title", None, title)]
    chart = element("figure", None, plan_chart(plan_view(plan, outline.vertices_m)))
    body = element("main", None, element("h1", None, title), chart)
    style = Markup(f"<style>{stylesheet()}</style>")
    page = element("html", {"lang": "en"}, element("head", None, *head, style), element("body", None, body))
    return f"<!doctype html>\n{page}\n"


def predicted_s(plan: ScanPlan, specs: Sequence[SensorSpec], settings: Settings) -> float:
    """Time of the scan in s: the way between the stops at a slow speed, rest and firing at each."""
    if len(plan) == 0:
        return 0.0
    way_m = float(np.sum(np.linalg.norm(np.diff(plan.world_from_grip[:, :3, 3], axis=0), axis=1)))
    at_stop_s = settings.arm.settle_s + sum(spec.firing_time_s for spec in specs)
    return way_m / (_TOOL_SPEED_M_S * (settings.arm.speed_share or 1.0)) + len(plan) * at_stop_s


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


def _reach(rig: Rig) -> str:
    if isinstance(rig.poses, BridgeArm) and not rig.poses.tells_reach:
        return "not checked: the bridge does not say what its arm can reach ('reach' in 'can')"
    return "checked for every stop"


def _collisions(rig: Rig) -> str:
    if rig.motion is not None and rig.motion.clearance is not None:
        return "checked for the arm, the array and the table"
    return "not checked: the shape of the arm is not known; tallest_m keeps the sensors above the part"
