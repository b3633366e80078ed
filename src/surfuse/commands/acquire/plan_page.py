"""The picture of a plan: stops from above, and the arm from two sides with what it would touch."""

from __future__ import annotations

from typing import Literal

import numpy as np

from surfuse.commands.acquire.planning import obstacles
from surfuse.geometry.poses import inverse, pose, transform_points
from surfuse.motion.choice import follow, nearest_configuration
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.obstacles import Box, HalfSpace
from surfuse.records import FloatArray, Outline, ScanPlan, SkippedStop
from surfuse.report.arm_drawing import STYLE, ArmView, Posture, arm_chart
from surfuse.report.content import plan_view
from surfuse.report.markup import Child, Markup, element
from surfuse.report.plan_drawing import plan_chart
from surfuse.report.skeleton import stylesheet
from surfuse.rig.devices import JointMotion, Rig
from surfuse.settings import Settings

_TOUCHING = ("clearance", "way from the stop before")
_COLLISIONS_SHOWN = 2


def plan_page(plan: ScanPlan, outline: Outline, arm: ArmView | None) -> str:
    """The plan as a page without a script."""
    title = "Plan of a scan"
    head = [element("meta", {"charset": "utf-8"}), element("title", None, title)]
    blocks: list[Child] = [
        element("h1", None, title),
        element("figure", None, plan_chart(plan_view(plan, outline.vertices_m))),
    ]
    if arm is not None:
        words = [element("li", None, posture.words) for posture in arm.postures]
        blocks += [element("h2", None, "The arm from two sides"), element("ul", None, *words)]
        blocks += [element("figure", None, arm_chart(arm, 0)), element("figure", None, arm_chart(arm, 1))]
    style = Markup(f"<style>{stylesheet()}{STYLE}</style>")
    body = element("body", None, element("main", None, *blocks))
    return f"<!doctype html>\n{element('html', {'lang': 'en'}, element('head', None, *head, style), body)}\n"


def arm_view(rig: Rig, settings: Settings, outline: Outline, plan: ScanPlan) -> ArmView | None:
    """The arm as it stands, at the first stop, and at left-out stops at which it would touch something.

    None where nothing is known of the arm; it must be open.
    """
    motion = rig.motion
    if motion is None or motion.link_poses is None:
        return None
    around = obstacles(settings, outline)
    check = None if motion.clearance is None else motion.clearance(around)
    here = motion.arm.joint_state().position_rad
    postures = [_posture("grey: how it stands now", "now", here, motion, check, outline)]
    if len(plan):
        postures.append(_posture("blue: at the first stop", "stop", plan.joints_rad[0], motion, check, outline))
    postures += [
        _posture(f"orange: left out, {stop.reason}", "touching", joints, motion, check, outline)
        for stop, joints in _touching(motion, plan)
    ]
    boxes = [solid for solid in around if isinstance(solid, Box)]
    part = np.array([boxes[0].lower_m, boxes[0].upper_m]) if boxes else np.zeros((2, 3))
    tables = [solid.point_m for solid in around if isinstance(solid, HalfSpace)]
    table_m = float(transform_points(inverse(outline.world_from_part), np.array(tables[:1]))[0, 2]) if tables else None
    stops = np.column_stack([plan.uv_m, np.full(len(plan), plan.standoff_m)])
    return ArmView(tuple(postures), part, table_m, stops)


def _touching(motion: JointMotion, plan: ScanPlan) -> list[tuple[SkippedStop, FloatArray]]:
    """A few stops that were left out because the arm would touch something there, and its joints (J,)."""
    kinds: dict[str, list[SkippedStop]] = {}
    for stop in plan.skipped:
        if stop.reason.startswith(_TOUCHING):
            kinds.setdefault(stop.reason.split(":")[0], []).append(stop)
    kinematics, found = motion.arm.kinematics, []
    for stops in list(kinds.values())[:_COLLISIONS_SHOWN]:
        stop = stops[len(stops) // 2]
        i = int(np.argmin(np.hypot(*(plan.uv_m - [stop.u_m, stop.v_m]).T)))
        # From the nearest stop of the plan on, so that the arm is in the configuration of the scan.
        targets = np.array([plan.world_from_grip[i], _world_from_grip(plan, stop)])
        solutions, valid = kinematics.inverse(targets)
        limits = kinematics.lower_rad, kinematics.upper_rad
        _, index = nearest_configuration(solutions[:1], valid[:1], plan.joints_rad[i], *limits)
        if index[0] >= 0 and valid[1, index[0]]:
            found.append((stop, follow(solutions[1:, index[0]], plan.joints_rad[i], *limits)[0]))
    return found


def _world_from_grip(plan: ScanPlan, stop: SkippedStop) -> FloatArray:
    """Where the grip would have been: turned as at the stops of the plan."""
    shift = np.array([stop.u_m, stop.v_m, 0.0]) - np.array([*plan.uv_m[0], 0.0])
    moved: FloatArray = pose(np.eye(3), plan.outline.world_from_part[:3, :3] @ shift) @ plan.world_from_grip[0]
    return moved


def _posture(
    words: str,
    kind: Literal["now", "stop", "touching"],
    joints_rad: FloatArray,
    motion: JointMotion,
    check: ClearanceModel | None,
    outline: Outline,
) -> Posture:
    assert motion.link_poses is not None
    part_from_world, links = inverse(outline.world_from_part), motion.link_poses(joints_rad[None])
    origins = transform_points(part_from_world, links[0, :, :3, 3])
    if check is None:
        return Posture(words, kind, np.zeros((0, 3)), np.zeros(0), origins, np.zeros(0, dtype=np.bool_))
    body, gaps = check.body, check(joints_rad)
    at = (body.part == gaps.part[0]) & (kind == "touching")
    centers = transform_points(part_from_world, body.place(links)[0])
    return Posture(words, kind, centers, body.radius_m, origins, at)
