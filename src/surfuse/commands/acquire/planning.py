"""From the outline to the plan: margin, raster, reach and clearance of every stop, before the arm moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfuse.commands.outcome import Watcher
from surfuse.errors import DataError
from surfuse.geometry.poses import inverse
from surfuse.motion.obstacles import Floor, Obstacle, RingTable, part_box
from surfuse.plan.advice import BELOW, way_to_move, where_and_why
from surfuse.plan.margin import margin_on_plane, scan_area
from surfuse.plan.pose_plan import pose_plan
from surfuse.plan.reach import ReachParameters
from surfuse.plan.scan_plan import PlanParameters, area_to_scan, scan_plan, skipped_by_kind
from surfuse.records import BoolArray, FloatArray, FusionScene, Outline, ScanPlan
from surfuse.rig.area import check_faces
from surfuse.rig.devices import JointMotion, Rig
from surfuse.rig.real.neighbourhood import part_and_table, part_height_m
from surfuse.settings import Settings

STOP = "stop"
_SWEEP_SHARE = 0.95  # of the time between two stops that a sweep may take: triggers are never quite on time


def plan_for(rig: Rig, settings: Settings, outline: Outline, watcher: Watcher) -> ScanPlan:
    """Margin, raster, reach and clearance of every stop, before the arm moves.

    Raises
    ------
    DataError : not one stop can be visited; the reasons are counted.
    """
    watcher.stage("plan")
    parameters = _parameters(settings, outline)
    if rig.motion is None:
        plan = _plan_of_poses(rig, settings, outline, parameters)
    else:
        plan = _plan_of_joints(rig.motion, settings, outline, parameters)
    if len(plan) == 0:
        reasons = "; ".join(f"{count} {kind}" for kind, count in skipped_by_kind(plan)) or "the outline is empty"
        raise DataError(
            f"not one of {len(plan.skipped)} stops can be visited ({reasons})",
            cure=_how_to_move(plan, rig, settings) or _other_place(settings, outline),
        )
    for kind, count in skipped_by_kind(plan):
        where = "" if kind == BELOW else f" ({where_and_why(plan.skipped, kind)})"
        watcher.warn(f"{count} of {count + len(plan)} stops are left out: {kind}{where}")
    if any(kind != BELOW for kind, _ in skipped_by_kind(plan)) and (advice := _how_to_move(plan, rig, settings)):
        watcher.warn(f"to reach all stops {advice}")
    return plan


def around_table(settings: Settings) -> bool:
    """Whether the part stands on the ring table, and not in a given area or on a plane of its own."""
    return settings.area is None and settings.search.plane is None


def _parameters(settings: Settings, outline: Outline) -> PlanParameters:
    """The raster. Only on the ring table is v = 0 an edge that no line may be below.

    A given area is enlarged by nothing but a given margin, an outline by what its uncertainty asks for.
    """
    margin_m = settings.scan.margin_m
    usual = PlanParameters(settings.step_m, settings.scan.standoff_m, margin_m)
    if around_table(settings):
        return usual
    if margin_m is None:
        margin_m = 0.0 if settings.area is not None else margin_on_plane(outline, settings.step_m)
    return replace(usual, margin_m=margin_m, lowest_v_m=-np.inf, nearest_turn=True)


def _plan_of_joints(motion: JointMotion, settings: Settings, outline: Outline, parameters: PlanParameters) -> ScanPlan:
    start = motion.arm.joint_state().position_rad
    # Every move of a real arm is checked again, and all that is left of the outline then is the one with its margin.
    part = area_to_scan(outline, parameters) if settings.arm.is_real else outline
    check = None if motion.clearance is None else motion.clearance(obstacles(settings, part))
    limits = ReachParameters(clearance_min_m=settings.arm.clearance_m)
    return scan_plan(outline, motion.arm.kinematics, start, check, parameters, limits)


def _plan_of_poses(rig: Rig, settings: Settings, outline: Outline, parameters: PlanParameters) -> ScanPlan:
    assert rig.poses is not None
    grip_from_tool = inverse(rig.tool_from_grip)
    arm = rig.poses
    here = arm.tool_state().world_from_tool @ rig.tool_from_grip
    check_faces(outline.world_from_part, here, found=settings.area is None)
    if parameters.margin_m is None:
        outline = scan_area(outline, parameters.step_m)

    def reachable(world_from_grip: FloatArray) -> BoolArray:
        found = arm.reachable(world_from_grip @ grip_from_tool)
        return np.ones(len(world_from_grip), dtype=np.bool_) if found is None else found

    return pose_plan(outline, reachable, here, parameters)


def _other_place(settings: Settings, outline: Outline) -> str:
    if settings.area is not None:
        return "check the frame and the size of [area], the places of the sensors, or change scan.standoff_m"
    if settings.arm.is_real:
        place = ", ".join(f"{value:.3f}" for value in outline.world_from_part[:3, 3])
        return (
            f"the camera puts the part at ({place}) m: move it into the reach of the arm, check the pose of the camera "
            "and search.plane, or change scan.standoff_m"
        )
    return "move the part (scene.radius_m, scene.azimuth_deg) or change scan.standoff_m"


def _how_to_move(plan: ScanPlan, rig: Rig, settings: Settings) -> str:
    """Where the arm would reach the whole part; empty where no such place is near, or the part cannot be moved."""
    if rig.motion is None or rig.motion.clearance is None or settings.arm.is_real or not around_table(settings):
        return ""
    arm, clearance = rig.motion.arm, rig.motion.clearance
    here, limits = arm.joint_state().position_rad, ReachParameters(clearance_min_m=settings.arm.clearance_m)
    move = way_to_move(plan, arm.kinematics, here, lambda outline: clearance(obstacles(settings, outline)), limits)
    if move is None:
        return ""
    scene, keys = settings.scene, []
    if move.shift_m:
        keys.append(f"scene.radius_m = {scene.radius_m + move.shift_m:.2f}")
    if move.turn_rad:
        keys.append(f"scene.yaw_deg = {scene.yaw_deg + np.degrees(move.turn_rad):.0f}")
    return f"{move.describe()} ({', '.join(keys)}), or change scan.standoff_m"


def obstacles(settings: Settings, outline: Outline) -> tuple[Obstacle, ...]:
    """What stands around the arm.

    On the ring table: floor, table, and a box around the part. Away from it a real arm has the part and the plane that
    it lies on, and of a simulated one nothing is known.
    """
    if settings.arm.is_real and not around_table(settings):
        return part_and_table(settings, outline)
    if not around_table(settings):
        return ()
    table = settings.cell
    ring = RingTable(table.table_height_m, table.table_inner_radius_m, table.table_outer_radius_m)
    box = part_box(outline, part_height_m(settings)) if settings.arm.is_real else part_box(outline)
    return Floor(), ring, box


def scene_of(rig: Rig, settings: Settings, outline: Outline, plan: ScanPlan) -> FusionScene:
    """What fusion knows: sensors, part frame, the outline as seen, and the table's outer edge as the deepest range.

    Away from the ring table there is no such edge.
    """
    edge_m = _to_outer_edge(plan, settings.cell.table_outer_radius_m) if around_table(settings) else float("inf")
    return FusionScene(
        specs=rig.specs,
        world_from_part=outline.world_from_part,
        outline=replace(outline, margin_m=0.0),
        depth_max_m=edge_m,
    )


def _to_outer_edge(plan: ScanPlan, radius_m: float) -> float:
    """Largest distance along a grip axis to the cylinder of the table's outer edge."""
    start, axis = plan.world_from_grip[:, :2, 3], plan.world_from_grip[:, :2, 2]
    along = np.einsum("ij,ij->i", start, axis)
    across = np.einsum("ij,ij->i", start, start) - along**2
    return float(np.max(np.sqrt(np.maximum(radius_m**2 - across, 0.0)) - along))
