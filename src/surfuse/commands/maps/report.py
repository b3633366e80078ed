"""The report of a run, made from what is on disk alone."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from surfuse import __version__, durable
from surfuse.commands.acquire.search_view import found_parts
from surfuse.commands.fuse.map_of_result import surface_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.judge.evaluation import mesh_dense_score
from surfuse.commands.maps.map_files import NATIVE, map_path, read_map
from surfuse.commands.outcome import Outcome
from surfuse.errors import DataError, SurfuseError
from surfuse.exporters import nc
from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.plan.margin import margin_in_words
from surfuse.records import FloatArray, FusionScene, MapGrid, Readings, Score, SurfaceMap
from surfuse.report.content import (
    KeyFigure,
    NamedMap,
    PlanView,
    ReportContent,
    ReportEvent,
    Scenery,
    ScoreRow,
    plan_view,
)
from surfuse.report.page import render_report
from surfuse.rig.arm_model import ArmModel
from surfuse.rig.configured_arm import arm_model
from surfuse.rig.described_sensors import places
from surfuse.rig.description import array_fixture
from surfuse.rig.real.joint_arm import described_model
from surfuse.runs.configuration import read_configuration
from surfuse.runs.folder import RunFolder
from surfuse.runs.log_files import segment_paths
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_records import Level, RunLog
from surfuse.runs.recorded_log import is_recorded
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import own_scan, source_of_table
from surfuse.settings import FusionSettings, Settings, from_tree
from surfuse.surface.resample import resampled, thinned
from surfuse.surface.score import score
from surfuse.surface.splines import spline_surface
from surfuse.surface.truth import read_truth_mesh, truth_around

if TYPE_CHECKING:
    from surfuse.arm_models.model_file import ModelFileArm

_LEVELS: dict[int, Literal["info", "warning", "error"]] = {
    Level.INFO: "info",
    Level.WARN: "warning",
    Level.ERROR: "error",
}


PAPER = "weighted_average"


def report(path: Path, file: Path | None, overwrite: bool, against: str | None = None) -> Outcome:
    """Write the report of a run folder (again), beside another method on the same readings.

    `against` defaults to the paper's method, or to `beam` for a run of the paper's.
    """
    run = RunFolder(path)
    if not path.is_dir():
        what, cure = "there is no such folder", "give a run folder"
        if path.exists():
            what, cure = "it is a file", "give a run folder; 'surfuse view' shows a map by itself"
        raise DataError(what, cure=cure, where=str(path))
    if not run.surface.is_file():
        begun = run.configuration.is_file()
        cure = "finish the run with 'surfuse resume'" if begun else "give a run folder"
        raise DataError(f"the folder holds no {NATIVE}", cure=cure, where=str(path))
    target = file or run.report
    method = nc.read(run.surface).method
    content = content_of(run, None, against or ("beam" if method == PAPER else PAPER))
    if against is not None and content.rival is None:
        raise _no_rival(against, method, content, str(path))
    durable.write_text(target, render_report(content), overwrite=overwrite)
    return Outcome({"report": str(target)}, [("report", str(target))])


def _no_rival(against: str, method: str, content: ReportContent, where: str) -> DataError:
    """Why the method that was asked for cannot be shown beside the run's own."""
    create_method(FusionSettings(), against)
    if against == method:
        return DataError(f"--against {against}: that is the method of the map", cure="name another one", where=where)
    if content.readings is None:
        return DataError(
            f"--against {against}: the readings of the map are not there", cure="leave the option out", where=where
        )
    return DataError(f"--against {against}: it gives no map of these readings", cure="name another one", where=where)


def write_report(
    run: RunFolder, target: Path, overwrite: bool = False, scan: ScanLog | None = None, against: str = PAPER
) -> None:
    """Render the page of a run and write it at once or not at all."""
    durable.write_text(target, render_report(content_of(run, scan, against)), overwrite=overwrite)


def view(path: Path, port: int) -> None:
    """Serve the 3-D view of a run on this machine until Ctrl-C."""
    from surfuse.report.viewer import serve

    folder = RunFolder(path)
    content = content_of(folder) if path.is_dir() else _map_alone(map_path(path))
    serve(content, port, lambda address: print(f"{address}  (Ctrl-C ends)", flush=True))


def _map_alone(path: Path) -> ReportContent:
    return ReportContent(title=path.name, maps=(NamedMap("surface", read_map(path)),))


def content_of(run: RunFolder, scan: ScanLog | None = None, against: str = PAPER) -> ReportContent:
    """Everything of a run folder that the page can show, with the map of the method `against` beside its own.

    A fused run has no log of its own: `scan` is the one that it was made from (default: read again from where it was,
    if it is still there).
    """
    surface, points = nc.read(run.surface), nc.read_points(run.surface)
    settings = _settings(run)
    log = read_log(run.path) if run.log.is_dir() and segment_paths(run.log) else None
    if log is None and scan is None:
        scan = _source(run)
    elif log is not None and is_recorded(log):
        # Somebody else moved the arm: lines and part frame are found as for a log of another rig.
        scan = own_scan(run.path)
    readings = scan.readings if scan is not None else log.readings() if log is not None and log.sweeps else None
    data = json.loads(run.summary.read_text("utf-8")) if run.summary.is_file() else {}
    spline = spline_surface(surface)
    scene = scan.scene() if scan is not None else log.scene if log is not None else None
    rival = _rival(against, surface, scene, readings, settings)
    truth = _truth(run, surface)
    twin = settings is not None and not settings.arm.is_real and log is not None
    name = settings.scene.name if settings is not None and twin else run.path.resolve().name
    return ReportContent(
        title=f"Surface of '{Path(name).name}'",
        scene=Path(name).name if twin else "",
        method=surface.method,
        made=f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        version=__version__,
        figures=_figures(data, surface),
        parts=found_parts(log, settings) if log is not None and settings is not None else (),
        plan=_plan(log, settings),
        maps=(NamedMap(surface.method, surface), NamedMap("spline", spline)),
        rival=NamedMap(rival.method, rival) if rival is not None else None,
        truth=NamedMap("truth", truth) if truth is not None else None,
        points=points if points is not None and readings is not None and len(points) == readings.n_sweeps else None,
        readings=readings,
        arm_m=_skeleton(log, readings, settings),
        scenery=_scenery(settings) if twin else (),
        scores=_scores(run, [surface, spline, *([rival] if rival is not None else [])]),
        events=_events(log) if log is not None else _notes(scan),
        configuration_toml=run.configuration.read_text("utf-8") if run.configuration.is_file() else "",
    )


def _source(run: RunFolder) -> ScanLog | None:
    """The log that a fused run was made from, if it is still there and can be read."""
    if not run.configuration.is_file():
        return None
    source = source_of_table(read_configuration(run.configuration)[0].get("source"))
    if source is None or not source.log.exists():
        return None
    try:
        return source.load()
    except SurfuseError:
        # The report of the map does not depend on the log, which may have been changed since.
        return None


def _notes(scan: ScanLog | None) -> tuple[ReportEvent, ...]:
    return tuple(ReportEvent(warning, "warning") for warning in scan.warnings) if scan is not None else ()


def _settings(run: RunFolder) -> Settings | None:
    if not run.configuration.is_file():
        return None
    tables, seed = read_configuration(run.configuration)
    return from_tree({**{key: value for key, value in tables.items() if key != "source"}, "seed": seed})


def _figures(data: dict[str, object], surface: SurfaceMap) -> tuple[KeyFigure, ...]:
    """The headline: what the summary holds, in words."""
    rows = [
        ("rmse_mm", "RMSE", "{:.2f} mm", "root mean square error against the true part"),
        ("dense_rmse_mm", "dense RMSE", "{:.2f} mm", "the same with the true part sampled every millimetre"),
        ("p95_mm", "95th percentile", "{:.2f} mm", "95 % of the cells are nearer to the truth than this"),
        ("edge_mm", "edge of the step", "{:+.1f} mm", "how far the higher side reaches out too far"),
        ("coverage", "coverage", "{:.1%}", "share of the true part's cells that have a value"),
        ("stops", "stops", "{:d}", "places where the array fired"),
        ("gaps", "gaps", "{:d}", "stops without a fused value"),
        ("robot_time_s", "robot time", "{:.0f} s", "what the arm and the sensors need"),
    ]
    found = [
        KeyFigure(label, form.format(data[key]), hint) for key, label, form, hint in rows if data.get(key) is not None
    ]
    prior = int((surface.mask & ~surface.measured).sum())
    if prior:
        found.append(KeyFigure("prior only", f"{prior} cells", "have a value but no reading holds them; hatched below"))
    sigma = surface.sigma_m[surface.mask]
    if len(sigma):
        found.append(KeyFigure("median sigma", f"{1e3 * float(np.median(sigma)):.2f} mm", "stated standard deviation"))
    return tuple(found)


def _plan(log: RunLog | None, settings: Settings | None) -> PlanView | None:
    """The plan over the outline as the camera saw it, and why its margin is as large as it is."""
    if log is None or log.plan is None or log.scene is None or log.scene.outline is None:
        return None
    given = settings is not None and settings.scan.margin_m is not None
    text = margin_in_words(log.scene.outline, log.plan.outline.margin_m, given)
    return plan_view(log.plan, log.scene.outline.vertices_m, text)


def _truth(run: RunFolder, surface: SurfaceMap) -> SurfaceMap | None:
    return truth_around(*read_truth_mesh(run.truth), surface.grid) if run.truth.is_file() else None


def _rival(
    against: str, surface: SurfaceMap, scene: FusionScene | None, readings: Readings | None, settings: Settings | None
) -> SurfaceMap | None:
    """The map of another method from the same readings on the same grid; None when it is the same, or cannot fuse."""
    if against == surface.method or scene is None or readings is None:
        return None
    method = create_method(settings.fusion if settings is not None else FusionSettings(), against)
    try:
        result = method.replay(scene, readings, surface.grid)
    except DataError:
        # What one method can fuse another may not; the report is about the first.
        return None
    found = surface_of(result, surface.grid, method.name, scene.outline)
    if not found.mask.any():
        return None
    return found if result.surface is not None else _between_its_points(found)


def _between_its_points(found: SurfaceMap) -> SurfaceMap:
    """The map of a method that works stop by stop, interpolated where the grid is finer than its stops."""
    grid, (row, column) = found.grid, np.nonzero(found.mask)
    apart = [int(np.gcd.reduce(np.diff(np.unique(index)))) if np.ptp(index) else 1 for index in (row, column)]
    if max(apart) <= 1:
        return found
    own = MapGrid(grid.u_m[column.min() :: apart[1]], grid.v_m[row.min() :: apart[0]], grid.world_from_part)
    return resampled(thinned(found, own), grid)


def _scores(run: RunFolder, maps: list[SurfaceMap]) -> tuple[ScoreRow, ...]:
    if not run.truth.is_file():
        return ()
    vertices, triangles = read_truth_mesh(run.truth)

    def found(candidate: SurfaceMap) -> Score:
        return score(candidate, truth_around(vertices, triangles, candidate.grid))

    return tuple(ScoreRow(one.method, found(one), mesh_dense_score(one, vertices, triangles)) for one in maps)


def _skeleton(log: RunLog | None, readings: Readings | None, settings: Settings | None) -> FloatArray:
    """Positions of the arm's joints at each sweep, for the replay."""
    nothing = np.zeros((0, 0, 3))
    if log is None or readings is None or settings is None:
        return nothing
    try:
        arm = _known_arm(settings)
    except SurfuseError:
        # The arm's file may be gone by now; the report does without the arm then.
        return nothing
    joints = [sweep.joints_rad for sweep in log.sweeps]
    if arm is None or not joints or any(len(row) != len(arm.limits) for row in joints):
        return nothing
    return arm.link_poses(np.array(joints))[..., :3, 3]


def _known_arm(settings: Settings) -> ArmModel | ModelFileArm | None:
    """The model of the arm where it stands; None for a real one of which only poses are known."""
    if settings.arm.is_real:
        file = settings.arm.file
        return None if file is None else described_model(settings, tool_from_grip(*places(settings.sensor)))
    return arm_model(settings, array_fixture(settings))


def _scenery(settings: Settings | None) -> tuple[Scenery, ...]:
    """The ring table as a flat ring."""
    if settings is None:
        return ()
    table, n = settings.cell, 96
    angle = 2.0 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [
        np.column_stack([radius * circle, np.full(n, table.table_height_m)])
        for radius in (table.table_inner_radius_m, table.table_outer_radius_m)
    ]
    here, there = np.arange(n), (np.arange(n) + 1) % n
    faces = np.vstack([np.column_stack([here, here + n, there + n]), np.column_stack([here, there + n, there])])
    return (Scenery("table", np.vstack(rings), faces),)


def _events(log: RunLog | None) -> tuple[ReportEvent, ...]:
    if log is None:
        return ()
    told = [ReportEvent(f"{event.source}: {event.text}", _LEVELS[event.level], event.t_s) for event in log.events]
    damaged = [ReportEvent(f"log: {damage.segment}: {damage.text}", "warning") for damage in log.damage]
    return (*told, *damaged)
