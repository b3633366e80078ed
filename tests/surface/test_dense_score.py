"""Dense scores against truths whose errors can be written down."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.records import FloatArray, MapGrid, SurfaceMap
from surfuse.surface.dense_score import (
    beside_steps,
    dense_grid,
    dense_score,
    dense_truth_of_map,
    dense_truth_of_mesh,
    heights_between,
)
from surfuse.surface.step_edges import crossings, step_edges

HALF_M, STEP_M = 0.1, 0.01
NODES = np.arange(-10, 11) * STEP_M
FRAME = pose(rotation_about([0.0, 0.0, 1.0], 0.4), [0.3, -0.1, 1.0])
Height = Callable[[FloatArray, FloatArray], FloatArray]


def sampled(height: Height, u: FloatArray = NODES, v: FloatArray = NODES) -> SurfaceMap:
    """A map that has the height at its nodes."""
    grid = MapGrid(u, v, FRAME)
    w = height(*np.meshgrid(u, v)) * np.ones(grid.shape)
    mask = np.isfinite(w)
    full = np.ones(grid.shape)
    return SurfaceMap(grid, w, np.where(mask, 1e-3, np.nan), full, mask, mask, mask, "test")


def dense(height: Height) -> SurfaceMap:
    """Truth on the raster of one millimetre."""
    grid = dense_grid(MapGrid(NODES, NODES, FRAME), np.full(2, -HALF_M), np.full(2, HALF_M))
    return sampled(height, grid.u_m, grid.v_m)


def step(at: float, height_m: float = 0.09, angle: float = 0.0) -> Height:
    """High where cos(angle) u + sin(angle) v < at."""
    return lambda u, v: np.where(np.cos(angle) * u + np.sin(angle) * v < at, height_m, 0.0)


def ramped(at: float, height_m: float = 0.09, angle: float = 0.0, width: float = 0.04) -> Height:
    """The same step as a coarse map can hold it: straight over a width, at half height where the step is."""
    return lambda u, v: height_m * np.clip(0.5 - (np.cos(angle) * u + np.sin(angle) * v - at) / width, 0.0, 1.0)


def test_the_raster_has_a_place_every_millimetre_and_the_nodes_of_the_map_among_them():
    grid = dense_grid(MapGrid(NODES, NODES + 0.0004, FRAME), np.array([-0.1005, -0.1]), np.array([0.1, 0.1]))
    np.testing.assert_allclose(np.diff(grid.u_m), 0.001, atol=1e-12)
    assert grid.shape == (200, 201)
    assert np.min(np.abs(grid.v_m[:, None] - (NODES + 0.0004)[None, :]), axis=0)[1:-1] == pytest.approx(0.0, abs=1e-12)


def test_a_large_part_is_sampled_as_finely_as_its_size_allows():
    grid = dense_grid(MapGrid(NODES, NODES, FRAME), np.full(2, -5.0), np.full(2, 5.0))
    assert grid.shape[0] * grid.shape[1] == pytest.approx(2e6, rel=0.01)
    with pytest.raises(DataError, match="frame"):
        dense_grid(MapGrid(NODES, NODES, FRAME), np.full(2, -np.inf), np.full(2, 5.0))


def test_between_nodes_a_map_is_bilinear_and_half_a_step_beyond_them_the_last_node_speaks():
    def warped(u: FloatArray, v: FloatArray) -> FloatArray:
        return 0.1 * u - 0.3 * v + 2.0 * u * v

    wide = MapGrid(np.linspace(-0.107, 0.107, 215), np.linspace(-0.1, 0.1, 201), FRAME)
    got = heights_between(sampled(warped), wide)
    u, v = np.meshgrid(wide.u_m, wide.v_m)
    inside = np.abs(u) <= HALF_M
    np.testing.assert_allclose(got[inside], warped(u, v)[inside], atol=1e-12)
    near = (u > HALF_M + 1e-6) & (u < HALF_M + 0.5 * STEP_M) & np.isclose(np.mod(v + 1.0, STEP_M), 0.0)
    np.testing.assert_allclose(got[near], warped(HALF_M, v[near]), atol=1e-12)
    assert np.all(np.isnan(got[np.abs(u) > HALF_M + 0.5 * STEP_M + 1e-6]))


def test_beside_a_missing_node_the_nearest_one_speaks_for_its_cell():
    holed = sampled(lambda u, v: np.where(np.hypot(u, v) < 1e-6, np.nan, u))
    got = heights_between(holed, MapGrid(np.array([-0.006, -0.004, 0.0, 0.0051, 0.006]), np.array([0.002]), FRAME))
    np.testing.assert_allclose(got[0], [-0.01, np.nan, np.nan, 0.01, 0.01], atol=1e-12)


def test_a_map_in_another_frame_is_refused():
    other = MapGrid(NODES, NODES, np.eye(4))
    with pytest.raises(DataError, match="frame"):
        heights_between(sampled(lambda u, v: u), other)


@pytest.mark.parametrize(("offset", "within"), [(0.002, 1.0), (-0.004, 0.0)])
def test_an_offset_is_the_error_everywhere(offset, within):
    found = dense_score(sampled(lambda u, v: 0.3 * u + offset), dense(lambda u, v: 0.3 * u))
    assert (found.rmse_m, found.off_edge_rmse_m) == pytest.approx((abs(offset), abs(offset)))
    assert (found.within, found.coverage, found.places) == (within, 1.0, 201 * 201)
    assert np.isnan(found.edge_m)


def test_perfect_nodes_are_not_a_perfect_map():
    def wave(u: FloatArray, v: FloatArray) -> FloatArray:
        return 0.01 * np.cos(2.0 * np.pi * u / 0.06)

    found = dense_score(sampled(wave), dense(wave))
    fine = np.linspace(-HALF_M, HALF_M, 201)
    wanted = np.interp(fine, NODES, wave(NODES, NODES)) - wave(fine, fine)
    assert found.rmse_m == pytest.approx(np.sqrt(np.mean(wanted**2)), rel=1e-9)
    assert found.rmse_m > 0.0005


def test_a_step_between_perfect_nodes_counts_where_it_is_and_not_off_the_edge():
    found = dense_score(sampled(step(0.0051)), dense(step(0.0051)))
    # Straight over 10 mm: twice the integral of (h (1/2 - x / 10 mm))^2 over 5 mm, of which 3 mm lie within the step.
    assert found.rmse_m == pytest.approx(0.09 * np.sqrt(2.0 * 10.0 * 0.5**3 / 3.0 / 200.0), rel=0.03)
    assert found.off_edge_rmse_m == pytest.approx(0.09 * np.sqrt(2.0 * 10.0 * 0.2**3 / 3.0 / 194.0), rel=0.15)
    assert found.within == pytest.approx(1.0 - 9.0 / 201.0, abs=0.006)


def test_without_a_value_a_place_is_wrong_but_no_error():
    half = sampled(lambda u, v: np.where(u < 0.001, 0.0, np.nan))
    found = dense_score(half, dense(lambda u, v: 0.0 * u))
    assert found.rmse_m == 0.0
    assert found.coverage == found.within == pytest.approx(106 / 201)
    nothing = dense_score(sampled(lambda u, v: u + np.nan), dense(lambda u, v: 0.0 * u))
    assert np.isnan(nothing.rmse_m)
    assert (nothing.places, nothing.within) == (0, 0.0)


def test_places_within_a_step_are_three_millimetres_to_both_sides():
    on = beside_steps(dense(step(0.0205)))
    u = dense(step(0.0205)).grid.u_m
    np.testing.assert_array_equal(on[100], np.abs(u - 0.0205) < 0.003)
    assert not np.any(beside_steps(dense(step(0.0205, height_m=0.0079))))
    # A slope of 45 degrees is none, along whichever direction it runs.
    for angle in (0.0, 0.6, np.pi / 4):
        assert not np.any(beside_steps(dense(lambda u, v, a=angle: np.cos(a) * u + np.sin(a) * v)))


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 90.0, 155.0, 270.0])
@pytest.mark.parametrize("shift", [-0.012, 0.0, 0.0071])
def test_an_edge_of_any_direction_is_positive_where_the_high_side_is_too_large(angle_deg, shift):
    angle = np.radians(angle_deg)
    truth = dense(step(0.0052, angle=angle))
    found = dense_score(sampled(ramped(0.0052 + shift, angle=angle)), truth)
    assert found.edge_m == pytest.approx(shift, abs=6e-4)
    assert step_edges(heights_between(sampled(ramped(0.0052 + shift, angle=angle)), truth.grid), truth).found > 0.94


@pytest.mark.parametrize(("high", "sign"), [(0.03, 1.0), (-0.03, -1.0)])
def test_the_rim_of_a_disc_is_an_edge_all_around(high, sign):
    truth = dense(lambda u, v: np.where(np.hypot(u - 0.01, v) < 0.05, high, 0.0))
    larger = sampled(lambda u, v: high * np.clip(0.5 - (np.hypot(u - 0.01, v) - 0.056) / 0.02, 0.0, 1.0))
    found = step_edges(heights_between(larger, truth.grid), truth)
    assert found.bias_m == pytest.approx(sign * 0.006, abs=5e-4)
    assert found.rms_m == pytest.approx(0.006, abs=5e-4)


def test_every_tread_of_stairs_has_its_edge():
    truth = dense(lambda u, v: 0.012 * np.floor((u + 0.1) / 0.03))
    right = step_edges(truth.height_m, truth)
    assert right.bias_m == pytest.approx(0.0, abs=1e-9)
    assert len(right.error_m) == 6 * 201
    shifted = np.roll(truth.height_m, 2, axis=1)
    assert step_edges(shifted, truth).bias_m == pytest.approx(-0.002, abs=1e-9)


def test_slopes_have_no_edge_and_an_edge_that_the_map_lacks_is_not_found():
    steep = dense(lambda u, v: np.clip(2.0 * u, -0.06, 0.06))
    assert len(step_edges(steep.height_m, steep).error_m) == 0
    assert np.isnan(step_edges(steep.height_m, steep).found)
    truth = dense(step(0.0005))
    partly = np.where(truth.grid.v_m[:, None] < 0.0, truth.height_m, 0.0)
    got = step_edges(partly, truth)
    assert got.found == pytest.approx(100 / 201)
    assert got.bias_m == 0.0
    with pytest.raises(DataError, match="interpolate"):
        step_edges(partly[:-1], truth)


def test_crossings_of_a_profile():
    at, sense = crossings(np.arange(7.0), np.array([0.0, 1.0, 1.0, 0.0, np.nan, 1.0, 0.0]), 0.25)
    np.testing.assert_allclose(at, [0.25, 2.75, 5.75])
    assert sense.tolist() == [1.0, -1.0, -1.0]


def test_truth_as_mesh_and_as_map_in_any_frame_give_the_same_score():
    surface = sampled(lambda u, v: 0.2 * u + 0.001 * np.sin(40.0 * v))
    corners = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    part = np.column_stack([corners, 0.2 * corners[:, 0]])
    mesh = dense_truth_of_mesh(transform_points(FRAME, part), np.array([[0, 1, 2], [0, 2, 3]]), surface.grid)
    as_map = dense_truth_of_map(sampled(lambda u, v: 0.2 * u), surface.grid)
    wanted = dense_score(surface, dense(lambda u, v: 0.2 * u))
    for truth in (mesh, as_map):
        found = dense_score(surface, truth)
        assert found.rmse_m == pytest.approx(wanted.rmse_m, rel=1e-9)
        assert found.places == wanted.places
