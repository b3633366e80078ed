"""Why a cell of a map has its value: the readings behind it, what they weighed, and which rule refused the others."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

from surfuse.commands.explain.evidence_records import ReadingEvidence, StopEvidence
from surfuse.commands.explain.explanation import BY_STOPS, CellExplanation, explanation_at
from surfuse.commands.explain.map_source import source_of
from surfuse.commands.outcome import Outcome

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
    cell = explanation_at(source, 1e-3 * u_mm, 1e-3 * v_mm)
    # By stops, every reading stands with its stop; otherwise there are no stops.
    evidence = "stops" if cell.rule == BY_STOPS else "readings"
    summary = {key: value for key, value in asdict(cell).items() if key not in ("stops", "readings")}
    summary |= {"map": str(path), "log": str(source.log), evidence: [asdict(one) for one in getattr(cell, evidence)]}
    return Outcome(summary, [*_cell_rows(cell), *_evidence_rows(cell)])


def _cell_rows(cell: CellExplanation) -> list[tuple[str, str]]:
    # Adding 0 turns -0.0 into 0.0, which is what a person expects to read.
    u_mm, v_mm = (round(value, 1) + 0.0 for value in (cell.u_mm, cell.v_mm))
    rows = [("cell", f"u {u_mm:.1f} mm, v {v_mm:.1f} mm, by method '{cell.method}'")]
    if not cell.has_value:
        return [*rows, ("value", "none: no reading gave this cell a value, or it lies outside of the part")]
    text = f"{cell.height_mm:.3f} mm, sigma {cell.sigma_mm:.3f} mm, confidence {cell.confidence:.2f}"
    return [*rows, ("value", f"{text}, {cell.count} readings, {cell.regime}")]


def _evidence_rows(cell: CellExplanation) -> list[tuple[str, str]]:
    rows, again = [], cell.recomputed_mm
    if cell.rule == BY_STOPS:
        if cell.stops:
            rows.append(("made of", f"{len(cell.stops)} stop(s); the readings below give {again:.3f} mm again"))
        rows += [row for stop in cell.stops for row in _stop_rows(stop)]
    else:
        covered = f"all readings at once; {len(cell.readings)} beams cover the cell, the nearest to it first"
        alone = f"fused alone they give {again:.3f} mm" if math.isfinite(again) else "fused alone they give it no value"
        rows += [("made of", covered), ("again", alone)]
        rows += [_beam_row(reading) for reading in cell.readings[:SHOWN]]
    return rows + [(f"{count} reading(s)", verdict) for verdict, count in cell.refused.items()]


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
