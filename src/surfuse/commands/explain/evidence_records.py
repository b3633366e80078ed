"""The evidence of a cell as plain records: what is printed of a reading and of a stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.commands.explain.cell_evidence import Evidence
from surfuse.commands.explain.map_source import MapSource
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, Gap, Gate, Status

GATE_TEXT = {
    Gate.PASSED: "used",
    Gate.NO_ECHO: "refused: no echo",
    Gate.TOO_CLOSE: "refused: too close",
    Gate.FAULT: "refused: faulty reading",
    Gate.OUT_OF_RANGE: "refused: outside of the range that the sensor can give",
    Gate.OUTSIDE_PART: "refused: the beam ends outside of the part",
    Gate.BEHIND_CELL: "refused: behind the cell",
}
NO_CONFIDENCE = "refused: degree of confidence 0"


@dataclass(frozen=True)
class ReadingEvidence:
    """One reading behind a cell: who, when, where, what it said, what became of it.

    `on_grip_axis_mm` is the range along the grip axis of the sweep, `hit_mm` where its own axis ends in the part
    frame, `footprint_mm` the radius of the beam there; `off_axis_deg` the angle under which the sensor sees the cell
    and `beyond_cell_mm` how much longer the range is than the distance to the cell.
    """

    sweep: int
    stop: int
    sensor: str
    t_s: float
    position_m: list[float]
    axis: list[float]
    range_m: float
    status: str
    amplitude: float
    sigma_m: float
    on_grip_axis_mm: float
    hit_mm: list[float]
    footprint_mm: float
    off_axis_deg: float
    beyond_cell_mm: float
    gate: str
    verdict: str
    used: bool
    dc: float
    dc1: float
    dc2: float
    dc3: float


@dataclass(frozen=True)
class StopEvidence:
    """One stop of a cell: its fused value, its share in the cell, the rule that gives the value from its readings."""

    sweep: int
    stop: int
    row: int
    depth_mm: float
    sigma_mm: float
    share: float
    reset: bool
    gap: str
    rule: str
    recomputed_depth_mm: float
    grip_m: list[list[float]]
    readings: list[ReadingEvidence]


def reading_evidence(source: MapSource, found: Evidence, k: int) -> ReadingEvidence:
    """Reading k of the evidence."""
    readings, points, i = source.readings, source.points, int(found.rows[k])
    gate, dc = Gate(int(points.gate[i])), float(points.dc[i])
    used = gate == Gate.PASSED and (dc > 0.0 or not found.by_stops)
    sweep = int(np.searchsorted(readings.start, i, side="right")) - 1
    spec, own_sigma = readings.specs[int(readings.sensor[i])], float(readings.sigma_m[i])
    return ReadingEvidence(
        sweep=sweep,
        stop=int(readings.stop[sweep]),
        sensor=spec.name,
        t_s=float(readings.t_s[i]),
        position_m=readings.position_m[i].tolist(),
        axis=readings.axis[i].tolist(),
        range_m=float(readings.range_m[i]),
        status=Status(int(readings.status[i])).name.lower(),
        amplitude=float(readings.amplitude[i]),
        sigma_m=own_sigma if np.isfinite(own_sigma) else spec.sigma_m,
        on_grip_axis_mm=1e3 * float(found.value_m[k]),
        hit_mm=(1e3 * found.hit_m[k]).tolist(),
        footprint_mm=1e3 * float(found.footprint_m[k]),
        off_axis_deg=float(np.degrees(found.off_axis_rad[k])),
        beyond_cell_mm=1e3 * float(readings.range_m[i] - found.distance_m[k]),
        gate=gate.name.lower(),
        verdict=NO_CONFIDENCE if gate == Gate.PASSED and not used else GATE_TEXT[gate],
        used=used,
        dc=dc,
        dc1=float(points.dc1[i]),
        dc2=float(points.dc2[i]),
        dc3=float(points.dc3[i]),
    )


def stop_evidence(source: MapSource, found: Evidence, sweep: int, readings: list[ReadingEvidence]) -> StopEvidence:
    """One stop of the cell with its own readings."""
    points = source.points
    own = [reading for reading in readings if reading.sweep == sweep]
    weights = 1.0 / points.sigma_m[found.stops] ** 2
    rule, again = _rule(own, 1e3 * float(points.depth_m[sweep]))
    return StopEvidence(
        sweep=sweep,
        stop=int(points.stop[sweep]),
        row=int(points.row[sweep]),
        depth_mm=1e3 * float(points.depth_m[sweep]),
        sigma_mm=1e3 * float(points.sigma_m[sweep]),
        share=float(1.0 / points.sigma_m[sweep] ** 2 / weights.sum()),
        reset=bool(points.reset[sweep]),
        gap=Gap(int(points.gap[sweep])).name.lower(),
        rule=rule,
        recomputed_depth_mm=again,
        grip_m=source.readings.world_from_grip[sweep].tolist(),
        readings=own,
    )


def _rule(readings: list[ReadingEvidence], depth_mm: float) -> tuple[str, float]:
    """How the value of a stop follows from its readings, and that value again in mm.

    An average weighted by dc (the paper's equation 1) or their median, whichever gives it; a method that carries a
    state along the line gives neither, and its weights then say only what each reading counted.
    """
    value = np.array([reading.on_grip_axis_mm for reading in readings if reading.used])
    dc = np.array([reading.dc for reading in readings if reading.used])
    if len(value):
        average, middle = float(np.sum(dc * value) / np.sum(dc)), float(np.median(value))
        for name, found in (("average weighted by dc", average), ("median", middle)):
            if abs(found - depth_mm) <= 1e-6:
                return name, found
    return "these readings and earlier stops", depth_mm


def recomputed_mm(source: MapSource, stops: list[StopEvidence]) -> float:
    """The cell's height from what is printed: the stops' values in the part frame, averaged by inverse variance."""
    if not stops:
        return float("nan")
    grip: FloatArray = np.array([stop.grip_m for stop in stops])
    depth = 1e-3 * np.array([stop.recomputed_depth_mm for stop in stops])
    points = grip[:, :3, 3] + depth[:, None] * grip[:, :3, 2]
    heights = transform_points(inverse(source.surface.grid.world_from_part), points)[:, 2]
    return 1e3 * float(np.average(heights, weights=np.array([stop.sigma_mm for stop in stops]) ** -2.0))
