"""The paper's three experiments, acquired in the twin, with every fusion method on the same readings."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from surfuse import __version__, durable, registry
from surfuse.commands.acquire.acquisition import acquire, default_folder
from surfuse.commands.acquire.constants_shown import constants_data, constants_rows, constants_table
from surfuse.commands.acquire.paper_constants import (
    PAPER,
    ConstantsStudy,
    TrialScan,
    study_constants,
    with_constants,
)
from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.judge.evaluation import dense_data, map_score, score_data
from surfuse.commands.outcome import Outcome, Watcher, finite
from surfuse.errors import InterruptError, SurfuseError
from surfuse.records import Score, SurfaceMap
from surfuse.report.comparison import render_comparison
from surfuse.report.content import Axis, ComparisonContent, KeyFigure, NamedMap, SceneComparison, ScoreRow
from surfuse.runs.configuration import configuration_text
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_source import load_scan
from surfuse.settings import Settings
from surfuse.surface.dense_score import dense_truth_of_mesh
from surfuse.surface.splines import spline_surface
from surfuse.surface.truth import read_truth_mesh, truth_around

SPLINE, BEST = f"{PAPER}+spline", f"{PAPER}+best"
"""The paper's map drawn by splines; its method at the best common setting of its constants."""

_DRAWN = (PAPER, BEST, SPLINE, "mean", "median", "own_axis_median", "kalman_plane", "carving", "beam")


@dataclass(frozen=True)
class Experiment:
    """One experiment: the scene, its title, what the paper reports of it, and where to cut the profile."""

    scene: str
    title: str
    expected: str
    cut_along: Axis


EXPERIMENTS = (
    Experiment(
        "flat",
        "Flat plate, 0 degrees",
        "The shape of the plate and its description are well retrieved (paper, figure 8).",
        "u",
    ),
    Experiment(
        "tilted",
        "Flat plate, 20 degrees",
        "Still retrieved; not unexpected, as the largest angle of incidence is 25 degrees (paper, figure 9).",
        "u",
    ),
    Experiment(
        "relief",
        "Relief of 9 cm",
        "The fusion opposes steep slopes and the splines round the surface further (paper, figure 10).",
        "v",
    ),
)


@dataclass(frozen=True)
class Compared:
    """A scene with the maps and scores of all methods, and the methods that failed with their reasons."""

    experiment: Experiment
    maps: dict[str, SurfaceMap]
    truth: SurfaceMap
    rows: dict[str, ScoreRow]
    failures: dict[str, str]
    robot_s: float
    trial: TrialScan

    def scored(self, name: str, surface: SurfaceMap) -> ScoreRow:
        """A map of these readings against the truth."""
        found = map_score(surface, self.truth, self.trial.dense)
        return ScoreRow(name, found.nodes, found.dense)


def reproduce(settings: Settings, out: Path | None, watcher: Watcher) -> Outcome:
    """Acquire the three scenes into one folder, compare all methods, write one report.

    Raises
    ------
    SurfuseError : with the exit status of its kind; finished scenes stay on disk.
    """
    began = time.perf_counter()
    run = RunFolder.create(out or default_folder("reproduce"))
    run.log.rmdir()
    if settings.scene.name not in ("", *(one.scene for one in EXPERIMENTS)):
        watcher.warn(f"scene.name = '{settings.scene.name}' has no effect here: the paper's scenes are scanned")
    compared = []
    for experiment in EXPERIMENTS:
        _go_on(watcher, run)
        scene = settings.model_copy(update={"scene": settings.scene.model_copy(update={"name": experiment.scene})})
        outcome = acquire(scene, run.path / experiment.scene, watcher)
        if not outcome.complete:
            return outcome
        watcher.stage(f"compare {experiment.scene}", len(registry.found("fusion").built_in))
        compared.append(_compare(experiment, run.path / experiment.scene, settings, watcher))
    watcher.stage("constants", len(EXPERIMENTS))
    study = study_constants([one.trial for one in compared], settings.fusion, lambda: _go_on(watcher, run))
    compared = [_with_best(one, study, settings) for one in compared]
    wall_s = time.perf_counter() - began
    data: dict[str, object] = {one.experiment.scene: _data(one) for one in compared}
    data["constants"] = constants_data(study, [one.scene for one in EXPERIMENTS])
    run.write_text(run.summary, json.dumps(finite(data), indent=2) + "\n")
    durable.write_text(run.report, render_comparison(_content(compared, study, settings, wall_s)), overwrite=True)
    rows = [("scene and method", "RMSE mm  dense mm  p95 mm  edge mm  coverage")]
    for one in compared:
        rows += [(f"{one.experiment.scene} {name}", _line(row)) for name, row in one.rows.items()]
    rows += constants_rows(study, [one.scene for one in EXPERIMENTS])
    rows += [("wall time", f"{wall_s:.1f} s"), ("report", str(run.report))]
    constants = data.pop("constants")
    summary = {"run": str(run.path), "report": str(run.report), "scenes": data, "constants": constants}
    return Outcome({**summary, "wall_time_s": wall_s}, rows)


def _go_on(watcher: Watcher, run: RunFolder) -> None:
    """Stop here when the user asked for it."""
    if watcher.stop_requested():
        raise InterruptError("stopped; the scenes that were scanned are on disk", where=str(run.path))


def _compare(experiment: Experiment, path: Path, settings: Settings, watcher: Watcher) -> Compared:
    """All methods on the readings of one run."""
    scan, run = load_scan(path), RunFolder(path)
    vertices, triangles = read_truth_mesh(run.truth)
    grid = grid_of(scan)
    truth = truth_around(vertices, triangles, grid)
    maps: dict[str, SurfaceMap] = {}
    failures: dict[str, str] = {}
    for name in sorted(registry.found("fusion").built_in, key=lambda one: (one != PAPER, one)):
        _go_on(watcher, run)
        try:
            _, maps[name] = fused(scan, create_method(settings.fusion, name), grid)
        except SurfuseError as error:
            failures[name] = str(error)
            continue
        if name == PAPER:
            maps[SPLINE] = spline_surface(maps[name])
        watcher.advance()
    dense = dense_truth_of_mesh(vertices, triangles, grid)
    trial = TrialScan(experiment.scene, scan, grid, dense)
    one = Compared(experiment, maps, truth, {}, failures, float(scan.readings.t_s.max()), trial)
    return replace(one, rows={name: one.scored(name, surface) for name, surface in maps.items()})


def _with_best(one: Compared, study: ConstantsStudy, settings: Settings) -> Compared:
    """The paper's method at its best common setting beside the others."""
    method = create_method(with_constants(settings.fusion, study.best.constants), PAPER)
    _, surface = fused(one.trial.scan, method, one.trial.grid)
    rows = {PAPER: one.rows[PAPER], BEST: one.scored(BEST, surface), **one.rows}
    return replace(one, maps={**one.maps, BEST: surface}, rows=rows)


def _content(compared: list[Compared], study: ConstantsStudy, settings: Settings, wall_s: float) -> ComparisonContent:
    robot_s = sum(one.robot_s for one in compared)
    return ComparisonContent(
        title="Surface profile based on sensor fusion: the three experiments",
        scenes=tuple(_scene(one) for one in compared),
        introduction=(
            "The three scenes of the 1998 paper, acquired by the simulated cell and fused by every method from "
            "the same readings. The paper gives pictures, no errors; here every map is scored against the true surface."
        ),
        made=f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        version=__version__,
        figures=(
            KeyFigure("robot time", f"{robot_s:.0f} s", "what arm and sensors need for the three scans"),
            KeyFigure("wall time", f"{wall_s:.0f} s", "what this computer needed for all of it"),
            KeyFigure("methods", str(len(compared[0].rows)), "maps from the same readings"),
        ),
        tables=(constants_table(study, [one.experiment.title for one in compared]),),
        configuration_toml=configuration_text(settings.model_dump(exclude={"seed"}), settings.seed),
    )


def _scene(one: Compared) -> SceneComparison:
    drawn = [name for name in _DRAWN if name in one.maps]
    middle = 0.0 if one.experiment.cut_along == "v" else float(one.truth.grid.v_m.mean())
    return SceneComparison(
        name=one.experiment.title,
        maps=tuple(NamedMap(name, one.maps[name]) for name in drawn),
        truth=NamedMap("truth", one.truth),
        scores=tuple(one.rows.values()),
        cut_along=one.experiment.cut_along,
        cut_at_m=middle,
        expected=one.experiment.expected,
        found=_found(one),
    )


def _found(one: Compared) -> str:
    """What is seen here, in numbers."""
    paper, best = one.rows[PAPER], min(one.rows.values(), key=lambda row: row.score.rmse_m)
    text = (
        f"The paper's method is off by {1e3 * paper.score.rmse_m:.1f} mm (RMSE), 95 % of the cells by less than "
        f"{1e3 * paper.score.p95_m:.1f} mm."
    )
    spline = one.rows.get(SPLINE)
    if not math.isnan(paper.edge_m):
        text += (
            f" The step is there but rounded: its edge lies {1e3 * paper.edge_m:+.0f} mm off, in front of the true one "
            "where positive, because the wide beam hears the nearer surface first."
        )
        if spline is not None:
            text += f" The spline surface rounds it further: {1e3 * spline.score.rmse_m:.1f} mm."
    common = one.rows[BEST]
    text += f" At the best common setting of its constants it is off by {1e3 * common.score.rmse_m:.1f} mm."
    if best.method != PAPER:
        text += f" From the same readings '{best.method}' gets to {1e3 * best.score.rmse_m:.1f} mm."
    return text + "".join(f" '{name}' gave no map: {reason}." for name, reason in one.failures.items())


def _data(one: Compared) -> dict[str, object]:
    methods: dict[str, object] = {
        name: {**score_data(row.score), "edge_mm": 1e3 * row.edge_m, **dense_data(row.dense)}
        for name, row in one.rows.items()
    }
    return {"methods": methods, "failures": one.failures, "robot_time_s": one.robot_s}


def _line(row: ScoreRow) -> str:
    found: Score = row.score
    edge = "-" if math.isnan(row.edge_m) else f"{1e3 * row.edge_m:+.1f}"
    dense = f"{1e3 * row.dense.rmse_m:>9.2f}"
    return f"{1e3 * found.rmse_m:>7.2f} {dense} {1e3 * found.p95_m:>7.2f} {edge:>8} {100 * found.coverage:>8.1f}%"
