"""Somebody else moves the arm: every sweep goes to the log, and what was seen becomes a map."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surfuse import __version__
from surfuse.acquisition.recording import OFF_LIMIT_M, RecordingHooks, record
from surfuse.commands.acquire.acquisition import default_folder
from surfuse.commands.acquire.corners import with_corners
from surfuse.commands.fuse.map_of_log import fused, grid_of, opened, require_cells
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.maps.report import write_report
from surfuse.commands.outcome import Outcome, Watcher, finite
from surfuse.errors import ConfigError, DataError, DeviceError, InterruptError, SafetyStopError
from surfuse.exporters import nc
from surfuse.interfaces import FusionMethod
from surfuse.records import FusionResult, FusionScene, Gap, SurfaceMap, Sweep
from surfuse.rig.area import outline_of
from surfuse.rig.assembled import assembled
from surfuse.rig.devices import CLOCK, Rig
from surfuse.runs.configuration import write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_files import segment_paths
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.recorded_log import RECORDED
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import LogSource
from surfuse.settings import Settings

NOT_YET = np.eye(4)
"""Part frame of the scene of a recording without an area: its readings give one when they are fused."""


@dataclass
class Tally:
    """What a recording has so far: sweeps kept and left out, the most that one left out may have been off (m)."""

    began_s: float
    sweeps: int = 0
    left_out: int = 0
    most_off_m: float = 0.0

    def rate_hz(self) -> float:
        """Sweeps a second since it began."""
        return self.sweeps / max(time.monotonic() - self.began_s, 1e-3)


def record_run(
    settings: Settings,
    out: Path | None,
    watcher: Watcher,
    minutes: float | None = None,
    show: Callable[[Tally], None] = lambda tally: None,
) -> Outcome:
    """Record until the watcher wants a stop, or `minutes` have passed; then fuse. `show` is called after each sweep.

    Raises
    ------
    ConfigError : the cell is no real rig.
    SurfuseError : with the exit status of its kind; whatever was recorded before is on disk.
    """
    began = time.perf_counter()
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
        tally = _record(run, rig, settings, watcher, minutes, show)
        return _map(run, method, watcher, tally, began)


def _write_settings(run: RunFolder, settings: Settings) -> None:
    # The source says that there is nothing to resume.
    tree = {**settings.model_dump(exclude={"seed"}), "source": {"log": str(run.log.resolve())}}
    write_configuration(run.configuration, tree, settings.seed)


@contextmanager
def _kept(run: RunFolder) -> Iterator[None]:
    """Say where the readings are when the recording ends with an error."""
    cure = f"what was recorded is on disk, make its map with 'surfuse fuse {run.path}'"
    try:
        yield
    except KeyboardInterrupt as error:
        raise InterruptError("interrupted", cure=cure) from error
    except (SafetyStopError, DeviceError) as error:
        if not segment_paths(run.log):
            raise
        raise type(error)(error.what, cure=f"{error.cure}; {cure}".removeprefix("; "), where=error.where) from error


def _record(
    run: RunFolder,
    rig: Rig,
    settings: Settings,
    watcher: Watcher,
    minutes: float | None,
    show: Callable[[Tally], None],
) -> Tally:
    """All sweeps, in the log; what the recording has."""
    with rig.guided(), rig.opened(), LogWriter(run.log) as log:
        shown = with_corners(settings, rig, watcher)
        if shown is not settings:
            settings = shown
            _write_settings(run, settings)
        log.append_scene(_scene(rig, settings))
        log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, RECORDED, "somebody else moves the arm"))
        if stamps := rig.stamps():
            log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, CLOCK, stamps))
        tally = Tally(time.monotonic())
        watcher.stage("record")
        try:
            record(rig.stop_arm, rig.array, _lags(settings), _hooks(log, tally, watcher, minutes, show))
        except (SafetyStopError, DeviceError) as error:
            log.append_event(LogEvent(rig.clock.now_s(), Level.ERROR, "device", error.what))
            raise
        if (text := _left_out(tally)) is not None:
            log.append_event(LogEvent(rig.clock.now_s(), Level.WARN, "readings", text))
            watcher.warn(text)
    return tally


def _hooks(
    log: LogWriter, tally: Tally, watcher: Watcher, minutes: float | None, show: Callable[[Tally], None]
) -> RecordingHooks:
    def keep(sweep: Sweep) -> None:
        log.append_sweep(sweep)
        tally.sweeps += 1
        watcher.advance()
        show(tally)

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


def _map(run: RunFolder, method: FusionMethod, watcher: Watcher, tally: Tally, began: float) -> Outcome:
    """Fuse what is on disk, as 'surfuse fuse' would."""
    if tally.sweeps == 0:
        raise DataError(
            f"no sweep was recorded ({tally.left_out} left out)",
            where=str(run.path),
            cure="record longer; the place of a reading is known once the arm has told its state after it",
        )
    watcher.stage("fuse")
    scan = opened(LogSource(run.path), watcher)
    grid = grid_of(scan)
    result, surface = fused(scan, method, grid)
    require_cells(surface, str(run.path))
    nc.write(run.surface, surface, points=result.points)
    data = _summary(scan, result, surface, tally)
    run.write_text(run.summary, json.dumps(finite(data), indent=2) + "\n")
    watcher.stage("report")
    write_report(run, run.report)
    wall_s = time.perf_counter() - began
    rows = [
        ("readings", f"{data['readings']} in {data['stops']} sweeps, {tally.left_out} left out"),
        ("cells", f"{data['cells']} with a value, median sigma {data['median_sigma_mm']:.2f} mm"),
        ("wall time", f"{wall_s:.1f} s"),
        ("map", str(run.surface)),
        ("report", str(run.report)),
    ]
    files = {"run": str(run.path), "map": str(run.surface), "report": str(run.report)}
    return Outcome({**files, **data, "wall_time_s": wall_s}, rows)


def _summary(scan: ScanLog, result: FusionResult, surface: SurfaceMap, tally: Tally) -> dict[str, object]:
    duration_s = float(np.ptp(scan.readings.t_s))
    return {
        "surfuse": __version__,
        "method": surface.method,
        "readings": len(scan.readings.t_s),
        "stops": scan.readings.n_sweeps,
        "left_out": tally.left_out,
        "rate_hz": tally.sweeps / max(duration_s, 1e-3),
        "robot_time_s": duration_s,
        "gaps": int((result.points.gap != int(Gap.NONE)).sum()),
        "cells": int(surface.mask.sum()),
        "median_sigma_mm": 1e3 * float(np.median(surface.sigma_m[surface.mask])),
        "frame_estimated": scan.frame_estimated,
        "warnings": list(scan.warnings),
    }
