"""Scores as users see them: in millimetres, against meshes, maps and runs."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from surfuse.commands.judge.evaluation import evaluate, has_step, map_score, mesh_dense_score, score_data, score_rows
from surfuse.commands.judge.truth_files import read_truth
from surfuse.errors import DataError, StorageError
from surfuse.exporters import nc
from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.records import MapGrid, Score, SurfaceMap
from surfuse.surface.dense_score import dense_truth_of_mesh
from surfuse.surface.grids import refined
from surfuse.surface.truth import truth_around

WORLD_FROM_PART = pose(rotation_about([0, 0, 1], 0.6), [0.4, -0.2, 1.0])
GRID = MapGrid(np.linspace(-0.1, 0.1, 21), np.linspace(0.0, 0.2, 21), WORLD_FROM_PART)


def surface(height_m: np.ndarray, grid: MapGrid = GRID) -> SurfaceMap:
    full = np.ones(grid.shape)
    return SurfaceMap(grid, np.broadcast_to(height_m, grid.shape), 0.001 * full, full, full, full, full, "test")


def sheet(height_m: float, scale: float = 1.0) -> trimesh.Trimesh:
    """A square at a height over the part's plane, in the world."""
    corners = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
    vertices = transform_points(WORLD_FROM_PART, np.column_stack([corners, np.full(4, height_m)]))
    return trimesh.Trimesh(scale * vertices, [[0, 1, 2], [0, 2, 3]], process=False)


def stairs(at_v_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower half 9 cm higher than the upper one, with the riser at a place along v; vertices in the world."""
    profile = [(0.0, 0.09), (at_v_m, 0.09), (at_v_m, 0.0), (0.2, 0.0)]
    part = np.array([(u, v, w) for v, w in profile for u in (-0.1, 0.1)])
    faces = [face for k in (0, 2, 4) for face in ((k, k + 1, k + 3), (k, k + 3, k + 2))]
    return transform_points(WORLD_FROM_PART, part), np.array(faces)


def test_numbers_are_in_millimetres_and_shares():
    found = Score(rmse_m=0.001, mae_m=0.0008, bias_m=-0.0002, p95_m=0.002, coverage=0.5, cells=7)
    assert score_data(found) == pytest.approx(
        {"rmse_mm": 1.0, "mae_mm": 0.8, "bias_mm": -0.2, "p95_mm": 2.0, "coverage": 0.5, "cells": 7}
    )
    rows = dict(score_rows(found))
    assert rows["RMSE"] == "1.00 mm"
    assert rows["bias"] == "-0.20 mm"
    assert rows["coverage"] == "50.0 % of the true part"


def test_a_map_that_is_too_high_everywhere_has_that_bias(tmp_path):
    nc.write(tmp_path / "map.nc", surface(np.full(GRID.shape, 0.013)))
    sheet(0.010).export(tmp_path / "truth.stl")
    data = evaluate(tmp_path / "map.nc", tmp_path / "truth.stl", 1.0).summary
    for key in ("rmse_mm", "mae_mm", "bias_mm", "p95_mm"):
        assert data[key] == pytest.approx(3.0, abs=1e-3)
    assert (data["coverage"], data["cells"]) == (1.0, 441)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".glb", ".off", ".PLY"])
def test_every_kind_of_mesh_is_truth(tmp_path, suffix):
    sheet(0.010).export(tmp_path / f"truth{suffix}", file_type=suffix[1:].lower())
    assert read_truth(tmp_path / f"truth{suffix}", GRID).height_m == pytest.approx(0.010, abs=1e-6)


def test_a_mesh_in_millimetres_is_scaled_and_without_it_refused(tmp_path):
    sheet(0.010, scale=1000.0).export(tmp_path / "mm.stl")
    assert read_truth(tmp_path / "mm.stl", GRID, 0.001).height_m == pytest.approx(0.010, abs=1e-5)
    with pytest.raises(DataError, match="--scale"):
        read_truth(tmp_path / "mm.stl", GRID)


def test_truth_in_another_place_shares_no_cell(tmp_path):
    nc.write(tmp_path / "map.nc", surface(np.zeros(GRID.shape)))
    far = sheet(0.0)
    far.apply_translation([1.0, 0.0, 0.0]).export(tmp_path / "far.stl")
    with pytest.raises(DataError, match="no cell in common"):
        evaluate(tmp_path / "map.nc", tmp_path / "far.stl", 1.0)


def test_a_missing_file_is_a_storage_error(tmp_path):
    with pytest.raises(StorageError, match="no such file"):
        read_truth(tmp_path / "none.nc", GRID)


@pytest.mark.parametrize("shift_m", [-0.02, 0.0, 0.015])
def test_the_edge_of_a_step_is_where_the_map_has_it(shift_m):
    vertices, faces = stairs(0.105)
    true_at = 0.105 + shift_m
    height = np.where(GRID.v_m < true_at, 0.09, 0.0)[:, None]
    assert mesh_dense_score(surface(height), vertices, faces).edge_m == pytest.approx(shift_m, abs=0.006)


def test_without_a_step_there_is_no_edge(tmp_path):
    mesh = sheet(0.01)
    found = mesh_dense_score(surface(np.full(GRID.shape, 0.01)), np.array(mesh.vertices), np.array(mesh.faces))
    assert np.isnan(found.edge_m)
    assert found.rmse_m == pytest.approx(0.0, abs=1e-9)
    assert not has_step(surface(0.05 * GRID.v_m[:, None]))
    assert has_step(surface(np.where(GRID.v_m < 0.1, 0.03, 0.0)[:, None]))


def test_a_map_on_a_finer_raster_is_compared_with_the_truth_at_its_own_nodes():
    vertices, faces = stairs(0.1021)
    finer = refined(GRID, 2)
    right = truth_around(vertices, faces, finer)
    found = map_score(right, truth_around(vertices, faces, GRID), dense_truth_of_mesh(vertices, faces, finer))
    assert (found.rmse_mm, found.within_3mm, found.coverage) == (pytest.approx(0.0, abs=1e-6), 1.0, 1.0)
    # Its nodes are right; between them the step of 9 cm is drawn as a slope.
    assert found.dense_rmse_mm > 3.0
    assert found.off_edge_rmse_mm < 0.3 * found.dense_rmse_mm
    assert 0.9 < found.within_3_mm < 1.0
