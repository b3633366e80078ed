from __future__ import annotations

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.records import FloatArray, MapGrid, Regime, SurfaceMap
from surfuse.surface.coverage import LEVELS, half_width, interval_coverage


def map_of(height: FloatArray, sigma: FloatArray, regime: FloatArray) -> SurfaceMap:
    rows, columns = height.shape
    grid = MapGrid(np.arange(columns) * 0.01, np.arange(rows) * 0.01, np.eye(4))
    mask = np.isfinite(height)
    one = mask.astype(np.float64)
    return SurfaceMap(
        grid, height, np.where(mask, sigma, np.nan), one, one.astype(np.int64), mask, regime.astype(np.uint8), "test"
    )


def flat(shape: tuple[int, int]) -> SurfaceMap:
    return map_of(np.zeros(shape), np.zeros(shape), np.full(shape, int(Regime.MEASURED)))


def test_normal_errors_with_a_right_sigma_are_covered_as_stated() -> None:
    rng, shape = np.random.default_rng(3), (300, 300)
    sigma = rng.uniform(0.001, 0.01, shape)
    found = interval_coverage(map_of(sigma * rng.normal(size=shape), sigma, np.ones(shape)), flat(shape))[0]
    assert found.share == pytest.approx(LEVELS, abs=4.0 * np.sqrt(0.25 / 90_000))
    assert found.z_rms == pytest.approx(1.0, abs=0.01)
    # Half the true sigma: 90 % intervals then reach only to 0.82 of the true sigma, which holds 58.9 %.
    bold = interval_coverage(map_of(2.0 * sigma * rng.normal(size=shape), sigma, np.ones(shape)), flat(shape))[0]
    assert bold.share[1] == pytest.approx(0.589, abs=0.01)
    assert bold.z_rms == pytest.approx(2.0, abs=0.02)


def test_regimes_are_told_apart_and_add_up() -> None:
    height, regime = np.zeros((4, 5)), np.full((4, 5), int(Regime.MIRROR))
    height[0], regime[0] = 1.0, int(Regime.PRIOR)
    height[1, 1] = np.nan
    everything, mirror, prior = interval_coverage(map_of(height, np.full((4, 5), 0.01), regime), flat((4, 5)))
    assert (everything.regime, mirror.regime, prior.regime) == (None, Regime.MIRROR, Regime.PRIOR)
    assert (everything.cells, mirror.cells, prior.cells) == (19, 14, 5)
    assert (mirror.share, prior.share) == ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    assert everything.share[0] == pytest.approx(14 / 19)
    assert prior.rmse_m == 1.0


def test_widths_are_the_quantiles_of_the_normal_distribution() -> None:
    assert [half_width(level) for level in LEVELS] == pytest.approx([0.67449, 1.64485, 2.57583], abs=1e-5)
    with pytest.raises(DataError, match="between 0 and 1"):
        half_width(1.0)


def test_nothing_in_common_is_refused() -> None:
    empty = map_of(np.full((3, 3), np.nan), np.ones((3, 3)), np.zeros((3, 3)))
    with pytest.raises(DataError, match="no cell in common"):
        interval_coverage(empty, flat((3, 3)))
