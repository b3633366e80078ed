"""What sigma holds: the speed of sound that all readings share, and explanations that compete."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surfuse.beam_model.echo.detector import DetectorModel, beam_table
from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.judge.rivals import rival_spread
from surfuse.beam_model.map.layers import external, layers, speed_sigma
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.descent import Solution
from surfuse.beam_model.search.estimation import Estimation, arrivals, deviation, problem
from surfuse.records import FloatArray, SensorSpec

TUBE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
LASER = SensorSpec("tof", "laser", 0.02, 2.0, float(np.radians(2.0)), 3e-4)
RASTER = Raster(-0.05, -0.05, 0.01, np.ones((11, 11), dtype=bool))


def plate(spec: SensorSpec, sigma_k: float) -> Estimation:
    axis = np.arange(-5, 6) * 0.01
    u, v = np.meshgrid(axis, axis)
    n = u.size
    stations = Stations(
        np.column_stack([u.ravel(), v.ravel(), np.full(n, 0.43)]), np.tile([0.0, 0.0, -1.0], (n, 1)),
        np.full(n, 0.43), np.full(n, 3e-4), np.full(n, np.nan), np.zeros(n, dtype=np.int64),
        np.ones(n, dtype=np.int64), np.arange(n),
    )  # fmt: skip
    table = beam_table(spec, 440, DetectorModel(air_temperature_sigma_k=sigma_k))
    return problem(stations, (table,), RASTER, 0.01)


def solution(p: Estimation, height: FloatArray, score: float = 0.0) -> Solution:
    return Solution(height, arrivals(p, height, 0.004), Stiffness(1e-3, 1e2, 0.5), 0.004, score, "test")


def test_the_speed_of_sound_is_a_share_of_the_range() -> None:
    p = plate(TUBE, 1.0)
    assert speed_sigma(p, solution(p, np.zeros((11, 11)))) == pytest.approx(0.43 * 0.5 / 293.15, rel=1e-6)


def test_light_knows_no_air_temperature() -> None:
    p = plate(LASER, 1.0)
    assert speed_sigma(p, solution(p, np.zeros((11, 11)))) == 0.0


def test_no_number_of_readings_takes_the_air_out_of_sigma() -> None:
    exact, unknown = plate(TUBE, 0.0), plate(TUBE, 1.0)
    flat = np.zeros((11, 11))
    without, with_it = layers(exact, solution(exact, flat)).sigma_m, layers(unknown, solution(unknown, flat)).sigma_m
    assert np.median(without) < 0.3e-3
    np.testing.assert_allclose(with_it**2 - without**2, (0.43 * 0.5 / 293.15) ** 2, rtol=1e-6)


@pytest.mark.parametrize(("misses", "ratio"), [(0.5, 1.0), (3.0, 9.0), (10.0, 16.0)])
def test_readings_that_miss_their_predictions_widen_sigma_around_them(misses: float, ratio: float) -> None:
    """By how much more than they should, squared, and by sixteen at most."""
    even = plate(TUBE, 0.0)
    flat = solution(even, np.zeros((11, 11)))
    sign = np.where(np.indices((11, 11)).sum(axis=0) % 2, 1.0, -1.0)
    off_m = (sign * (np.arange(11) > 5)).ravel() * misses * deviation(even, flat.heard, 0.0)
    torn = replace(even, stations=replace(even.stations, range_m=even.stations.range_m + off_m))
    found = external(torn, flat)
    np.testing.assert_allclose(found[:, :4], 1.0)
    np.testing.assert_allclose(found[:, 8:], ratio, rtol=0.03)
    wider = layers(torn, flat).sigma_m / layers(even, flat).sigma_m
    assert np.all(wider[:, 8:] > 0.9 * np.sqrt(ratio))
    assert np.all(wider[:, :4] < 1.2)


def test_explanations_as_good_as_the_best_one_widen_sigma() -> None:
    p = plate(TUBE, 0.0)
    flat = np.zeros((11, 11))
    other = np.where(np.arange(11) > 5, 0.01, 0.0) * np.ones((11, 1))
    best, rival = solution(p, flat), solution(p, other)
    even = rival_spread([best, rival], 6.0)
    assert np.all(even[:, :5] == 0.0)
    np.testing.assert_allclose(even[:, 7:], 0.01 / np.sqrt(2.0))
    assert np.max(rival_spread([best, replace(rival, score=60.0)], 6.0)) < 1e-4
    assert np.all(layers(p, best, even).sigma_m[:, 7:] > 0.007)
