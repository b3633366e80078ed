"""The walk through the plan: to where it begins, then stop by stop or along the lines, fused live."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from surfuse.acquisition.scan import WalkHooks, scan
from surfuse.acquisition.smooth import PassHooks, SmoothParameters, SmoothPass, smooth_scan
from surfuse.commands.acquire.consent import FIRST_MOVES_SHARE
from surfuse.commands.acquire.job import Job
from surfuse.commands.acquire.planning import obstacles
from surfuse.commands.acquire.warm_up import compiled_before
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.show.observer import PlannedScan
from surfuse.errors import ConfigError, UnreachableError
from surfuse.geometry.poses import inverse
from surfuse.plan.approach import approach
from surfuse.records import FusionScene, JointSamples, Outline, ScanPlan, Sweep
from surfuse.rig.description import sweep_time
from surfuse.rig.devices import JointMotion, Rig
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.log_writer import LogWriter
from surfuse.settings import Settings

STOP = "stop"
UNREACHABLE = "unreachable"
_SWEEP_SHARE = 0.95  # of the time between two stops that a sweep may take: triggers are never quite on time
_ON_PLANE_M = 1e-3


def go_to_start(job: Job, outline: Outline, plan: ScanPlan, stop: int) -> None:
    """Bring the arm clear of everything to the stop before the one at which the scan begins, or goes on.

    From there the move to that stop is the one of an unbroken scan, so that what is measured is the same. Before the
    first stop the arm comes to that stop itself. The watcher is asked before every move; after a request to stop
    nothing moves.

    Raises
    ------
    SafetyStopError : no clear way was found; the arm has not moved.
    """
    if stop >= len(plan):
        return
    if job.rig.motion is None:
        _rise(job, plan, max(stop - 1, 0))
    else:
        _approach(job, job.rig.motion, outline, plan, max(stop - 1, 0))


def _approach(job: Job, motion: JointMotion, outline: Outline, plan: ScanPlan, stop: int) -> None:
    """Joint moves that keep clear; without a known shape of the arm the one straight move."""
    around = obstacles(job.settings, outline)
    motion.surround(around)
    here, target = motion.arm.joint_state().position_rad, plan.joints_rad[stop]
    if motion.clearance is None:
        way = [target]
    else:
        # A real arm begins wherever it was left, perhaps nearer to its table than a scan goes.
        check, least_m, real = motion.clearance(around), job.settings.arm.clearance_m, not job.rig.simulated
        way = list(approach(here, target, motion.arm.kinematics, check, least_m, from_within=real))
    share = None if job.rig.simulated else FIRST_MOVES_SHARE
    for joints in way:
        if job.watcher.stop_requested():
            return
        motion.arm.move_to(joints, share)


def _rise(job: Job, plan: ScanPlan, stop: int) -> None:
    """An arm of which only poses are known leaves the part along w, crosses at the standoff, and comes to the stop."""
    arm = job.rig.poses
    assert arm is not None
    to_tool = inverse(job.rig.tool_from_grip)
    here = arm.tool_state().world_from_tool @ job.rig.tool_from_grip
    world_from_part = plan.outline.world_from_part
    height_m = float((inverse(world_from_part) @ here)[2, 3])
    way = []
    if height_m < plan.standoff_m - _ON_PLANE_M:
        up = here.copy()
        up[:3, 3] += (plan.standoff_m - height_m) * world_from_part[:3, 2]
        way.append(up)
    for world_from_grip in (*way, plan.world_from_grip[stop]):
        if job.watcher.stop_requested():
            return
        try:
            arm.move_to_pose(world_from_grip @ to_tool, FIRST_MOVES_SHARE)
        except UnreachableError:
            # The walk itself will say which stop cannot be reached; a straight way up may be out of reach, too.
            continue


def refuse_empty(walked: Walked) -> None:
    """Refuse a scan of which the arm could take no stop at all; a resumed one tries them again.

    Raises
    ------
    UnreachableError : with the arm's reason for the last one.
    """
    if walked.unreachable and not walked.sweeps:
        reason = walked.unreachable[max(walked.unreachable)]
        raise UnreachableError(
            f"the arm refused all {len(walked.unreachable)} stops, the last because {reason}",
            cure="check origin_m, u and v of [area], or the pose of the camera, the places of the sensors and "
            "scan.standoff_m",
        )


def smooth_pass(rig: Rig, settings: Settings) -> SmoothPass | None:
    """How the arm runs along the lines with these settings; None when it shall stop at every stop.

    Raises
    ------
    ConfigError : the array cannot be used while this arm moves.
    """
    if settings.scan.mode == "stops":
        return None
    smooth = None if rig.motion is None else rig.motion.smooth
    if smooth is None:
        raise ConfigError("scan.mode = 'smooth', but this arm has no driver for it", cure="set scan.mode = 'stops'")
    together = settings.array.trigger == "simultaneous"
    firing_s = [spec.firing_time_s for spec in rig.specs]
    time = sweep_time(settings, rig.specs)
    speed = settings.scan.speed_m_s or min(
        _SWEEP_SHARE * settings.step_m / time.firing_s, settings.step_m / time.total_s
    )
    reading_s = 0.5 * firing_s[0] * (settings.pings - 1) / settings.pings
    lead_s = reading_s + (0.0 if together else 0.5 * (time.firing_s - firing_s[-1]))
    return SmoothPass(smooth.arm, smooth.planner(speed), SmoothParameters(lead_s, reading_s))


@dataclass
class Walked:
    """How far a walk came: the sweeps by stop, the state of the fusion, and the stops that could not be reached."""

    state: object
    sweeps: dict[int, Sweep]
    unreachable: dict[int, str] = field(default_factory=dict)
    fused: int = 0

    def in_order(self) -> list[Sweep]:
        """The sweeps in the order of their stops."""
        return [self.sweeps[stop] for stop in sorted(self.sweeps)]

    def complete(self, plan: ScanPlan) -> bool:
        """Whether every stop that could be reached has its sweep."""
        return len(self.sweeps) + len(self.unreachable) == len(plan)


def walk(job: Job, plan: ScanPlan, scene: FusionScene, done: tuple[Sweep, ...], log: LogWriter) -> Walked:
    """Scan the stops that are not done, fusing live.

    On a smooth pass the arm runs along the lines, and visits one by one only the stops whose sweep failed. Every sweep
    is on disk before the arm moves on; on a smooth pass, before the next one fires. Sweeps reach the fusion in the
    order of the stops, so that a resumed scan gives the same map: holes in what was done are filled before the fusion
    goes on. A stop that the arm refuses is left out. After the watcher has asked to stop no move begins; a line
    of a smooth pass that has begun ends where the arm comes to rest.
    """
    walked = Walked(job.method.start(scene), {sweep.stop: sweep for sweep in done})
    job.watcher.stage("scan", len(plan))
    job.watcher.advance(len(walked.sweeps))
    job.observer.planned(_as_planned(job, plan, scene, done))

    def fuse_on() -> None:
        while walked.fused in walked.sweeps or walked.fused in walked.unreachable:
            if walked.fused in walked.sweeps:
                job.method.step(walked.state, walked.sweeps[walked.fused])
            walked.fused += 1

    def keep(sweep: Sweep, samples: JointSamples | None = None) -> None:
        log.append_sweep(sweep, samples)
        walked.sweeps[sweep.stop] = sweep
        job.watcher.advance()
        fuse_on()
        job.observer.swept(sweep)

    def leave_out(stop: int, error: UnreachableError) -> None:
        text = f"stop {stop} is left out: {error.what}"
        log.append_event(LogEvent(job.rig.clock.now_s(), Level.WARN, UNREACHABLE, text))
        job.watcher.warn(text)
        walked.unreachable[stop] = error.what
        fuse_on()

    _visit_all(job, plan, walked, keep, leave_out)
    for stop in sorted(walked.sweeps):
        if stop >= walked.fused:
            job.method.step(walked.state, walked.sweeps[stop])
    return walked


def _as_planned(job: Job, plan: ScanPlan, scene: FusionScene, done: tuple[Sweep, ...]) -> PlannedScan:
    link_poses = None if job.rig.motion is None else job.rig.motion.link_poses
    return PlannedScan(
        scene,
        plan,
        done,
        partial(create_method, job.settings.fusion, job.method.name),
        partial(compiled_before, job.method.name),
        link_poses,
    )


def _visit_all(
    job: Job,
    plan: ScanPlan,
    walked: Walked,
    keep: Callable[..., None],
    leave_out: Callable[[int, UnreachableError], None],
) -> None:
    """Every stop that has no sweep yet: along the lines first if so wanted, holes next, then the rest."""
    rig, should_stop = job.rig, job.watcher.stop_requested

    def begin(stop: int) -> None:
        rig.begin(STOP, stop)

    def bring(stop: int) -> None:
        go_to_start(job, plan.outline, plan, stop)

    def visit(first: int, last: int) -> None:
        if should_stop():
            return
        bring(first)
        scan(first_stops(plan, last), rig.stop_arm, rig.array, WalkHooks(keep, begin, should_stop, leave_out), first)

    run = smooth_pass(rig, job.settings)
    if run is not None:
        smooth_scan(plan, run, rig.array, PassHooks(keep, begin, bring, should_stop), walked.sweeps)
    reached = len(plan) if run is not None else max(walked.sweeps, default=-1) + 1
    for hole in range(reached):
        if hole not in walked.sweeps:
            visit(hole, hole + 1)
    visit(reached, len(plan))


def first_stops(plan: ScanPlan, count: int) -> ScanPlan:
    """The first stops of a plan."""
    return replace(
        plan,
        world_from_grip=plan.world_from_grip[:count],
        uv_m=plan.uv_m[:count],
        row=plan.row[:count],
        joints_rad=plan.joints_rad[:count],
    )
