from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfuse.errors import DataError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, FusedPoints, Gap, Gate, MapGrid, Outline, Regime
from surfuse.surface.gridding import cells_inside, grid_points, lattice

FRAME = np.eye(4)


def raster(nu: int, nv: int, du: float = 0.01, dv: float = 0.01) -> FloatArray:
    u, v = np.meshgrid(np.arange(nu) * du - 0.05, np.arange(nv) * dv + 0.02)
    return np.column_stack([u.ravel(), v.ravel()])


def points_at(
    uv: FloatArray, w: FloatArray, sigma: FloatArray | float = 1e-3, gap: FloatArray | None = None
) -> FusedPoints:
    n = len(uv)
    return FusedPoints(
        stop=np.arange(n), row=np.zeros(n), depth_m=np.asarray(w), sigma_m=np.broadcast_to(sigma, n),
        point_m=np.column_stack([uv, w]), gap=np.zeros(n) if gap is None else gap, reset=np.zeros(n),
        start=np.arange(n + 1) * 2, sensor=np.tile([0, 1], n), dc=np.tile([1.0, 0.0], n), dc1=np.ones(2 * n),
        dc2=np.ones(2 * n), dc3=np.ones(2 * n), gate=np.tile([Gate.PASSED, Gate.NO_ECHO], n),
    )  # fmt: skip


def test_raster_gets_its_own_lines_back() -> None:
    uv = raster(7, 5, 0.01, 0.02)
    grid = lattice(np.random.default_rng(0).permutation(uv), FRAME)
    np.testing.assert_allclose(grid.u_m, np.unique(uv[:, 0]), atol=1e-15)
    np.testing.assert_allclose(grid.v_m, np.unique(uv[:, 1]), atol=1e-15)


@given(st.integers(2, 60), st.integers(2, 12), st.floats(0.001, 0.5), st.floats(0.0, 0.1), st.integers(0, 99))
@settings(deadline=None, max_examples=40)
def test_raster_with_pose_noise_and_missing_stops(nu: int, nv: int, step: float, noise: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv = raster(nu, nv, step, step) + rng.uniform(-noise, noise, (nu * nv, 2)) * step
    kept = rng.random(len(uv)) > 0.2
    kept[[0, nu - 1, -1, -nu]] = True
    grid = lattice(uv[kept], FRAME)
    assert grid.shape == (nv, nu)
    np.testing.assert_allclose(grid.u_m, np.arange(nu) * step - 0.05, atol=step * (0.02 + noise))
    np.testing.assert_allclose(np.diff(grid.u_m), np.diff(grid.u_m)[0], rtol=1e-9)


def test_whole_lines_may_be_missing() -> None:
    uv = raster(9, 9)
    column = np.round((uv[:, 0] + 0.05) / 0.01)
    grid = lattice(uv[(column != 3) & (column != 4)], FRAME)
    assert grid.shape == (9, 9)
    np.testing.assert_allclose(grid.u_m, np.arange(9) * 0.01 - 0.05, atol=1e-12)


def test_lines_at_unequal_distances_stay_where_they_are() -> None:
    u = np.array([0.0, 0.01, 0.025, 0.03])
    uv = np.array([(a, b) for b in (0.0, 0.01, 0.02) for a in u])
    np.testing.assert_allclose(lattice(uv, FRAME).u_m, u, atol=1e-15)


def test_rows_that_start_anywhere_get_equal_steps_along_them() -> None:
    rng = np.random.default_rng(1)
    uv = np.concatenate(
        [np.column_stack([np.arange(20) * 0.01 + rng.uniform(0, 0.01), np.full(20, r * 0.01)]) for r in range(15)]
    )
    grid = lattice(uv, FRAME)
    np.testing.assert_allclose(grid.v_m, np.arange(15) * 0.01, atol=1e-12)
    assert np.diff(grid.u_m) == pytest.approx(0.01, rel=0.1)
    assert grid.u_m[0] <= uv[:, 0].min() + 0.005
    assert grid.u_m[-1] >= uv[:, 0].max() - 0.005


def test_scattered_stops_get_a_grid_at_their_spacing() -> None:
    uv = np.random.default_rng(2).uniform(0, 0.2, (400, 2))
    grid = lattice(uv, FRAME)
    assert 0.003 < np.diff(grid.u_m)[0] < 0.01
    assert np.diff(grid.u_m)[0] == pytest.approx(np.diff(grid.v_m)[0])


def test_one_stop_one_row_and_a_given_step() -> None:
    assert lattice(np.array([[0.1, 0.2]]), FRAME).shape == (1, 1)
    assert lattice(np.array([[0.1, 0.2]] * 3), FRAME).shape == (1, 1)
    row = lattice(raster(8, 1), FRAME)
    assert row.shape == (1, 8)
    given_step = lattice(raster(11, 11), FRAME, step_m=0.02)
    np.testing.assert_allclose(given_step.u_m, np.arange(6) * 0.02 - 0.05, atol=1e-12)
    assert lattice(np.array([[0.0, 0.0], [np.nan, 1.0]]), FRAME).shape == (1, 1)


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf])
def test_bad_steps_are_refused(step: float) -> None:
    with pytest.raises(DataError, match="step"):
        lattice(raster(3, 3), FRAME, step_m=step)


def test_no_stop_and_too_many_nodes_are_refused() -> None:
    with pytest.raises(DataError, match="no stop"):
        lattice(np.zeros((0, 2)), FRAME)
    with pytest.raises(DataError, match="larger step"):
        lattice(np.array([[0.0, 0.0], [1.0, 1.0]]), FRAME, step_m=1e-9)
    with pytest.raises(DataError, match="larger step"):
        lattice(np.array([[0.0, 0.0], [1e-9, 0.0], [1e6, 1.0], [1e6 + 1e-9, 1.0]]), FRAME)


def test_each_node_gets_its_point_and_nothing_is_invented() -> None:
    uv = raster(5, 4)
    w = 0.1 * uv[:, 0] + uv[:, 1]
    gap = np.zeros(20)
    w[7], gap[7] = np.nan, Gap.NO_VALID_READING
    grid = lattice(uv, FRAME)
    surface = grid_points(points_at(uv, w, gap=gap), grid, "test")
    expected = w.reshape(4, 5)
    np.testing.assert_array_equal(surface.mask, np.isfinite(expected))
    np.testing.assert_allclose(surface.height_m, expected, rtol=1e-12)
    np.testing.assert_allclose(surface.sigma_m[surface.mask], 1e-3, rtol=1e-12)
    np.testing.assert_array_equal(surface.confidence, np.where(surface.mask, 0.5, 0.0))
    np.testing.assert_array_equal(surface.count, np.where(surface.mask, 1, 0))
    np.testing.assert_array_equal(surface.regime, np.where(surface.mask, Regime.MEASURED, Regime.EMPTY))
    assert surface.method == "test"


def test_several_points_are_averaged_by_inverse_variance() -> None:
    grid = MapGrid(np.array([0.0, 0.01]), np.array([0.0, 0.01]), FRAME)
    uv = np.array([[0.001, 0.0], [-0.002, 0.001], [0.01, 0.01], [0.01, 0.011]])
    points = points_at(uv, np.array([1.0, 1.0006, 2.0, 3.0]), np.array([1e-3, 5e-4, 1e-3, 1e-3]))
    surface = grid_points(points, grid, "test")
    assert surface.height_m[0, 0] == pytest.approx((1.0 + 4 * 1.0006) / 5)
    assert surface.sigma_m[0, 0] == pytest.approx(1.0 / math.sqrt(1e6 + 4e6))
    # Points that contradict each other: the scatter decides.
    assert surface.sigma_m[1, 1] == pytest.approx(math.sqrt(0.5 / 2))
    assert surface.count.tolist() == [[2, 0], [0, 2]]


def test_points_beyond_half_a_step_are_left_out() -> None:
    grid = MapGrid(np.arange(3) * 0.01, np.arange(3) * 0.01, FRAME)
    uv = np.array([[-0.0049, 0.0], [-0.0051, 0.01], [0.0249, 0.02], [0.0251, 0.02], [0.0, 0.0251]])
    surface = grid_points(points_at(uv, np.ones(5)), grid, "test")
    assert surface.count.sum() == 2
    assert surface.mask[0, 0]
    assert surface.mask[2, 2]


def test_lone_lines_take_the_reach_of_the_other_axis() -> None:
    grid = MapGrid(np.arange(3) * 0.01, np.array([0.0]), FRAME)
    surface = grid_points(points_at(np.array([[0.0, 0.004], [0.01, 0.006]]), np.ones(2)), grid, "test")
    assert surface.mask.tolist() == [[True, False, False]]
    alone = MapGrid(np.array([0.0]), np.array([0.0]), FRAME)
    assert grid_points(points_at(np.array([[0.0, 0.004]]), np.ones(1)), alone, "test").mask.all()


def test_cells_off_the_part_stay_masked() -> None:
    box = np.array([[-0.03, 0.02], [0.0, 0.02], [0.0, 0.05], [-0.03, 0.05]])
    hole = np.array([[-0.025, 0.03], [-0.015, 0.03], [-0.015, 0.04], [-0.025, 0.04]])
    uv = raster(9, 7)
    grid = lattice(uv, FRAME)
    surface = grid_points(points_at(uv, uv[:, 0]), grid, "test", Outline(box, FRAME, holes_m=(hole,)))
    u, v = np.meshgrid(grid.u_m, grid.v_m)
    inside = (u > -0.0301) & (u < 1e-6) & (v > 0.0199) & (v < 0.0501)
    inside &= ~((u > -0.0249) & (u < -0.0151) & (v > 0.0301) & (v < 0.0399))
    np.testing.assert_array_equal(surface.mask, inside)


def test_a_node_off_the_plane_is_on_the_part_where_the_camera_saw_it() -> None:
    box = np.array([[-0.05, 0.02], [0.05, 0.02], [0.05, 0.1], [-0.05, 0.1]])
    outline = Outline(box, FRAME, viewpoint_m=np.array([0.0, 0.06, 1.0]))
    uv = raster(11, 9)
    for w, share in ((0.0, 1.0), (0.1, 1.0 / 0.9), (-0.1, 1.0 / 1.1)):
        found = grid_points(points_at(uv, np.full(len(uv), w)), lattice(uv, FRAME), "test", outline).mask
        seen = [0.0, 0.06] + share * (uv - [0.0, 0.06])
        seen[:, 1] = np.maximum(seen[:, 1], 0.02)  # below its foot there is only the table
        inside = np.all((seen >= box.min(axis=0) - 1e-9) & (seen <= box.max(axis=0) + 1e-9), axis=1)
        np.testing.assert_array_equal(found.ravel(), inside)


def test_outline_in_another_frame_and_its_margin() -> None:
    grid = lattice(raster(9, 7), FRAME)
    box = np.array([[-0.03, 0.02], [0.0, 0.02], [0.0, 0.05], [-0.03, 0.05]])
    plain = cells_inside(grid, Outline(box, FRAME))
    turned = pose(rotation_about([0, 0, 1], 0.4), [0.3, 0.1, -2.0])
    seen = (box - turned[:2, 3]) @ turned[:2, :2]
    np.testing.assert_array_equal(cells_inside(grid, Outline(seen, turned)), plain)
    enlarged = box + 0.02 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    np.testing.assert_array_equal(cells_inside(grid, Outline(enlarged, FRAME, margin_m=0.02)), plain)


def test_no_points_give_an_empty_map_and_sigma_0_is_refused() -> None:
    grid = lattice(raster(3, 3), FRAME)
    assert not grid_points(points_at(np.zeros((0, 2)), np.zeros(0)), grid, "test").mask.any()
    with pytest.raises(DataError, match="standard deviation"):
        grid_points(points_at(np.zeros((1, 2)), np.zeros(1), 0.0), grid, "test")
