"""Fusing recorded readings again, with one method or with all of them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from surfuse import __version__, registry
from surfuse.errors import DataError, SurfuseError
from surfuse.exporters import nc
from surfuse.geometry.poses import inverse, transform_points
from surfuse.interfaces import FusionMethod
from surfuse.pipeline.acquisition import default_folder
from surfuse.pipeline.map_of_result import surface_of
from surfuse.pipeline.methods import create_method
from surfuse.pipeline.outcome import Outcome, Watcher
from surfuse.pipeline.reporting import write_report
from surfuse.pipeline.scoring import edge_of, read_truth, score_data
from surfuse.records import FusionResult, Gap, MapGrid, SurfaceMap, in_words
from surfuse.runs.configuration import write_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_log import ScanLog, require_echoes
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings, load
from surfuse.surface.compare import score
from surfuse.surface.gridding import lattice


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
    settings = load(None, overrides)
    method = create_method(settings.fusion)
    watcher.stage("read")
    scan = _opened(log, watcher, sensors, frame, outline)
    watcher.stage("fuse")
    grid = grid_of(scan)
    result, surface = fused(scan, method, grid)
    if not surface.mask.any():
        raise DataError(
            f"method '{method.name}' found no cell that it could give a value",
            cure="check the part frame, the outline and the sensors' limits, or try another method",
            where=str(log),
        )
    run = RunFolder.create(out or default_folder(f"{log.resolve().stem}-fused"))
    with run.lock():
        # A fused run has no log of its own: it names the one that it was made from.
        run.log.rmdir()
        tree = settings.model_dump(include={"fusion"})
        write_configuration(run.configuration, {**tree, "source": {"log": str(log.resolve())}}, settings.seed)
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
        *([("guard", in_words(surface.decisions))] if surface.decisions else []),
        ("wall time", f"{wall_s:.1f} s"),
        ("map", str(run.surface)),
        ("report", str(run.report)),
    ]
    files = {"run": str(run.path), "map": str(run.surface), "report": str(run.report)}
    return Outcome({**files, **summary, "wall_time_s": wall_s}, rows)


def compare(log: Path, truth: Path | None, out: Path | None, overrides: Sequence[str], watcher: Watcher) -> Outcome:
    """Every fusion method on the same readings; against truth when there is one.

    With `out`, the map of each method is written there as METHOD.nc.
    """
    settings = load(None, overrides)
    scan = _opened(log, watcher)
    grid = grid_of(scan)
    true_map = read_truth(truth, grid) if truth is not None else None
    folder = _empty_folder(out) if out is not None else None
    names = registry.names("fusion")
    watcher.stage("compare", len(names))
    entries: dict[str, object] = {}
    rows = [("method", _columns(true_map is not None))]
    for name in names:
        entry, text, surface = _compared(scan, settings.fusion, name, grid, true_map)
        entries[name] = entry
        rows.append((name, text))
        if folder is not None and surface is not None:
            nc.write(folder / f"{name}.nc", surface)
        watcher.advance()
    return Outcome({"log": str(log), "methods": entries}, rows)


def fused(scan: ScanLog, method: FusionMethod, grid: MapGrid) -> tuple[FusionResult, SurfaceMap]:
    """Points and map of a scan by a method, on a grid."""
    result = method.replay(scan.scene(), scan.readings, grid)
    return result, surface_of(result, grid, method.name, scan.outline)


def grid_of(scan: ScanLog) -> MapGrid:
    """The grid on which the scan's stops lie, in its part frame."""
    if scan.targets_uv_m is not None:
        return lattice(scan.targets_uv_m, scan.world_from_part)
    stops = transform_points(inverse(scan.world_from_part), scan.readings.world_from_grip[:, :3, 3])
    return lattice(stops[:, :2], scan.world_from_part)


def _opened(
    log: Path, watcher: Watcher, sensors: Path | None = None, frame: Path | None = None, outline: Path | None = None
) -> ScanLog:
    scan = load_scan(log, sensors, frame, outline)
    for warning in scan.warnings:
        watcher.warn(warning)
    require_echoes(scan.readings, str(log))
    return scan


def _empty_folder(path: Path) -> Path:
    run = RunFolder.create(path)
    run.log.rmdir()
    return path


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
        "median_sigma_mm": 1e3 * float(np.median(surface.sigma_m[surface.mask])),
        **({"guard": in_words(surface.decisions)} if surface.decisions else {}),
        "frame_estimated": scan.frame_estimated,
        "warnings": list(scan.warnings),
    }


def _columns(with_truth: bool) -> str:
    return "RMSE mm  p95 mm  bias mm  coverage  edge mm  seconds" if with_truth else "cells  median sigma mm  seconds"


def _compared(
    scan: ScanLog, settings: FusionSettings, name: str, grid: MapGrid, truth: SurfaceMap | None
) -> tuple[dict[str, object], str, SurfaceMap | None]:
    """One method: plain data, a table line, its map. A method that cannot fuse these readings says why."""
    began = time.perf_counter()
    try:
        _, surface = fused(scan, create_method(settings, name), grid)
    except SurfuseError as error:
        return {"error": str(error)}, str(error), None
    seconds = time.perf_counter() - began
    sigma = surface.sigma_m[surface.mask]
    median = 1e3 * float(np.median(sigma)) if len(sigma) else math.nan
    entry: dict[str, object] = {"cells": int(surface.mask.sum()), "median_sigma_mm": median, "seconds": seconds}
    if truth is None:
        return entry, f"{entry['cells']:>5}  {median:>15.2f}  {seconds:>7.2f}", surface
    found, edge = score(surface, truth), 1e3 * edge_of(surface, truth)
    entry.update(score_data(found))
    entry["edge_mm"] = edge
    text = (
        f"{1e3 * found.rmse_m:>7.2f} {1e3 * found.p95_m:>7.2f} {1e3 * found.bias_m:>8.2f} "
        f"{100 * found.coverage:>8.1f}% {edge:>8.1f} {seconds:>8.2f}"
    )
    return entry, text, surface
