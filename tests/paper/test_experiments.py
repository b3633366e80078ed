"""The paper's three experiments (section 4, figures 8 to 10) with the paper's method on the twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.judge.evaluation import mesh_dense_score
from surfuse.exporters import nc
from surfuse.records import Gap, SurfaceMap
from surfuse.surface.score import score
from surfuse.surface.splines import spline_surface
from surfuse.surface.truth import read_truth_mesh, truth_around

STEP_M = 0.09


def scored(run: Path, surface: SurfaceMap | None = None):
    surface = surface or nc.read(run / "surface.nc")
    return score(surface, truth_around(*read_truth_mesh(run / "truth.ply"), surface.grid))


def test_plate_at_0_degrees_is_well_retrieved(experiment):
    found = scored(experiment("flat"))
    assert found.rmse_m < 0.003
    assert found.p95_m < 0.005
    assert found.coverage > 0.95


def test_plate_at_20_degrees_is_still_retrieved(experiment):
    run = experiment("tilted")
    found, surface = scored(run), nc.read(run / "surface.nc")
    assert found.rmse_m < 0.010
    assert found.coverage > 0.9
    columns = np.flatnonzero(surface.mask.any(axis=0))
    height = np.nanmean(np.where(surface.mask, surface.height_m, np.nan)[:, columns], axis=0)
    slope = np.polyfit(surface.grid.u_m[columns], height, 1)[0]
    assert abs(np.degrees(np.arctan(slope))) == pytest.approx(20.0, abs=3.0)


def test_relief_is_there_but_rounded(experiment):
    run = experiment("relief")
    surface = nc.read(run / "surface.nc")
    rows = surface.mask.any(axis=1)
    v = surface.grid.v_m[rows]
    profile = np.nanmedian(surface.height_m[rows], axis=1)
    front, back = profile[(v > 0.02) & (v < 0.07)].mean(), profile[(v > 0.17) & (v < 0.20)].mean()
    assert front - back == pytest.approx(STEP_M, abs=0.01)
    # The beam hears the nearer surface first, so the block seems higher than it is.
    assert mesh_dense_score(surface, *read_truth_mesh(run / "truth.ply")).edge_m > 0.003
    between = surface.height_m[(surface.height_m < front - 0.01) & (surface.height_m > back + 0.01)]
    assert len(between) > 10


def test_splines_round_the_relief_further(experiment):
    run = experiment("relief")
    surface = nc.read(run / "surface.nc")
    drawn = spline_surface(surface)

    def steepest(one: SurfaceMap) -> float:
        return float(np.nanmax(np.abs(np.diff(np.where(one.mask, one.height_m, np.nan), axis=0))))

    assert steepest(drawn) < steepest(surface)
    assert scored(run, drawn).rmse_m > scored(run, surface).rmse_m


def test_prediction_starts_afresh_at_the_step_and_the_boundary_lowers_confidence(experiment):
    run = experiment("relief")
    points = nc.read_points(run / "surface.nc")
    assert points is not None
    v = points.point_m[points.reset, 1]
    assert len(v) > 0
    assert np.mean((v > 0.06) & (v < 0.18)) > 0.5
    fused = points.gap == int(Gap.NONE)
    dc3 = np.array(
        [np.nanmean(points.dc3[a:b]) if b > a else np.nan for a, b in zip(points.start, points.start[1:], strict=False)]
    )
    inside = fused & (np.abs(points.point_m[:, 0]) < 0.05)
    rim = fused & (np.abs(points.point_m[:, 0]) > 0.105)
    assert np.nanmean(dc3[inside]) > np.nanmean(dc3[rim]) + 0.1
