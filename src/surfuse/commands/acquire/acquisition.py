"""The whole acquisition on one screen: search, outline, plan, scan, fuse, map, report."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from subprocess import Popen

from surfuse.commands.acquire.clock_told import log_clock
from surfuse.commands.acquire.consent import agreed, agreed_to_look, refuse_unasked
from surfuse.commands.acquire.corners import job_with_corners
from surfuse.commands.acquire.from_anywhere import from_anywhere
from surfuse.commands.acquire.job import Job
from surfuse.commands.acquire.locating import LocatedPart, finder
from surfuse.commands.acquire.looking import PlacedPart, look_for_part
from surfuse.commands.acquire.planning import plan_for, scene_of
from surfuse.commands.acquire.results import Finished, Scanned, bus_event, doubts_of_readings, finish, outcome_of
from surfuse.commands.acquire.settings_check import doubts, refuse_contradictions
from surfuse.commands.acquire.walking import refuse_empty, walk
from surfuse.commands.acquire.warm_up import wait_for, warm_up_beside
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.commands.show.observer import UNOBSERVED, ScanObserver
from surfuse.errors import DataError, DeviceError, InterruptError, SafetyStopError, StorageError
from surfuse.records import FusionScene, ScanPlan, Sweep
from surfuse.rig.area import area_of, nothing_to_scan, outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import Rig
from surfuse.runs.configuration import read_configuration, write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_files import segment_paths
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.progress import ScanProgress, read_progress
from surfuse.runs.recorded_log import is_recorded
from surfuse.settings import Settings, from_tree


def acquire(
    settings: Settings,
    out: Path | None,
    watcher: Watcher,
    observer: ScanObserver = UNOBSERVED,
    yes: bool = False,
) -> Outcome:
    """Acquire the surface of the part in the cell into a new run folder; the observer looks on.

    `yes` agrees to the first move of a real arm; else the watcher is asked, see `consent.agreed`.

    Raises
    ------
    SurfuseError : with the exit status of its kind; whatever was scanned before is on disk.
    """
    began = time.perf_counter()
    refuse_unasked(settings, watcher, yes)
    settings = from_anywhere(settings)
    finder(settings)  # an unknown threshold is refused before anything is written
    watcher.stage("start")
    method = create_method(settings.fusion)
    with warm_up_beside(method.name) as warm_up:
        rig = assembled(settings)
        refuse_contradictions(settings, rig.specs)
        run = RunFolder.create(out or default_folder(settings.scene.name))
        with run.lock(), _resumable(run):
            write_configuration(run.configuration, settings.model_dump(exclude={"seed"}), settings.seed)
            return outcome_of(_acquire(run, Job(settings, rig, method, watcher, observer, yes), warm_up), run, began)


def resume(path: Path, watcher: Watcher, observer: ScanObserver = UNOBSERVED, yes: bool = False) -> Outcome:
    """Go on with an interrupted acquisition; the map is the one that the uninterrupted run would have given.

    `yes` as in `acquire`. A run that is complete already is left as it is.

    Raises
    ------
    DataError : not a run folder of an acquisition.
    StorageError : another process is writing in it.
    """
    began = time.perf_counter()
    run = RunFolder.open(path, need_log=False)
    tables, seed = read_configuration(run.configuration)
    if "source" in tables:
        _refuse_recording(run)
        raise DataError(
            "this run was fused from a log, there is nothing to resume",
            where=str(path),
            cure="give the folder of an acquisition, or use 'surfuse fuse'",
        )
    settings = from_tree({**tables, "seed": seed}, str(run.configuration))
    if all(file.is_file() for file in (run.surface, run.summary, run.report)):
        return _complete(run)
    refuse_unasked(settings, watcher, yes)
    watcher.stage("start")
    method = create_method(settings.fusion)
    with warm_up_beside(method.name) as warm_up:
        rig = assembled(settings)
        with run.lock(), _resumable(run):
            return outcome_of(_acquire(run, Job(settings, rig, method, watcher, observer, yes), warm_up), run, began)


def _refuse_recording(run: RunFolder) -> None:
    """A recording cannot go on where it ended: nobody knows where the other one has moved the arm since.

    Raises
    ------
    DataError : the run is one.
    """
    if not segment_paths(run.log) or not is_recorded(read_log(run.path)):
        return
    raise DataError(
        "this run is a recording of an arm that somebody else moved, it cannot be resumed",
        where=str(run.path),
        cure=f"make its map with 'surfuse fuse {run.path}', or start another one with 'surfuse record'",
    )


def _complete(run: RunFolder) -> Outcome:
    """The result of a run that was finished before; the report is the last file that an acquisition writes."""
    try:
        data = json.loads(run.summary.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise StorageError(
            f"cannot read it ({error})", where=str(run.summary), cure="remove it and resume again"
        ) from error
    rows = [("nothing to do", "the run is complete"), ("report", str(run.report))]
    return Outcome({"run": str(run.path), **data, "report": str(run.report)}, rows)


@contextmanager
def _resumable(run: RunFolder) -> Iterator[None]:
    """Say how to go on when the user stops the acquisition at once, or a device or the arm's supervision does."""
    go_on = f"go on with 'surfuse resume {run.path}'"

    def on_disk() -> str:
        return "what was scanned is on disk, " if read_progress(run.path) is not None else ""

    try:
        yield
    except KeyboardInterrupt as error:
        raise InterruptError("interrupted; what was scanned is on disk", cure=go_on) from error
    except InterruptError as error:
        raise InterruptError(error.what, cure=on_disk() + go_on) from error
    except (SafetyStopError, DeviceError) as error:
        cure = f"{error.cure}; {on_disk() or 'then '}{go_on}"
        raise type(error)(error.what, cure=cure.removeprefix("; "), where=error.where) from error


@contextmanager
def _noted(log: LogWriter, rig: Rig) -> Iterator[None]:
    """Write down in the log why the arm or a device stopped the scan."""
    try:
        yield
    except (SafetyStopError, DeviceError) as error:
        name = "safety stop" if isinstance(error, SafetyStopError) else "device"
        log.append_event(LogEvent(rig.clock.now_s(), Level.ERROR, name, error.what))
        raise


def _acquire(run: RunFolder, job: Job, warm_up: Popen[bytes] | None) -> Finished:
    rig, watcher = job.rig, job.watcher
    for warning in rig.warnings:
        watcher.warn(warning)
    # Read before the writer opens: opening gives a killed segment its missing end.
    progress = read_progress(run.path)
    with rig.opened(), LogWriter(run.log) as log:
        job = job_with_corners(run, job)
        scene, plan, done = _begin(progress, job, log)
        with _noted(log, rig):
            agreed(job, plan, min(set(range(len(plan))) - {sweep.stop for sweep in done}, default=len(plan)))
            log_clock(rig, log)
            walked = walk(job, plan, scene, done, log)
            log_clock(rig, log)
        if (trouble := bus_event(rig)) is not None:
            log.append_event(trouble)
        complete = walked.complete(plan)
        refuse_empty(walked)
        sweeps = walked.in_order()
        if complete:
            for doubt in doubts_of_readings(rig.specs, sweeps):
                _tell(rig, log, watcher, "readings", doubt)
            wait_for(warm_up, watcher)
    return finish(run, job, Scanned(walked.state, scene, plan, sweeps, complete))


def _begin(progress: ScanProgress | None, job: Job, log: LogWriter) -> tuple[FusionScene, ScanPlan, tuple[Sweep, ...]]:
    """Scene, plan and what is scanned already: from the log of an interrupted run, else by looking."""
    rig, settings, watcher = job.rig, job.settings, job.watcher
    if progress is not None:
        log.append_scene(progress.scene)
        log.append_plan(progress.plan)
        if progress.done and rig.simulated:
            rig.clock.advance(max(float(sweep.t_s.max()) for sweep in progress.done))
        log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, "resume", f"{len(progress.left)} stops are left"))
        return progress.scene, progress.plan, progress.done
    part = _located(job)
    outline = part.outline if part is not None else outline_of(area_of(settings))
    plan = plan_for(rig, settings, outline, watcher)
    scene = scene_of(rig, settings, outline, plan)
    log.append_scene(scene)
    if part is not None:
        for frame in part.frames:
            log.append_frame(frame)
        text = f"part found after {part.pictures} pictures"
        log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, "search", text))
    log.append_plan(plan)
    for doubt in doubts(settings, rig.specs, plan):
        _tell(rig, log, watcher, "settings", doubt)
    return scene, plan, ()


def _located(job: Job) -> LocatedPart | PlacedPart | None:
    """The part that the lookout finds; None where the area to scan is given.

    Raises
    ------
    ConfigError : neither is there.
    """
    if job.settings.area is not None:
        return None
    if job.rig.lookout is None:
        raise nothing_to_scan()
    agreed_to_look(job)
    return look_for_part(job.rig, job.settings, job.watcher)


def _tell(rig: Rig, log: LogWriter, watcher: Watcher, source: str, doubt: str) -> None:
    """A doubt for the user, now and in the report."""
    watcher.warn(doubt)
    log.append_event(LogEvent(rig.clock.now_s(), Level.WARN, source, doubt))


def default_folder(scene: str) -> Path:
    """`runs/<scene>-<date>-<time>`, counted up when it is taken."""
    stem = f"{Path(scene).stem or 'scan'}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    candidate, count = Path("runs") / stem, 2
    while candidate.exists():
        candidate, count = Path("runs") / f"{stem}-{count}", count + 1
    return candidate
