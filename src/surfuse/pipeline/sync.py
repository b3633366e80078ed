"""The time lag between ranges and poses of a log with moving sensors."""

from __future__ import annotations

from pathlib import Path

from surfuse.errors import DataError
from surfuse.pipeline.outcome import Outcome, Watcher
from surfuse.runs.scan_source import load_scan
from surfuse.surface.time_lag import estimate_lag
from surfuse.surface.truth import read_mesh


def sync(log: Path, truth: Path | None, max_lag_ms: float, watcher: Watcher) -> Outcome:
    """Lag with its 95 % interval, and the scatter about the surface before and after.

    A range of time t belongs to the pose at t + lag: ranges that come late have a negative lag.

    Raises
    ------
    DataError : the log cannot determine the lag (standing sensors, too little motion); the message says why.
    """
    scan = load_scan(log)
    for warning in scan.warnings:
        watcher.warn(warning)
    mesh = read_mesh(truth) if truth is not None else None
    try:
        found = estimate_lag(scan.readings, scan.world_from_part, 1e-3 * max_lag_ms, mesh)
    except DataError as error:
        raise DataError(error.what, where=str(log), cure=error.cure) from error
    summary: dict[str, object] = {
        "log": str(log),
        "lag_ms": 1e3 * found.lag_s,
        "interval_95_ms": [1e3 * found.low_s, 1e3 * found.high_s],
        "residual_before_mm": 1e3 * found.before_m,
        "residual_after_mm": 1e3 * found.after_m,
        "echoes": found.echoes,
        "surface": found.surface,
    }
    half = 0.5e3 * (found.high_s - found.low_s)
    rows = [
        (
            "lag",
            f"{1e3 * found.lag_s:+.1f} ms +- {half:.1f} ms (95 %): a range of time t belongs to the pose at t + lag",
        ),
        ("scatter", f"{1e3 * found.before_m:.2f} mm before, {1e3 * found.after_m:.2f} mm after"),
        ("against", f"{found.surface}, {found.echoes} echoes"),
    ]
    return Outcome(summary, rows)
