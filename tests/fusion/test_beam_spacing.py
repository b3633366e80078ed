"""The spacing that the beam method takes from the readings: of a raster, of lines, of scattered points."""

import numpy as np
import pytest

from surfuse.beam_model.heard.stations import Stations, spacing


def stations(uv: np.ndarray) -> Stations:
    m = len(uv)
    position = np.column_stack([uv, np.full(m, 0.43)])
    axis = np.tile([0.0, 0.0, -1.0], (m, 1))
    none, one = np.full(m, np.nan), np.ones(m, dtype=np.int64)
    return Stations(position, axis, np.full(m, 0.43), np.full(m, 3e-4), none, 0 * one, one, np.arange(m))


def raster(step_u: float, step_v: float, size: float = 0.12, turned: float = 0.0) -> np.ndarray:
    u, v = np.meshgrid(np.arange(0.0, size, step_u), np.arange(0.0, size, step_v))
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    return np.column_stack([u.ravel(), v.ravel()]) @ turn.T


def test_of_a_raster_it_is_the_step() -> None:
    assert spacing(stations(raster(0.01, 0.01))) == pytest.approx(0.01)
    assert spacing(stations(raster(0.01, 0.015))) == pytest.approx(0.01)


@pytest.mark.parametrize("turned", [0.0, 0.4, np.pi / 2])
def test_of_lines_read_on_the_fly_it_is_the_distance_of_the_lines(turned: float) -> None:
    assert spacing(stations(raster(0.0024, 0.01, turned=turned))) == pytest.approx(0.01, rel=0.06)


def test_scattered_points_and_single_lines_keep_their_nearest_neighbour() -> None:
    rng = np.random.default_rng(0)
    scattered = rng.uniform(0.0, 0.1, (300, 2))
    assert 0.001 < spacing(stations(scattered)) < 0.005
    assert spacing(stations(raster(0.002, 1.0))) == pytest.approx(0.002)
    assert np.isnan(spacing(stations(np.zeros((1, 2)))))
