"""Fusing recorded readings again."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from surfuse import __version__
from surfuse.commands.acquire.acquisition import default_folder
from surfuse.commands.fuse.map_of_log import fused, grid_of, opened, require_cells
from surfuse.commands.fuse.methods import create_method, fusion_settings
from surfuse.commands.maps.report import write_report
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.exporters import nc
from surfuse.interfaces import FusionMethod
from surfuse.records import FusionResult, Gap, Regime, SurfaceMap, in_words
from surfuse.runs.configuration import write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import LogSource


def fuse(
    log: Path,
    out: Path | None,
    watcher: Watcher,
    *,
    overrides: Sequence[str] = (),
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
) -> Outcome:
    """Fuse a log into a new run folder: map, report, configuration, summary.

    Raises
    ------
    SurfuseError : with the exit status of its kind; nothing is written then, but perhaps an empty folder.
    """
    began = time.perf_counter()
    settings = fusion_settings(overrides, "fuse")
    method = create_method(settings.fusion)
    source = LogSource(log, sensors, frame, outline)
    watcher.stage("read")
    scan = opened(source, watcher)
    watcher.stage("fuse")
    grid = grid_of(scan)
    result, surface = fused(scan, method, grid)
    require_cells(surface, str(log))
    run = RunFolder.create(out or default_folder(f"{log.resolve().stem}-fused"))
    with run.lock():
        # A fused run has no log of its own: it names the one that it was made from.
        run.log.rmdir()
        tree = settings.model_dump(include={"fusion"})
        write_configuration(run.configuration, {**tree, "source": source.table()}, settings.seed)
        nc.write(run.surface, surface, points=result.points)
        summary = _summary(scan, method, result, surface, log)
        run.write_text(run.summary, json.dumps(summary, indent=2) + "\n")
        watcher.stage("report")
        write_report(run, run.report, scan=scan)
    wall_s = time.perf_counter() - began
    rows = [
        ("readings", f"{summary['readings']} in {summary['stops']} sweeps"),
        ("cells", f"{summary['cells']} with a value, median sigma {summary['median_sigma_mm']:.2f} mm"),
        ("gaps", f"{summary['gaps']} sweeps without a value"),
        *_unmeasured(surface),
        *([("guard", in_words(surface.decisions))] if surface.decisions else []),
        ("wall time", f"{wall_s:.1f} s"),
        ("map", str(run.surface)),
        ("report", str(run.report)),
    ]
    files = {"run": str(run.path), "map": str(run.surface), "report": str(run.report)}
    return Outcome({**files, **summary, "wall_time_s": wall_s}, rows)


def _unmeasured(surface: SurfaceMap) -> list[tuple[str, str]]:
    """What a user must not take for measured, when there is any: cells that no reading holds."""
    prior = int(np.count_nonzero(surface.mask & (surface.regime == int(Regime.PRIOR))))
    text = f"{prior} of these cells only continue their surroundings: no reading holds them"
    return [("not measured", text)] if prior else []


def _summary(
    scan: ScanLog, method: FusionMethod, result: FusionResult, surface: SurfaceMap, log: Path
) -> dict[str, object]:
    return {
        "surfuse": __version__,
        "log": str(log),
        "method": method.name,
        "readings": len(scan.readings.t_s),
        "stops": scan.readings.n_sweeps,
        "gaps": int((result.points.gap != int(Gap.NONE)).sum()),
        "cells": int(surface.mask.sum()),
        "cells_not_measured": int(np.count_nonzero(surface.mask & (surface.regime == int(Regime.PRIOR)))),
        "median_sigma_mm": 1e3 * float(np.median(surface.sigma_m[surface.mask])),
        **({"guard": in_words(surface.decisions)} if surface.decisions else {}),
        "frame_estimated": scan.frame_estimated,
        "warnings": list(scan.warnings),
    }
