"""Is sigma honest: the intervals of a map, or of a log fused now, against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from surfuse.commands.fuse.map_of_log import fused, grid_of, opened
from surfuse.commands.fuse.methods import create_method, fusion_settings
from surfuse.commands.judge.truth_files import TruthFrame, nothing_in_common, read_truth
from surfuse.commands.maps.map_files import NATIVE, is_map_file, read_map
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.errors import DataError, UsageError
from surfuse.records import SurfaceMap
from surfuse.runs.scan_source import LogSource
from surfuse.surface.coverage import LEVELS, IntervalCoverage, interval_coverage
from surfuse.surface.score import error_map


def coverage(
    log: Path,
    truth: Path,
    scale: float,
    overrides: Sequence[str],
    watcher: Watcher,
    frame: TruthFrame = TruthFrame.AUTO,
) -> Outcome:
    """How often the truth lies within the 50, 90 and 99 % intervals, over all cells and regime by regime.

    `log` is a map file or a finished run, whose map is taken as it is, or any log, which is fused now; a run is fused
    again too when `overrides` name a method or a parameter.

    Raises
    ------
    SurfuseError : the log, the map or the truth cannot be used, or they have no cell in common.
    """
    surface = _map_of(log, overrides, watcher)
    against = read_truth(truth, surface.grid, scale, frame)
    if not np.any(np.isfinite(error_map(surface, against))):
        raise nothing_in_common(truth, frame)
    if not np.any(np.isfinite(surface.sigma_m)):
        raise DataError("the map has no sigma to check", where=str(log), cure="give a run folder or its surface.nc")
    found = interval_coverage(surface, against)
    summary: dict[str, object] = {
        "log": str(log),
        "truth": str(truth),
        "method": surface.method,
        "levels": list(LEVELS),
        "regimes": {_name(one): _data(one) for one in found},
    }
    heads = "  ".join(f"{100 * level:.0f} %".rjust(6) for level in LEVELS)
    rows = [("method", surface.method), ("cells within", f"{heads}   cells  rms z  RMSE mm  median sigma mm")]
    rows += [(_name(one), _line(one)) for one in found]
    return Outcome(summary, rows)


def _map_of(log: Path, overrides: Sequence[str], watcher: Watcher) -> SurfaceMap:
    if is_map_file(log) and overrides:
        raise UsageError(
            f"--method or --set with the map '{log}', which keeps no readings", cure="leave them out, or give the run"
        )
    if is_map_file(log) or ((log / NATIVE).is_file() and not overrides):
        return read_map(log)
    settings = fusion_settings(overrides, "coverage")
    scan = opened(LogSource(log), watcher)
    return fused(scan, create_method(settings.fusion), grid_of(scan))[1]


def _name(one: IntervalCoverage) -> str:
    return "all" if one.regime is None else one.regime.name.lower()


def _data(one: IntervalCoverage) -> dict[str, object]:
    shares = {f"within_{100 * level:.0f}": share for level, share in zip(LEVELS, one.share, strict=True)}
    return {
        "cells": one.cells,
        **shares,
        "z_rms": one.z_rms,
        "rmse_mm": 1e3 * one.rmse_m,
        "median_sigma_mm": 1e3 * one.median_sigma_m,
    }


def _line(one: IntervalCoverage) -> str:
    shares = "  ".join(f"{100 * share:5.1f}%" for share in one.share)
    return f"{shares}  {one.cells:>6}  {one.z_rms:>5.2f}  {1e3 * one.rmse_m:>7.2f}  {1e3 * one.median_sigma_m:>15.2f}"
