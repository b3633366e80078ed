"""The time lag between ranges and poses of a log with moving sensors."""

from __future__ import annotations

import math
from pathlib import Path

from surfuse.commands.judge.truth_files import truth_mesh
from surfuse.commands.outcome import Outcome, Watcher
from surfuse.errors import DataError
from surfuse.runs.scan_source import load_scan
from surfuse.runs.tof_vicon import is_tof_vicon, read_tof_vicon
from surfuse.surface.incidence import BAND_DEG, IncidenceError, PlaneError, errors_by_incidence, fitted_plane
from surfuse.surface.time_lag import estimate_lag


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
    recording = read_tof_vicon(log) if truth is None and is_tof_vicon(log) else None
    mesh = truth_mesh(truth) if truth is not None else recording.target_mesh() if recording is not None else None
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
    if mesh is not None:
        before, timed = (errors_by_incidence(scan.readings, mesh, lag_s) for lag_s in (0.0, found.lag_s))
        after = errors_by_incidence(scan.readings, mesh, found.lag_s, beams=True)
        stages = {"before": before, "lag_and_offset": timed, "after": after}
        summary["by_incidence"] = {name: [_band(one) for one in bands] for name, bands in stages.items()}
        rows.append(("incidence", "median error, scatter (mm): raw -> lag and offset -> mean over the beam, echoes"))
        rows += [_band_row(low, stages) for low in sorted({one.low_deg for one in after})]
    if recording is not None and mesh is not None:
        planes = [fitted_plane(scan.readings, mesh, lag_s) for lag_s in (0.0, found.lag_s)]
        summary["target_plane"] = dict(zip(("before", "after"), map(_plane, planes), strict=True))
        rows += [(f"target {name}", _plane_text(one)) for name, one in zip(("before", "after"), planes, strict=True)]
    return Outcome(summary, rows)


def _plane(one: PlaneError | None) -> dict[str, object] | None:
    if one is None:
        return None
    return {"angle_deg": math.degrees(one.angle_rad), "distance_mm": 1e3 * one.distance_m, "echoes": one.echoes}


def _plane_text(one: PlaneError | None) -> str:
    if one is None:
        return "too few echoes to fit its plane"
    angle, distance = math.degrees(one.angle_rad), 1e3 * one.distance_m
    return f"fitted plane {angle:.2f} deg and {distance:+.1f} mm off the motion-capture plane, {one.echoes} echoes"


def _band(one: IncidenceError) -> dict[str, object]:
    return {
        "from_deg": one.low_deg,
        "to_deg": one.high_deg,
        "echoes": one.echoes,
        "median_mm": 1e3 * one.median_m,
        "scatter_mm": 1e3 * one.scatter_m,
    }


def _band_row(low_deg: float, stages: dict[str, tuple[IncidenceError, ...]]) -> tuple[str, str]:
    shown = [next((one for one in bands if one.low_deg == low_deg), None) for bands in stages.values()]
    texts = [f"{1e3 * one.median_m:+.1f}, {1e3 * one.scatter_m:.1f}" if one is not None else "-" for one in shown]
    last = shown[-1]
    echoes = f"  ({last.echoes})" if last is not None else ""
    high_deg = low_deg + BAND_DEG
    return f"  {low_deg:.0f} to {high_deg:.0f} deg", " -> ".join(texts) + echoes
