import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from surfuse.records import MapGrid, SurfaceMap
from surfuse.report.deviation import deviation, sample


def make(u, v, height, mask=None):
    height = np.asarray(height, dtype=float)
    mask = np.isfinite(height) if mask is None else mask
    zero = np.zeros(height.shape)
    return SurfaceMap(MapGrid(u, v, np.eye(4)), height, zero, zero, zero, mask, zero, "test")


def plane(u, v):
    return 2.0 * u[None, :] - 3.0 * v[:, None] + 0.5


def test_a_plane_is_sampled_exactly_everywhere_inside():
    u, v = np.array([0.0, 0.1, 0.3, 0.35]), np.array([-1.0, 0.2, 0.4])
    at_u, at_v = np.linspace(0.0, 0.35, 23), np.linspace(-1.0, 0.4, 17)
    assert np.allclose(sample(make(u, v, plane(u, v)), at_u, at_v), plane(at_u, at_v), atol=1e-12)


def test_sampling_agrees_with_scipy():
    rng = np.random.default_rng(3)
    u, v = np.sort(rng.random(9)), np.sort(rng.random(7))
    height = rng.standard_normal((7, 9))
    at_u, at_v = np.linspace(u[0], u[-1], 31), np.linspace(v[0], v[-1], 29)
    grid = np.stack(np.meshgrid(at_v, at_u, indexing="ij"), axis=-1)
    wanted = RegularGridInterpolator((v, u), height)(grid)
    assert np.allclose(sample(make(u, v, height), at_u, at_v), wanted, atol=1e-12)


def test_outside_there_is_no_truth():
    u = v = np.array([0.0, 1.0])
    got = sample(make(u, v, np.ones((2, 2))), np.array([-0.01, 0.0, 1.0, 1.01]), np.array([0.5]))
    assert np.array_equal(np.isnan(got[0]), [True, False, False, True])


def test_a_hole_spoils_only_places_that_it_has_a_part_in():
    u = v = np.array([0.0, 1.0, 2.0])
    height = np.ones((3, 3))
    height[0, 2] = np.nan
    got = sample(make(u, v, height), np.array([0.0, 1.0, 1.5, 2.0]), np.array([0.0, 1.0]))
    assert np.array_equal(np.isnan(got), [[False, False, True, True], [False, False, False, False]])


def test_one_node_is_enough():
    one = make(np.array([0.3]), np.array([0.4]), [[7.0]])
    assert sample(one, np.array([0.3]), np.array([0.4])) == pytest.approx(7.0)


def test_error_is_map_minus_truth_and_empty_where_the_map_is():
    u, v = np.linspace(0, 1, 5), np.linspace(0, 1, 4)
    truth = make(u, v, plane(u, v))
    mask = np.ones((4, 5), dtype=bool)
    mask[1, 2] = False
    error = deviation(make(u, v, plane(u, v) + 0.25, mask), truth)
    assert np.isnan(error[1, 2])
    assert np.allclose(error[mask], 0.25)
    assert np.allclose(deviation(truth, truth), 0.0, atol=1e-15)
