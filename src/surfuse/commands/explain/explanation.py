"""Why a cell of a map has its value, as a record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from surfuse.commands.explain.cell_evidence import Evidence, evidence_at
from surfuse.commands.explain.cell_refused import refused_height_mm
from surfuse.commands.explain.evidence_records import (
    ReadingEvidence,
    StopEvidence,
    reading_evidence,
    recomputed_mm,
    stop_evidence,
)
from surfuse.commands.explain.map_source import MapSource
from surfuse.records import Regime

BY_STOPS, BY_READINGS = "stops", "all readings"


@dataclass(frozen=True)
class CellExplanation:
    """A cell of a map, its value, and the evidence behind it; lengths in millimetres, nan where there is none.

    `u_mm`, `v_mm` is the node of the cell in the part frame. `rule` says how the value came about: "stops", an average
    of the `stops` whose points lie in the cell, each with its readings; or "all readings", by a method that made its
    map at once, and then `stops` is empty. `readings` are those behind the cell, `readings_used` how many of them
    count, `refused` why the others do not, with their numbers. `recomputed_mm` is the height that follows from what
    stands here.
    """

    method: str
    u_mm: float
    v_mm: float
    has_value: bool
    height_mm: float
    sigma_mm: float
    confidence: float
    count: int
    regime: str
    rule: str
    readings_used: int
    refused: Mapping[str, int]
    recomputed_mm: float
    stops: tuple[StopEvidence, ...]
    readings: tuple[ReadingEvidence, ...]


def explanation_at(source: MapSource, u_m: float, v_m: float) -> CellExplanation:
    """The evidence behind the cell whose node is nearest to (u, v), in m of the part frame.

    Raises
    ------
    UsageError : (u, v) is not on the map; the message gives its extent.
    """
    found = evidence_at(source, u_m, v_m)
    readings = [reading_evidence(source, found, k) for k in range(len(found.rows))]
    stops = [stop_evidence(source, found, int(sweep), readings) for sweep in found.stops] if found.by_stops else []
    again = recomputed_mm(source, stops) if found.by_stops else refused_height_mm(source, found)
    return _explanation(source, found, tuple(stops), tuple(readings), again)


def _explanation(
    source: MapSource,
    found: Evidence,
    stops: tuple[StopEvidence, ...],
    readings: tuple[ReadingEvidence, ...],
    again_mm: float,
) -> CellExplanation:
    surface, at = source.surface, (found.row, found.column)
    refused = Counter(reading.verdict for reading in readings if not reading.used)
    return CellExplanation(
        method=surface.method,
        u_mm=1e3 * float(surface.grid.u_m[found.column]),
        v_mm=1e3 * float(surface.grid.v_m[found.row]),
        has_value=bool(surface.mask[at]),
        height_mm=1e3 * float(surface.height_m[at]),
        sigma_mm=1e3 * float(surface.sigma_m[at]),
        confidence=float(surface.confidence[at]),
        count=int(surface.count[at]),
        regime=Regime(int(surface.regime[at])).name.lower(),
        rule=BY_STOPS if found.by_stops else BY_READINGS,
        readings_used=sum(reading.used for reading in readings),
        refused=dict(refused.most_common()),
        recomputed_mm=again_mm,
        stops=stops,
        readings=readings,
    )
