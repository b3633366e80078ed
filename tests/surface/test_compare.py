from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.grids import extended_grid, refined
from surfuse.surface.resample import resampled, triangles
from surfuse.surface.score import error_map, score
from surfuse.surface.truth import truth_around, truth_from_mesh

AXIS = np.arange(-5, 6) * 0.01


def map_of(
    height: Callable[..., FloatArray], u: FloatArray = AXIS, v: FloatArray = AXIS, frame: FloatArray | None = None
) -> SurfaceMap:
    grid = MapGrid(u, v, np.eye(4) if frame is None else frame)
    w = height(*np.meshgrid(u, v)) * np.ones(grid.shape)
    mask = np.isfinite(w)
    return SurfaceMap(
        grid, w, np.where(mask, 1e-3, np.nan), mask * 0.5, mask.astype(np.int64) * 4, mask,
        mask * np.uint8(Regime.MEASURED), "test",
    )  # fmt: skip


def test_score_of_a_known_error() -> None:
    truth = map_of(lambda u, v: u)
    error = np.array([-0.002, 0.0, 0.0, 0.004])
    surface = map_of(lambda u, v: u + np.resize(error, u.shape))
    got = score(surface, truth)
    all_errors = np.resize(error, 121)
    assert got.rmse_m == pytest.approx(np.sqrt(np.mean(all_errors**2)))
    assert got.mae_m == pytest.approx(np.mean(np.abs(all_errors)))
    assert got.bias_m == pytest.approx(np.mean(all_errors))
    assert got.p95_m == pytest.approx(np.percentile(np.abs(all_errors), 95))
    assert (got.coverage, got.cells) == (1.0, 121)


def test_a_score_is_the_statistics_of_the_errors() -> None:
    error = np.random.default_rng(3).gamma(1.0, 0.001, (11, 11)) - 0.0007
    got = score(map_of(lambda u, v: u + error), map_of(lambda u, v: u))
    assert got.rmse_m == pytest.approx(np.sqrt(np.mean(error**2)))
    assert got.mae_m == pytest.approx(np.mean(np.abs(error)))
    assert got.bias_m == pytest.approx(np.mean(error))
    assert got.p95_m == pytest.approx(np.percentile(np.abs(error), 95.0))


def test_coverage_counts_the_whole_true_part_on_the_grid_of_the_map() -> None:
    truth = map_of(lambda u, v: 0 * u)
    half = map_of(lambda u, v: 0 * u, u=AXIS[AXIS < 0.001])
    assert score(half, truth).coverage == pytest.approx(6 / 11)
    holed = map_of(lambda u, v: np.where((u > -0.015) & (u < 0.015), np.nan, 0.0))
    assert score(holed, truth).coverage == pytest.approx(8 / 11)
    # What the map has beside the part is neither error nor coverage.
    wide = map_of(lambda u, v: np.where(np.abs(u) > 0.051, 9.0, 0.0), u=np.arange(-8, 9) * 0.01)
    got = score(wide, truth)
    assert (got.coverage, got.cells, got.rmse_m) == (1.0, 121, 0.0)


def test_truth_on_another_grid_is_resampled() -> None:
    fine = map_of(lambda u, v: 0.3 * u - v, u=np.linspace(-0.07, 0.07, 36), v=np.linspace(-0.05, 0.05, 27))
    got = score(map_of(lambda u, v: 0.3 * u - v + 0.001), fine)
    assert got.bias_m == pytest.approx(0.001)
    assert got.p95_m == pytest.approx(0.001)
    assert got.coverage == pytest.approx(11 / 15)


def test_nothing_in_common_is_no_score_but_no_coverage() -> None:
    got = score(map_of(lambda u, v: u, u=AXIS + 1.0), map_of(lambda u, v: u))
    assert got.coverage == 0.0
    assert got.cells == 0
    assert math.isnan(got.rmse_m)
    with pytest.raises(DataError, match="no cell"):
        score(map_of(lambda u, v: u), map_of(lambda u, v: np.nan * u, u=AXIS + 1e-3))


def test_error_map() -> None:
    error = error_map(map_of(lambda u, v: u + 0.01), map_of(lambda u, v: np.where(v > 0, u, np.nan)))
    np.testing.assert_allclose(error[6:], 0.01)
    assert np.all(np.isnan(error[:6]))


def test_bilinear_resampling_is_exact_for_bilinear_surfaces_and_invents_nothing() -> None:
    surface = map_of(lambda u, v: 2 * u - v + 30 * u * v)
    grid = MapGrid(np.linspace(-0.06, 0.05, 23), np.linspace(-0.05, 0.05, 17), np.eye(4))
    got = resampled(surface, grid)
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    np.testing.assert_array_equal(got.mask, u > -0.0500001)
    np.testing.assert_allclose(got.height_m[got.mask], (2 * u - v + 30 * u * v)[got.mask], atol=1e-15)
    np.testing.assert_allclose(got.sigma_m[got.mask], 1e-3)
    same = resampled(surface, surface.grid)
    np.testing.assert_array_equal(same.height_m, surface.height_m)
    np.testing.assert_array_equal(same.count, surface.count)
    gap = map_of(lambda u, v: np.where((np.abs(u) < 1e-6) & (np.abs(v) < 1e-6), np.nan, u))
    between = resampled(gap, MapGrid(np.array([-0.011, -0.01, -0.009]), np.array([-0.001, 0.0]), np.eye(4)))
    assert between.mask.tolist() == [[True, True, False], [True, True, False]]


def test_maps_in_frames_that_are_parallel() -> None:
    frame = pose(rotation_about([0, 0, 1], 0.5), [0.01, -0.02, 0.3])
    there = map_of(lambda u, v: 0.2 * u, frame=frame, u=np.arange(-15, 16) * 0.01, v=np.arange(-15, 16) * 0.01)
    here = resampled(there, MapGrid(AXIS, AXIS, np.eye(4)))
    u, v = np.meshgrid(AXIS, AXIS)
    in_there = (np.stack([u, v], -1) - frame[:2, 3]) @ frame[:2, :2]
    np.testing.assert_allclose(here.height_m, 0.2 * in_there[..., 0] + 0.3, atol=1e-12)


def test_maps_in_turned_frames_go_by_their_triangles() -> None:
    tilt = 0.3
    frame = pose(rotation_about([0, 1, 0], tilt), [0.0, 0.0, 0.0])
    there = map_of(lambda u, v: 0 * u, frame=frame, u=np.arange(-9, 10) * 0.01)
    here = resampled(there, MapGrid(AXIS, AXIS, np.eye(4)))
    u, _ = np.meshgrid(AXIS, AXIS)
    np.testing.assert_allclose(here.height_m, -math.tan(tilt) * u, atol=1e-9)


def test_triangles_cover_what_has_three_corners() -> None:
    whole = map_of(lambda u, v: u)
    vertices, faces = triangles(whole)
    assert len(faces) == 200
    normals = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))
    assert np.all(normals[:, 2] > 0.0)
    for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):
        w = np.zeros((2, 2))
        w[corner] = np.nan
        assert len(triangles(map_of(lambda u, v, w=w: w, u=AXIS[:2], v=AXIS[:2]))[1]) == 1
    with pytest.raises(DataError, match="three neighbouring"):
        triangles(map_of(lambda u, v: u, v=AXIS[:1]))


def box_mesh(u: tuple[float, float], v: tuple[float, float], w: float) -> tuple[FloatArray, FloatArray]:
    vertices = np.array([[a, b, c] for c in (0.0, w) for b in v for a in u])
    quads = [(4, 5, 7, 6), (0, 2, 3, 1), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def test_truth_is_the_outermost_surface_and_its_rim_belongs_to_it() -> None:
    low, low_faces = box_mesh((-0.1, 0.1), (-0.1, 0.1), 0.02)
    high, high_faces = box_mesh((-0.1, 0.1), (-0.1, 0.0), 0.09)
    vertices, faces = np.vstack([low, high]), np.vstack([low_faces, high_faces + 8])
    grid = MapGrid(np.arange(-12, 13) * 0.01, np.arange(-12, 13) * 0.01, np.eye(4))
    truth = truth_from_mesh(vertices, faces, grid)
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    part = (np.abs(u) < 0.1001) & (np.abs(v) < 0.1001)
    np.testing.assert_array_equal(truth.mask, part)
    np.testing.assert_allclose(truth.height_m[part & (v < -1e-6)], 0.09, atol=1e-12)
    np.testing.assert_allclose(truth.height_m[part & (v > 1e-6)], 0.02, atol=1e-12)


def test_truth_in_any_frame_is_exact_to_double_precision() -> None:
    frame = pose(rotation_about([1.0, 2.0, -0.5], 0.7), [30.0, -20.0, 1.0])
    u, v = np.meshgrid(np.linspace(-0.1, 0.1, 20), np.linspace(-0.1, 0.1, 15))
    w = 0.3 * u - 0.2 * v
    surface = map_of(lambda u, v: 0.3 * u - 0.2 * v, u=u[0], v=v[:, 0], frame=frame)
    vertices, faces = triangles(surface)
    truth = truth_from_mesh(vertices, faces, MapGrid(AXIS, AXIS, frame))
    uu, vv = np.meshgrid(AXIS, AXIS)
    np.testing.assert_allclose(truth.height_m, 0.3 * uu - 0.2 * vv, atol=1e-13)
    assert w.shape == (15, 20)


def test_truth_around_covers_the_part_on_the_maps_own_nodes() -> None:
    vertices, faces = box_mesh((-0.1, 0.1), (-0.1, 0.1), 0.02)
    small = MapGrid(np.array([0.005, 0.015]), np.array([0.0, 0.02]), np.eye(4))
    truth = truth_around(vertices, faces, small)
    np.testing.assert_allclose(truth.grid.u_m, np.arange(20) * 0.01 - 0.095, atol=1e-12)
    np.testing.assert_allclose(truth.grid.v_m, np.arange(11) * 0.02 - 0.1, atol=1e-12)
    assert truth.mask.all()
    with pytest.raises(DataError, match="no triangles"):
        truth_around(vertices, faces[:0], small)
    with pytest.raises(DataError, match="not finite"):
        truth_around(vertices * np.nan, faces, small)


def test_continuing_a_grid_keeps_its_nodes() -> None:
    grid = MapGrid(np.array([0.0, 0.1, 0.3]), np.array([0.5]), np.eye(4))
    got = extended_grid(grid, np.array([-0.21, 0.0]), np.array([0.75, 0.51]))
    np.testing.assert_allclose(got.u_m, [-0.2, -0.1, 0.0, 0.1, 0.3, 0.5, 0.7])
    np.testing.assert_allclose(got.v_m, [0.05, 0.2, 0.35, 0.5])
    with pytest.raises(DataError, match="units"):
        extended_grid(grid, np.array([-1e9, 0.0]), np.array([0.0, 0.0]))


def test_refining_a_grid_keeps_its_nodes() -> None:
    grid = MapGrid(np.array([0.0, 0.1, 0.3]), np.array([0.5]), np.eye(4))
    got = refined(grid, 4)
    assert got.shape == (1, 9)
    np.testing.assert_array_equal(got.u_m[::4], grid.u_m)
    with pytest.raises(DataError, match="factor"):
        refined(grid, 0)
