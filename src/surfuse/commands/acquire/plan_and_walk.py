"""The steps of an acquisition after the search, from the plan to the walk through it, each one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from surfuse.acquisition.scan import scan
from surfuse.acquisition.smooth import SmoothParameters, smooth_scan
from surfuse.commands.outcome import Watcher
from surfuse.errors import ConfigError, DataError
from surfuse.interfaces import FusionMethod
from surfuse.motion.moving_arm import MovingArm
from surfuse.motion.obstacles import Floor, Obstacle, RingTable, part_box
from surfuse.motion.planners import LinePlanner
from surfuse.plan.advice import BELOW, way_to_move, where_and_why
from surfuse.plan.approach import approach
from surfuse.plan.reach import ReachParameters
from surfuse.plan.scan_plan import PlanParameters, scan_plan, skipped_by_kind
from surfuse.records import FusionScene, JointSamples, Outline, ScanPlan, Sweep
from surfuse.rig.devices import Rig
from surfuse.runs.log_writer import LogWriter
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
    parameters = PlanParameters(settings.step_m, settings.scan.standoff_m, settings.scan.margin_m)
    check = rig.clearance(_obstacles(settings, outline))
    start = rig.arm.joint_state().position_rad
    limits = ReachParameters(clearance_min_m=settings.arm.clearance_m)
    plan = scan_plan(outline, rig.arm.kinematics, start, check, parameters, limits)
    if len(plan) == 0:
        reasons = "; ".join(f"{count} {kind}" for kind, count in skipped_by_kind(plan)) or "the outline is empty"
        raise DataError(
            f"not one of {len(plan.skipped)} stops can be visited ({reasons})",
            cure=_how_to_move(plan, rig, settings)
            or "move the part (scene.radius_m, scene.azimuth_deg) or change scan.standoff_m",
        )
    for kind, count in skipped_by_kind(plan):
        where = "" if kind == BELOW else f" ({where_and_why(plan.skipped, kind)})"
        watcher.warn(f"{count} of {count + len(plan)} stops are left out: {kind}{where}")
    if any(kind != BELOW for kind, _ in skipped_by_kind(plan)) and (advice := _how_to_move(plan, rig, settings)):
        watcher.warn(f"to reach all stops {advice}")
    return plan


def _how_to_move(plan: ScanPlan, rig: Rig, settings: Settings) -> str:
    """Where the arm would reach the whole part; empty where no such place is near."""
    here, limits = rig.arm.joint_state().position_rad, ReachParameters(clearance_min_m=settings.arm.clearance_m)
    move = way_to_move(
        plan, rig.arm.kinematics, here, lambda outline: rig.clearance(_obstacles(settings, outline)), limits
    )
    if move is None:
        return ""
    scene, keys = settings.scene, []
    if move.shift_m:
        keys.append(f"scene.radius_m = {scene.radius_m + move.shift_m:.2f}")
    if move.turn_rad:
        keys.append(f"scene.yaw_deg = {scene.yaw_deg + np.degrees(move.turn_rad):.0f}")
    return f"{move.describe()} ({', '.join(keys)}), or change scan.standoff_m"


def _obstacles(settings: Settings, outline: Outline) -> tuple[Obstacle, ...]:
    table = settings.cell
    ring = RingTable(table.table_height_m, table.table_inner_radius_m, table.table_outer_radius_m)
    return Floor(), ring, part_box(outline)


def _never() -> bool:
    return False


def go_to_start(
    rig: Rig,
    settings: Settings,
    outline: Outline,
    plan: ScanPlan,
    stop: int,
    should_stop: Callable[[], bool] = _never,
) -> None:
    """Bring the arm clear of everything to the stop before the one at which the scan begins, or goes on.

    From there the move to that stop is the one of an unbroken scan, so that what is measured is the same. Before the
    first stop the arm comes to that stop itself. `should_stop` is asked before every move; after a yes nothing moves.

    Raises
    ------
    SafetyStopError : no clear way was found; the arm has not moved.
    """
    if stop >= len(plan):
        return
    around = _obstacles(settings, outline)
    rig.surround(around)
    check = rig.clearance(around)
    here, least_m = rig.arm.joint_state().position_rad, settings.arm.clearance_m
    for joints in approach(here, plan.joints_rad[max(stop - 1, 0)], rig.arm.kinematics, check, least_m):
        if should_stop():
            return
        rig.arm.move_to(joints)


def scene_of(rig: Rig, settings: Settings, outline: Outline, plan: ScanPlan) -> FusionScene:
    """What fusion knows: sensors, part frame, the outline as seen, and the table's outer edge as the deepest range."""
    return FusionScene(
        specs=rig.specs,
        world_from_part=outline.world_from_part,
        outline=replace(outline, margin_m=0.0),
        depth_max_m=_to_outer_edge(plan, settings.cell.table_outer_radius_m),
    )


def _to_outer_edge(plan: ScanPlan, radius_m: float) -> float:
    """Largest distance along a grip axis to the cylinder of the table's outer edge."""
    start, axis = plan.world_from_grip[:, :2, 3], plan.world_from_grip[:, :2, 2]
    along = np.einsum("ij,ij->i", start, axis)
    across = np.einsum("ij,ij->i", start, start) - along**2
    return float(np.max(np.sqrt(np.maximum(radius_m**2 - across, 0.0)) - along))


class SmoothWalk(NamedTuple):
    """What a pass without stops needs besides the plan."""

    arm: MovingArm
    planner: LinePlanner
    when: SmoothParameters


def smooth_walk(rig: Rig, settings: Settings) -> SmoothWalk | None:
    """How the arm runs along the lines with these settings; None when it shall stop at every stop.

    Raises
    ------
    ConfigError : the array cannot be used while this arm moves.
    """
    if settings.scan.mode == "stops":
        return None
    if rig.smooth is None:
        raise ConfigError("scan.mode = 'smooth', but this arm has no driver for it", cure="set scan.mode = 'stops'")
    together = settings.array.trigger == "simultaneous"
    firing_s = [spec.firing_time_s for spec in rig.specs]
    sweep_s = max(firing_s) if together else sum(firing_s)
    speed = settings.scan.speed_m_s or _SWEEP_SHARE * settings.step_m / sweep_s
    reading_s = 0.5 * firing_s[0] * (settings.pings - 1) / settings.pings
    lead_s = reading_s + (0.0 if together else 0.5 * (sweep_s - firing_s[-1]))
    return SmoothWalk(rig.smooth.arm, rig.smooth.planner(speed), SmoothParameters(lead_s, reading_s))


def walk(
    rig: Rig,
    plan: ScanPlan,
    scene: FusionScene,
    method: FusionMethod,
    done: tuple[Sweep, ...],
    log: LogWriter,
    watcher: Watcher,
    bring: Callable[[int], None],
    smooth: SmoothWalk | None = None,
) -> tuple[object, list[Sweep], bool]:
    """Scan the stops that are not done, fusing live; returns the fusion state, all sweeps, whether it finished.

    With `smooth` the arm runs along the lines, and visits one by one only the stops whose sweep failed.

    `bring` takes the arm to where the walk to a stop begins (see `go_to_start`). Every sweep is on disk before the arm
    moves on; on a smooth pass, before the next one fires. Sweeps reach the fusion in the order of the stops, so that a
    resumed scan gives the same map: holes in what was done are filled before the fusion goes on. After the watcher has
    asked to stop no move begins; a line of a smooth pass that has begun ends where the arm comes to rest.
    """
    sweeps = {sweep.stop: sweep for sweep in done}
    state, fused = method.start(scene), 0
    watcher.stage("scan", len(plan))
    watcher.advance(len(sweeps))

    def keep(sweep: Sweep, samples: JointSamples | None = None) -> None:
        nonlocal fused
        log.append_sweep(sweep, samples)
        sweeps[sweep.stop] = sweep
        watcher.advance()
        while fused in sweeps:
            method.step(state, sweeps[fused])
            fused += 1

    def begin(stop: int) -> None:
        rig.begin(STOP, stop)

    def visit(first: int, last: int) -> None:
        if watcher.stop_requested():
            return
        bring(first)
        part = replace_stops(plan, last)
        scan(part, rig.arm, rig.array, keep, begin, first, watcher.stop_requested)

    if smooth is not None:
        arm, planner, when = smooth
        smooth_scan(plan, arm, rig.array, planner, keep, begin, when, bring, sweeps, watcher.stop_requested)
    reached = len(plan) if smooth is not None else max(sweeps, default=-1) + 1
    for hole in range(reached):
        if hole not in sweeps:
            visit(hole, hole + 1)
    visit(reached, len(plan))
    for stop in sorted(sweeps):
        if stop >= fused:
            method.step(state, sweeps[stop])
    return state, [sweeps[stop] for stop in sorted(sweeps)], len(sweeps) == len(plan)


def replace_stops(plan: ScanPlan, count: int) -> ScanPlan:
    """The first stops of a plan."""
    return replace(
        plan,
        world_from_grip=plan.world_from_grip[:count],
        uv_m=plan.uv_m[:count],
        row=plan.row[:count],
        joints_rad=plan.joints_rad[:count],
    )
