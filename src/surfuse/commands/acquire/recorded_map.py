"""The map of what was recorded, with its summary and report."""

from __future__ import annotations

import json
import time

import numpy as np

from surfuse import __version__
from surfuse.commands.acquire.clock_told import clock_data, clock_rows
from surfuse.commands.acquire.recording_shown import Tally
from surfuse.commands.fuse.map_of_log import fused, grid_of, opened, require_cells
from surfuse.commands.maps.report import write_report
from surfuse.commands.outcome import Outcome, Watcher, finite
from surfuse.commands.show.observer import ScanObserver
from surfuse.errors import DataError
from surfuse.exporters import nc
from surfuse.interfaces import FusionMethod
from surfuse.records import FusionResult, Gap, SurfaceMap
from surfuse.rig.devices import Stamps
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import LogSource


def map_of_recording(
    run: RunFolder, method: FusionMethod, lookers: tuple[Watcher, ScanObserver], tally: Tally, stamps: Stamps | None
) -> Outcome:
    """Fuse what is on disk, as 'surfuse fuse' would.

    Raises
    ------
    DataError : nothing was kept, or nothing has a value.
    """
    watcher, observer = lookers
    if tally.sweeps == 0:
        raise DataError(
            f"no sweep was recorded ({tally.left_out} left out)",
            where=str(run.path),
            cure="record longer; the place of a reading is known once the arm has told its state after it",
        )
    began = time.perf_counter()
    watcher.stage("fuse")
    scan = opened(LogSource(run.path), watcher)
    grid = grid_of(scan)
    result, surface = fused(scan, method, grid)
    require_cells(surface, str(run.path))
    nc.write(run.surface, surface, points=result.points)
    observer.finished(surface)
    data = {**_summary(scan, result, surface, tally), **clock_data(stamps)}
    run.write_text(run.summary, json.dumps(finite(data), indent=2) + "\n")
    watcher.stage("report")
    write_report(run, run.report)
    rows = [
        ("readings", f"{data['readings']} in {data['stops']} sweeps, {tally.left_out} left out"),
        ("cells", f"{data['cells']} with a value, median sigma {data['median_sigma_mm']:.2f} mm"),
        *clock_rows(stamps),
        ("fused and reported in", f"{time.perf_counter() - began:.1f} s"),
        ("map", str(run.surface)),
        ("report", str(run.report)),
    ]
    files = {"run": str(run.path), "map": str(run.surface), "report": str(run.report)}
    return Outcome({**files, **data}, rows)


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
