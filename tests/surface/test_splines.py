from __future__ import annotations

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.records import FloatArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.splines import spline_surface

AXIS = np.arange(-7, 8) * 0.01


def map_of(w: FloatArray, sigma: FloatArray | float = 1e-4, u: FloatArray = AXIS, v: FloatArray = AXIS) -> SurfaceMap:
    mask = np.isfinite(w)
    return SurfaceMap(
        MapGrid(u, v, np.eye(4)), w, np.where(mask, sigma, np.nan), mask * 0.5, mask.astype(np.int64) * 4, mask,
        mask * np.uint8(Regime.MEASURED), "test",
    )  # fmt: skip


def uv(u: FloatArray = AXIS, v: FloatArray = AXIS) -> tuple[FloatArray, FloatArray]:
    uu, vv = np.meshgrid(u, v)
    return uu, vv


def test_without_smoothing_it_runs_through_the_nodes_and_is_exact_for_cubics() -> None:
    u, v = uv()
    cubic = 3 * u**3 - 2 * u * v**2 + v
    drawn = spline_surface(map_of(cubic), smoothing=0.0, refine=3)
    fu, fv = uv(drawn.grid.u_m, drawn.grid.v_m)
    np.testing.assert_allclose(drawn.height_m, 3 * fu**3 - 2 * fu * fv**2 + fv, atol=1e-12)
    np.testing.assert_allclose(drawn.height_m[::3, ::3], cubic, atol=1e-12)
    assert drawn.method == "test+spline"
    assert drawn.mask.all()


def test_noise_is_smoothed_to_what_sigma_allows() -> None:
    u, _ = uv()
    noise = np.random.default_rng(0).normal(0.0, 1e-3, u.shape)
    wave = 0.01 * np.sin(60 * u)
    drawn = spline_surface(map_of(wave + noise, 1e-3))
    residual = drawn.height_m - (wave + noise)
    assert np.sum(residual**2) == pytest.approx(u.size * 1e-3**2, rel=0.01)
    assert np.std(drawn.height_m - wave) < 0.7 * np.std(noise)


def test_a_step_is_drawn_round() -> None:
    _, v = uv()
    step = np.where(v < 0.0, 0.09, 0.0)
    sigma = np.where(np.abs(v) < 0.025, 0.02, 2e-4)
    drawn = spline_surface(map_of(step, sigma))
    steepest, plain = np.abs(np.diff(drawn.height_m, axis=0)).max(), np.abs(np.diff(step, axis=0)).max()
    assert steepest < 0.8 * plain
    near = np.abs(v) < 0.015
    assert np.abs(drawn.height_m - step)[near].max() > 0.005
    # sigma says where the drawing departs from the readings.
    assert np.all(drawn.sigma_m >= np.abs(drawn.height_m - step) - 1e-12)


def test_inner_gaps_are_bridged_as_prior_and_planes_stay_planes() -> None:
    u, v = uv()
    plane = 0.3 * u - 0.7 * v + 0.1
    holed = plane.copy()
    holed[5:8, 6:10] = np.nan
    holed[:3, :3] = np.nan
    drawn = spline_surface(map_of(holed), smoothing=0.0)
    np.testing.assert_allclose(drawn.height_m[drawn.mask], plane[drawn.mask], atol=1e-8)
    assert drawn.mask[6, 7]
    assert drawn.regime[6, 7] == Regime.PRIOR
    assert drawn.count[6, 7] == 0
    assert drawn.confidence[6, 7] == 0.0
    assert drawn.regime[4, 4] == Regime.MEASURED
    # Outside of the hull of the data nothing is drawn: the corner that was cut off.
    assert not drawn.mask[0, 0]
    assert not drawn.mask[0, 1]
    assert drawn.mask[0, 3]


@pytest.mark.parametrize("refine", [1, 4])
def test_small_maps_are_drawn_too(refine: int) -> None:
    for rows, columns in ((1, 1), (1, 6), (6, 1), (2, 2), (3, 2)):
        u, v = uv(AXIS[:columns], AXIS[:rows])
        drawn = spline_surface(map_of(0.5 * u + v, u=AXIS[:columns], v=AXIS[:rows]), refine=refine)
        assert drawn.grid.shape == ((rows - 1) * refine + 1, (columns - 1) * refine + 1)
        fu, fv = uv(drawn.grid.u_m, drawn.grid.v_m)
        np.testing.assert_allclose(drawn.height_m, 0.5 * fu + fv, atol=1e-3)
        assert np.all(drawn.sigma_m > 0.0)


def test_points_on_a_slanted_line_span_no_area() -> None:
    w = np.full((5, 5), np.nan)
    np.fill_diagonal(w, 0.02)
    drawn = spline_surface(map_of(w, u=AXIS[:5], v=AXIS[:5]), refine=2)
    np.testing.assert_array_equal(drawn.mask[::2, ::2], np.isfinite(w))
    assert drawn.mask.sum() == 5


def test_an_empty_map_stays_empty_and_bad_arguments_are_refused() -> None:
    empty = map_of(np.full((15, 15), np.nan))
    assert not spline_surface(empty).mask.any()
    for smoothing, refine in ((-1.0, 1), (np.nan, 1), (1.0, 0)):
        with pytest.raises(DataError, match="smoothing"):
            spline_surface(empty, smoothing, refine)
