"""Every fusion method on the same readings: a table, and a page with their maps in the same colours."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from surfuse import __version__, durable, registry
from surfuse.commands.acquire.warm_up import small_scan
from surfuse.commands.fuse.map_of_log import fused, grid_of, opened
from surfuse.commands.fuse.methods import create_method, fusion_settings, usable_methods
from surfuse.commands.judge.evaluation import MapScore, dense_data, has_step, map_score, score_data
from surfuse.commands.judge.truth_files import TruthFrame, dense_truth, nothing_in_common, read_truth
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.errors import SurfuseError
from surfuse.exporters import nc
from surfuse.records import MapGrid, SurfaceMap
from surfuse.report.comparison import render_comparison
from surfuse.report.content import ComparisonContent, NamedMap, ReportEvent, SceneComparison, ScoreRow
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import LogSource
from surfuse.settings import FusionSettings

PAGE = "comparison.html"
_WITH_TRUTH = "RMSE mm  dense mm  off edge mm  p95 mm  bias mm  coverage  in 3 mm  edge mm  seconds"
_WITHOUT = "cells  median sigma mm  seconds"


@dataclass(frozen=True)
class TruthFile:
    """A file of truth, the factor on its numbers, and the frame that they are in."""

    path: Path
    scale: float = 1.0
    frame: TruthFrame = TruthFrame.AUTO


@dataclass(frozen=True)
class Against:
    """Truth on the grid of the maps, and sampled every millimetre."""

    surface: SurfaceMap
    dense: SurfaceMap


@dataclass(frozen=True)
class MethodResult:
    """One method on the readings: its map, or why it has none; its errors where the truth is known."""

    name: str
    seconds: float
    surface: SurfaceMap | None = None
    error: str = ""
    found: MapScore | None = None


def compare(
    log: Path, truth: TruthFile | None, out: Path | None, overrides: Sequence[str], watcher: Watcher
) -> Outcome:
    """Every fusion method on the same readings; against truth when there is one.

    With `out`, the map of each method is written there as METHOD.nc, and all of them together as a page.
    """
    settings = fusion_settings(overrides, "compare", method_counts=False)
    scan = opened(LogSource(log), watcher)
    grid = grid_of(scan)
    against = None
    if truth is not None:
        against = Against(*(read(truth.path, grid, truth.scale, truth.frame) for read in (read_truth, dense_truth)))
    folder = _empty_folder(out) if out is not None else None
    names = usable_methods(watcher.warn)
    watcher.stage("compare", len(names))
    results: list[MethodResult] = []
    for name in names:
        results.append(result_of(scan, settings.fusion, name, grid, against))
        watcher.advance()
    scores = [one.found for one in results if one.found is not None]
    if truth is not None and scores and not any(found.cells for found in scores):
        raise nothing_in_common(truth.path, truth.frame)
    summary: dict[str, object] = {"log": str(log), "methods": {one.name: _entry(one) for one in results}}
    rows = [("method", _WITHOUT if against is None else _WITH_TRUTH), *((one.name, line_of(one)) for one in results)]
    if folder is not None:
        for one in results:
            if one.surface is not None:
                nc.write(folder / f"{one.name}.nc", one.surface)
        page = render_comparison(_content(log, results, against))
        durable.write_text(folder / PAGE, page, overwrite=False)
        summary["page"] = str(folder / PAGE)
        rows.append(("page", str(folder / PAGE)))
    return Outcome(summary, rows)


def result_of(
    scan: ScanLog, settings: FusionSettings, name: str, grid: MapGrid, against: Against | None
) -> MethodResult:
    """One method on the readings of a scan. A method that cannot fuse them says why.

    Its seconds are those of the fusion alone: its kernels are compiled or loaded before, on a small scan.
    """
    with suppress(Exception):  # what fails here fails below, where it is told
        create_method(settings, name).replay(*small_scan())
    began = time.perf_counter()
    try:
        _, surface = fused(scan, create_method(settings, name), grid)
    except SurfuseError as error:
        return MethodResult(name, time.perf_counter() - began, error=str(error))
    except Exception as error:
        # Of a method that another package brings anything may come.
        if name in registry.found("fusion").built_in:
            raise
        return MethodResult(name, time.perf_counter() - began, error=f"{type(error).__name__}: {error}")
    seconds = time.perf_counter() - began
    if against is None:
        return MethodResult(name, seconds, surface)
    return MethodResult(
        name,
        seconds,
        surface,
        found=map_score(surface, against.surface, against.dense),
    )


def _empty_folder(path: Path) -> Path:
    run = RunFolder.create(path)
    run.log.rmdir()
    return path


def _median_sigma_mm(surface: SurfaceMap) -> float:
    sigma = surface.sigma_m[surface.mask]
    return 1e3 * float(np.median(sigma)) if len(sigma) else math.nan


def _entry(one: MethodResult) -> dict[str, object]:
    if one.surface is None:
        return {"error": one.error}
    cells = int(one.surface.mask.sum())
    entry: dict[str, object] = {"cells": cells, "median_sigma_mm": _median_sigma_mm(one.surface)}
    entry["seconds"] = one.seconds
    if one.found is not None:
        entry |= {**score_data(one.found.nodes), "edge_mm": one.found.edge_mm, "within_3mm": one.found.within_3mm}
        entry |= dense_data(one.found.dense)
    return entry


def line_of(one: MethodResult) -> str:
    """A method as a line of the table."""
    if one.surface is None:
        return one.error
    if one.found is None:
        cells, sigma = int(one.surface.mask.sum()), _median_sigma_mm(one.surface)
        return f"{cells:>5}  {sigma:>15.2f}  {one.seconds:>7.2f}"
    found = one.found
    return (
        f"{found.rmse_mm:>7.2f} {found.dense_rmse_mm:>9.2f} {found.off_edge_rmse_mm:>12.2f} {found.p95_mm:>7.2f} "
        f"{found.bias_mm:>8.2f} {100 * found.coverage:>8.1f}% {100 * found.within_3_mm:>7.1f}% {found.edge_mm:>8.1f} "
        f"{one.seconds:>8.2f}"
    )


def _content(log: Path, results: list[MethodResult], against: Against | None) -> ComparisonContent:
    """The page: all maps in the same colours, a cut through all of them, the table of errors."""
    scores = tuple(ScoreRow(one.name, one.found.nodes, one.found.dense) for one in results if one.found is not None)
    stepped = against is not None and has_step(against.surface)
    scene = SceneComparison(
        name=log.resolve().stem,
        maps=tuple(NamedMap(one.name, one.surface) for one in results if one.surface is not None),
        truth=NamedMap("truth", against.surface) if against is not None else None,
        scores=scores,
        cut_along="v" if stepped else "u",
        cut_at_m=_middle(results, stepped),
    )
    return ComparisonContent(
        title=f"Fusion methods on '{log.resolve().stem}'",
        scenes=(scene,),
        introduction="Every method on the same readings, with its defaults. Hatched: only the prior speaks.",
        made=f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        version=__version__,
        events=tuple(ReportEvent(f"{one.name}: {one.error}", "warning") for one in results if one.surface is None),
    )


def _middle(results: list[MethodResult], stepped: bool) -> float:
    for one in results:
        if one.surface is not None:
            nodes = one.surface.grid.u_m if stepped else one.surface.grid.v_m
            return float(0.5 * (nodes[0] + nodes[-1]))
    return 0.0
