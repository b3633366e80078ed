"""Why a cell of a map has its value: the readings behind it, what they weighed, and which rule refused the others."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from surfuse.commands.explain.cell_evidence import Evidence, evidence_at
from surfuse.commands.explain.cell_refused import refused_height_mm
from surfuse.commands.explain.evidence_records import (
    ReadingEvidence,
    StopEvidence,
    reading_evidence,
    recomputed_mm,
    stop_evidence,
)
from surfuse.commands.explain.map_source import MapSource, source_of
from surfuse.commands.outcome import Outcome
from surfuse.records import Regime

SHOWN = 12
"""Readings in the table of a method that uses all of them; the JSON has every one."""


def why(path: Path, u_mm: float, v_mm: float, log: Path | None = None) -> Outcome:
    """The readings behind the cell at (u, v) mm of the part frame.

    Raises
    ------
    UsageError : (u, v) is not on the map.
    DataError : the map or its readings cannot be used.
    """
    source = source_of(path, log)
    found = evidence_at(source, 1e-3 * u_mm, 1e-3 * v_mm)
    readings = [reading_evidence(source, found, k) for k in range(len(found.rows))]
    refused = Counter(reading.verdict for reading in readings if not reading.used)
    used = sum(reading.used for reading in readings)
    summary = _cell(source, found) | {"map": str(path), "log": str(source.log)}
    summary |= {"readings_used": used, "refused": dict(refused)}
    rows = _cell_rows(source, found)
    if found.by_stops:
        stops = [stop_evidence(source, found, int(sweep), readings) for sweep in found.stops]
        again = recomputed_mm(source, stops)
        summary |= {"recomputed_mm": again, "stops": [asdict(stop) for stop in stops]}
        if stops:
            rows.append(("made of", f"{len(stops)} stop(s); the readings below give {again:.3f} mm again"))
        rows += [row for stop in stops for row in _stop_rows(stop)]
    else:
        summary["readings"] = [asdict(reading) for reading in readings]
        rows.append(("made of", f"all readings at once; {len(readings)} beams cover the cell, the nearest to it first"))
        again = refused_height_mm(source, found)
        summary["recomputed_mm"] = again
        alone = f"fused alone they give {again:.3f} mm" if math.isfinite(again) else "fused alone they give it no value"
        rows.append(("again", alone))
        rows += [_beam_row(reading) for reading in readings[:SHOWN]]
    rows += [(f"{count} reading(s)", verdict) for verdict, count in refused.most_common()]
    return Outcome(summary, rows)


def _cell(source: MapSource, found: Evidence) -> dict[str, object]:
    surface, at = source.surface, (found.row, found.column)
    return {
        "method": surface.method,
        "u_mm": 1e3 * float(surface.grid.u_m[found.column]),
        "v_mm": 1e3 * float(surface.grid.v_m[found.row]),
        "has_value": bool(surface.mask[at]),
        "height_mm": 1e3 * float(surface.height_m[at]),
        "sigma_mm": 1e3 * float(surface.sigma_m[at]),
        "confidence": float(surface.confidence[at]),
        "count": int(surface.count[at]),
        "regime": Regime(int(surface.regime[at])).name.lower(),
        "rule": "stops" if found.by_stops else "all readings",
    }


def _cell_rows(source: MapSource, found: Evidence) -> list[tuple[str, str]]:
    surface, at = source.surface, (found.row, found.column)
    # Adding 0 turns -0.0 into 0.0, which is what a person expects to read.
    u_mm, v_mm = (round(1e3 * float(node), 1) + 0.0 for node in (surface.grid.u_m[at[1]], surface.grid.v_m[at[0]]))
    rows = [("cell", f"u {u_mm:.1f} mm, v {v_mm:.1f} mm, by method '{surface.method}'")]
    if not surface.mask[at]:
        return [*rows, ("value", "none: no reading gave this cell a value, or it lies outside of the part")]
    height, sigma = 1e3 * surface.height_m[at], 1e3 * surface.sigma_m[at]
    regime = Regime(int(surface.regime[at])).name.lower()
    text = f"{height:.3f} mm, sigma {sigma:.3f} mm, confidence {surface.confidence[at]:.2f}"
    return [*rows, ("value", f"{text}, {surface.count[at]} readings, {regime}")]


def _stop_rows(stop: StopEvidence) -> list[tuple[str, str]]:
    afresh = ", prediction started afresh" if stop.reset else ""
    text = f"M {stop.depth_mm:.3f} mm, sigma {stop.sigma_mm:.3f} mm, share {100 * stop.share:.0f} %"
    return [(f"stop {stop.stop}", f"{text}, {stop.rule}{afresh}"), *(_stop_row(reading) for reading in stop.readings)]


def _stop_row(reading: ReadingEvidence) -> tuple[str, str]:
    label, text = f"  {reading.sensor}", f"{1e3 * reading.range_m:.2f} mm"
    if not reading.used:
        return label, f"{text}, {reading.verdict}"
    factors = f"{reading.dc1:.3f} x {reading.dc2:.3f} x {reading.dc3:.3f}"
    return label, f"{text}, {reading.on_grip_axis_mm:.2f} on the grip axis, dc {reading.dc:.3f} = {factors}"


def _beam_row(reading: ReadingEvidence) -> tuple[str, str]:
    beyond = reading.beyond_cell_mm
    place = f"{beyond:+.2f} mm beyond the cell" if abs(beyond) < float("inf") else "no range"
    text = f"{1e3 * reading.range_m:.2f} mm, cell {reading.off_axis_deg:.1f} deg off axis, {place}"
    return f"stop {reading.stop}, {reading.sensor}", f"{text}, {reading.verdict}"
