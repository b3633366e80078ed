"""Somebody else moves the arm: every sweep goes to the log, and what was seen becomes a map."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from surfuse.acquisition.recording import OFF_LIMIT_M, RecordingHooks, record
from surfuse.commands.acquire.acquisition import default_folder
from surfuse.commands.acquire.clock_told import log_clock
from surfuse.commands.acquire.corners import with_corners
from surfuse.commands.acquire.recorded_map import map_of_recording
from surfuse.commands.acquire.recording_shown import Covered, ShownRecording, Tally
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.commands.show.observer import UNOBSERVED, ScanObserver
from surfuse.errors import ConfigError, DeviceError, InterruptError, SafetyStopError, UsageError
from surfuse.geometry.poses import inverse
from surfuse.records import FusionScene, Sweep
from surfuse.rig.area import outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import Rig
from surfuse.runs.configuration import write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_files import segment_paths
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.odd_sensors import HeardOfSensors
from surfuse.runs.recorded_log import RECORDED
from surfuse.settings import Settings

MOST_MINUTES = 1e5
"""Of a recording; more than two months are meant otherwise."""

NOT_YET = np.eye(4)
"""Part frame of the scene of a recording without an area: its readings give one when they are fused."""


def record_run(
    settings: Settings,
    out: Path | None,
    watcher: Watcher,
    minutes: float | None = None,
    show: Callable[[Tally], None] = lambda tally: None,
    observer: ScanObserver = UNOBSERVED,
) -> Outcome:
    """Record until the watcher wants a stop, or `minutes` have passed; then fuse. `show` is called after each sweep.

    The observer looks on.

    Raises
    ------
    ConfigError : the cell is no real rig.
    UsageError : `minutes` are no time.
    SurfuseError : with the exit status of its kind; whatever was recorded before is on disk.
    """
    began = time.perf_counter()
    _check_minutes(minutes)
    if not settings.arm.is_real:
        raise ConfigError(
            "nobody moves the arm of the simulated cell but surfuse",
            cure="give the cell file of a real rig with --cell, or use 'surfuse acquire'",
        )
    watcher.stage("start")
    method = create_method(settings.fusion)
    rig = replace(assembled(settings), lookout=None)  # nothing is looked for, and a camera would be opened in vain
    run = RunFolder.create(out or default_folder("recorded"))
    with run.lock(), _kept(run):
        _write_settings(run, settings)
        shown = partial(ShownRecording, observer, method=method.name)
        tally = _record(run, rig, settings, _Lookers(watcher, minutes, show, shown))
        done = map_of_recording(run, method, (watcher, observer), tally, rig.stamps())
    wall_s = time.perf_counter() - began
    return replace(done, summary={**done.summary, "wall_time_s": wall_s}, table=[*done.table, _wall(wall_s)])


def _wall(wall_s: float) -> tuple[str, str]:
    return "wall time", f"{wall_s:.1f} s"


def _check_minutes(minutes: float | None) -> None:
    if minutes is not None and not 0.0 < minutes <= MOST_MINUTES:
        raise UsageError(
            f"--minutes {minutes:g}, it must be above 0 and at most {MOST_MINUTES:g}",
            cure="leave it out to record until Ctrl-C",
        )


def _write_settings(run: RunFolder, settings: Settings) -> None:
    # The source says that there is nothing to resume.
    tree = {**settings.model_dump(exclude={"seed"}), "source": {"log": str(run.log.resolve())}}
    write_configuration(run.configuration, tree, settings.seed)


@contextmanager
def _kept(run: RunFolder) -> Iterator[None]:
    """Say where the readings are when the recording ends with an error."""
    cure = f"what was recorded is on disk, make its map with 'surfuse fuse {run.path}', or start another recording"
    try:
        yield
    except KeyboardInterrupt as error:
        raise InterruptError("interrupted", cure=cure) from error
    except (SafetyStopError, DeviceError) as error:
        if not segment_paths(run.log):
            raise
        raise type(error)(error.what, cure=f"{error.cure}; {cure}".removeprefix("; "), where=error.where) from error


@dataclass(frozen=True)
class _Lookers:
    """Who is told of a recording, and who ends it; `shown` makes what tells an observer."""

    watcher: Watcher
    minutes: float | None
    show: Callable[[Tally], None]
    shown: Callable[[Settings, FusionScene], ShownRecording]


def _record(run: RunFolder, rig: Rig, settings: Settings, lookers: _Lookers) -> Tally:
    """All sweeps, in the log; what the recording has."""
    watcher = lookers.watcher
    with rig.guided(), rig.opened(), LogWriter(run.log) as log:
        shown = with_corners(settings, rig, watcher)
        if shown is not settings:
            settings = shown
            _write_settings(run, settings)
        scene = _scene(rig, settings)
        log.append_scene(scene)
        log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, RECORDED, "somebody else moves the arm"))
        log_clock(rig, log)
        tally = Tally(time.monotonic(), _covered(rig, settings, scene), HeardOfSensors(rig.specs))
        watcher.stage("record")
        try:
            hooks = _hooks(log, tally, lookers, lookers.shown(settings, scene))
            record(rig.stop_arm, rig.array, _lags(settings), hooks, _stamps_off_s(rig))
            log_clock(rig, log)
        except (SafetyStopError, DeviceError) as error:
            log.append_event(LogEvent(rig.clock.now_s(), Level.ERROR, "device", error.what))
            raise
        if (text := _left_out(tally)) is not None:
            log.append_event(LogEvent(rig.clock.now_s(), Level.WARN, "readings", text))
            watcher.warn(text)
        for odd in tally.heard.sentences():  # the user is told of them when the log is opened for its map
            log.append_event(LogEvent(rig.clock.now_s(), Level.WARN, "readings", odd))
    return tally


def _covered(rig: Rig, settings: Settings, scene: FusionScene) -> Covered:
    frame = None if scene.outline is None else inverse(scene.world_from_part)
    return Covered(rig.specs, settings.step_m, frame)


def _stamps_off_s(rig: Rig) -> Callable[[], tuple[float, ...]] | None:
    """How far stamps may now be off the arm's clock; None for a rig of one clock."""
    if rig.stamps() is None:
        return None

    def off_s() -> tuple[float, ...]:
        stamps = rig.stamps()
        assert stamps is not None
        return stamps.off_s

    return off_s


def _hooks(log: LogWriter, tally: Tally, lookers: _Lookers, shown: ShownRecording) -> RecordingHooks:
    watcher, minutes = lookers.watcher, lookers.minutes

    def keep(sweep: Sweep) -> None:
        log.append_sweep(sweep)
        tally.sweeps += 1
        tally.covered.take(sweep)
        tally.heard.take(sweep)
        watcher.advance()
        lookers.show(tally)
        shown.take(sweep)

    def leave_out(off_m: float) -> None:
        tally.left_out += 1
        if math.isfinite(off_m):
            tally.most_off_m = max(tally.most_off_m, off_m)

    def over() -> bool:
        passed_s = time.monotonic() - tally.began_s
        return watcher.stop_requested() or (minutes is not None and passed_s >= 60.0 * minutes)

    return RecordingHooks(keep, leave_out, over)


def _scene(rig: Rig, settings: Settings) -> FusionScene:
    """Sensors, and the part frame and boundary of the area if there is one."""
    if settings.area is None:
        return FusionScene(specs=rig.specs, world_from_part=NOT_YET)
    outline = outline_of(settings.area)
    return FusionScene(specs=rig.specs, world_from_part=outline.world_from_part, outline=outline)


def _lags(settings: Settings) -> tuple[float, ...]:
    return tuple(sensor.lag_s for sensor in settings.sensor)


def _left_out(tally: Tally) -> str | None:
    """A sentence about the sweeps that were not kept; None when only those at its beginning and end are."""
    if tally.most_off_m == 0.0:
        return None
    return (
        f"{tally.left_out} of {tally.sweeps + tally.left_out} sweeps are left out: between two states of the arm what "
        f"a sensor looks at may be off by up to {1e3 * tally.most_off_m:.0f} mm, at most {1e3 * OFF_LIMIT_M:g} mm; "
        "move more slowly, or let the bridge tell its state faster"
    )
