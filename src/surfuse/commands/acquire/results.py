"""From the fused readings to what a user gets: map, truth and score of the twin, summary, report."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from surfuse import __version__
from surfuse.commands.acquire.clock_told import clock_data, clock_rows
from surfuse.commands.acquire.job import Job
from surfuse.commands.acquire.settings_check import doubts
from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.commands.judge.evaluation import dense_data, dense_rows, mesh_dense_score, score_data, score_rows
from surfuse.commands.maps.report import write_report
from surfuse.commands.outcome import Outcome, finite
from surfuse.errors import DataError
from surfuse.exporters import nc
from surfuse.plan.margin import margin_in_words
from surfuse.records import FusionScene, Gap, IntArray, Outline, ScanPlan, SensorSpec, SurfaceMap, Sweep
from surfuse.rig.devices import Rig, Truth
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.odd_sensors import HeardOfSensors
from surfuse.runs.scan_log import faulty_sensors, few_echoes, look_at
from surfuse.settings import Settings
from surfuse.surface.gridding import lattice
from surfuse.surface.score import score
from surfuse.surface.truth import truth_around
from surfuse.surface.truth_pieces import pieces_of_part

_HARMLESS = ("frames", "foreign", "triggers", "readings")


@dataclass(frozen=True)
class Finished:
    """What is known at the end: plain data, table lines, and whether the scan is complete."""

    data: dict[str, object]
    rows: list[tuple[str, str]]
    complete: bool


def bus_event(rig: Rig) -> LogEvent | None:
    """What went wrong on the bus, for the log; None when nothing did, or there is no bus."""
    counts = {} if rig.counters is None else asdict(rig.counters())
    trouble = {name: count for name, count in counts.items() if count and name not in _HARMLESS}
    if not trouble:
        return None
    text = ", ".join(f"{name} {count}" for name, count in trouble.items())
    return LogEvent(rig.clock.now_s(), Level.WARN, "bus", text)


@dataclass(frozen=True)
class Scanned:
    """What a walk leaves: the state of the fusion, what it knew, the plan, the sweeps in the order of their stops.

    `complete` says that no stop that could be reached is left.
    """

    state: object
    scene: FusionScene
    plan: ScanPlan
    sweeps: list[Sweep]
    complete: bool


def finish(run: RunFolder, job: Job, scanned: Scanned) -> Finished:
    """Map, score, summary and report of a finished scan; of an unfinished one only what is needed to say so.

    Raises
    ------
    DataError : the scan is finished and everything is written, but not one cell of the map has a value.
    """
    data = _counted(job, scanned)
    plan, sweeps = scanned.plan, scanned.sweeps
    if not scanned.complete:
        return Finished(data, [("stops done", f"{len(sweeps)} of {len(plan)}")], complete=False)
    job.watcher.stage("map")
    grid = lattice(plan.uv_m, scanned.scene.world_from_part)
    result = job.method.finish(scanned.state, grid)
    surface = surface_of(result, grid, job.method.name, scanned.scene.outline)
    nc.write(run.surface, surface, overwrite=True, points=result.points)
    job.observer.finished(surface)
    doubted = doubts(job.settings, job.rig.specs, plan)
    data["warnings"] = [*job.rig.warnings, *doubted, *doubts_of_readings(job.rig.specs, sweeps)]
    gaps = int((result.points.gap != int(Gap.NONE)).sum())
    rows = []
    if job.rig.truth is not None:
        rows = _score(run, surface, _of_scanned_part(job.rig.truth, scanned.scene.outline), data)
    data["gaps"] = gaps
    rows += [
        ("stops", f"{len(sweeps)} scanned, {len(plan.skipped) + len(plan) - len(sweeps)} left out"),
        *_margin_row(job.settings, scanned.scene, plan),
        ("gaps", f"{gaps} stops without a value"),
        ("robot time", f"{data['robot_time_s']:.0f} s"),
        *clock_rows(job.rig.stamps()),
    ]
    _write(run, job, data)
    if not surface.mask.any():
        broken = faulty(job.rig.specs, sweeps)
        raise DataError(
            f"the scan is complete, but none of its {len(sweeps)} stops gave a value",
            where=str(run.path),
            cure=look_at(broken)
            if broken
            else "the report says why; check scan.standoff_m, the kit's settings and how the part stands",
        )
    return Finished(data, rows, complete=True)


def _counted(job: Job, scanned: Scanned) -> dict[str, object]:
    """What is known of a scan before its map."""
    settings, rig, plan, outline = job.settings, job.rig, scanned.plan, scanned.scene.outline
    return {
        "surfuse": __version__,
        "scene": settings.scene.name if rig.simulated else None,
        "method": job.method.name,
        "seed": settings.seed,
        "complete": scanned.complete,
        "stops": len(scanned.sweeps),
        "stops_planned": len(plan),
        "stops_skipped": len(plan.skipped),
        "margin_mm": 1e3 * plan.outline.margin_m,
        "outline_sigma_mm": None if outline is None else 1e3 * float(outline.sigma_m.max()),
        "robot_time_s": rig.clock.now_s() if rig.simulated else _duration_s(scanned.sweeps),
        "bus": None if rig.counters is None else asdict(rig.counters()),
        **clock_data(rig.stamps()),
    }


def _duration_s(sweeps: Sequence[Sweep]) -> float:
    """From the first to the last reading of a real rig; breaks between parts of the scan count."""
    times = np.concatenate([sweep.t_s for sweep in sweeps]) if sweeps else np.zeros(0)
    times = times[np.isfinite(times)]
    return float(np.ptp(times)) if len(times) else 0.0


def _write(run: RunFolder, job: Job, data: dict[str, object]) -> None:
    """Summary and report."""
    run.write_text(run.summary, json.dumps(finite(data), indent=2) + "\n")
    job.watcher.stage("report")
    write_report(run, run.report, overwrite=True)


def doubts_of_readings(specs: Sequence[SensorSpec], sweeps: Sequence[Sweep]) -> tuple[str, ...]:
    """A sentence for everything that is odd about the readings of a scan: few echoes, dead and stuck sensors."""
    heard = HeardOfSensors(specs)
    for sweep in sweeps:
        heard.take(sweep)
    few = few_echoes(_column(sweeps, "status"), faulty(specs, sweeps)) if sweeps else None
    return (*([] if few is None else [few]), *heard.sentences())


def faulty(specs: Sequence[SensorSpec], sweeps: Sequence[Sweep]) -> tuple[str, ...]:
    """Names of the sensors that reported nothing but faults."""
    return faulty_sensors(_column(sweeps, "status"), _column(sweeps, "sensor"), [spec.name for spec in specs])


def _column(sweeps: Sequence[Sweep], name: str) -> IntArray:
    """One column (N,) of all readings."""
    return np.concatenate([getattr(sweep, name) for sweep in sweeps]) if sweeps else np.zeros(0, dtype=np.int64)


def _margin_row(settings: Settings, scene: FusionScene, plan: ScanPlan) -> list[tuple[str, str]]:
    if scene.outline is None or settings.area is not None:
        return []
    if settings.search.plane is not None:
        given = "as configured" if settings.scan.margin_m is not None else "asked for by the outline's uncertainty"
        return [("margin", f"{1e3 * plan.outline.margin_m:.1f} mm, {given}")]
    return [("margin", margin_in_words(scene.outline, plan.outline.margin_m, settings.scan.margin_m is not None))]


def _of_scanned_part(truth: Truth, outline: Outline | None) -> Truth:
    """The truth without other parts on the table, which were not scanned."""
    return truth if outline is None else Truth(*pieces_of_part(truth.vertices_m, truth.triangles, outline))


def _score(run: RunFolder, surface: SurfaceMap, truth: Truth, data: dict[str, object]) -> list[tuple[str, str]]:
    """Compare with the twin's truth, which is stored beside the map for later comparisons."""
    import trimesh

    mesh = trimesh.Trimesh(truth.vertices_m, truth.triangles, process=False)
    stored = mesh.export(file_type="ply")
    run.write_bytes(run.truth, stored if isinstance(stored, bytes) else str(stored).encode())
    found = score(surface, truth_around(truth.vertices_m, truth.triangles, surface.grid))
    dense = mesh_dense_score(surface, truth.vertices_m, truth.triangles)
    data.update({**score_data(found), **dense_data(dense)})
    return [*score_rows(found), *dense_rows(dense)]


def outcome_of(finished: Finished, run: RunFolder, began: float) -> Outcome:
    """Add where it is and how long it took."""
    wall_s = time.perf_counter() - began
    summary = {"run": str(run.path), **finished.data, "wall_time_s": wall_s}
    rows = [*finished.rows, ("wall time", f"{wall_s:.1f} s")]
    if not finished.complete:
        return Outcome(summary, [*rows, ("go on with", f"surfuse resume {run.path}")], complete=False)
    return Outcome({**summary, "report": str(run.report)}, [*rows, ("report", str(run.report))])
