"""A fusion method that is a plain function of one sweep: what the adapter promises to it, and asks of it."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.confidence.gate import GateParameters
from surfuse.errors import DataError
from surfuse.fusing import per_stop as adapter
from surfuse.fusing.per_stop import Fused, one_by_one, per_stop
from surfuse.records import FusionScene, Gap, MapGrid, Readings, SensorSpec

SPECS = tuple(SensorSpec(f"us{k}", "ultrasonic", 0.2, 1.2, 0.23, 3e-4) for k in range(5))
SCENE, GRID = FusionScene(SPECS, np.eye(4)), MapGrid([0.0], [0.0], np.eye(4))


def scan(stops: int, seed: int = 0) -> Readings:
    """0 to 5 readings a stop, a fifth of them no echo."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(0, 6, stops)
    n = int(sizes.sum())
    range_m = np.where(rng.random(n) < 0.2, np.inf, rng.uniform(0.3, 0.5, n))
    return Readings(
        specs=SPECS, t_s=np.arange(n, dtype=np.float64), sensor=np.concatenate([np.arange(k) for k in sizes]),
        position_m=np.zeros((n, 3)), axis=np.tile([0.0, 0.0, 1.0], (n, 1)), range_m=range_m,
        status=np.where(np.isinf(range_m), 1, 0), sigma_m=rng.uniform(1e-4, 1e-3, n),
        start=np.concatenate([[0], np.cumsum(sizes)]), stop=np.arange(stops), row=np.zeros(stops),
        world_from_grip=np.tile(np.eye(4), (stops, 1, 1)),
    )  # fmt: skip


def nearest(value_m: np.ndarray, sigma_m: np.ndarray) -> Fused:
    return Fused(value_m.min(axis=0), np.take_along_axis(sigma_m, value_m.argmin(axis=0)[None], axis=0)[0])


def nearest_of_one(value_m: np.ndarray, sigma_m: np.ndarray) -> tuple[float, float]:
    assert value_m.ndim == 1
    at = int(np.argmin(value_m))
    return float(value_m[at]), float(sigma_m[at])


def test_every_stop_gets_its_own_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adapter, "CALL", 37)
    readings = scan(400)
    points = per_stop("nearest", GateParameters(), nearest).replay(SCENE, readings, GRID).points
    for j in range(readings.n_sweeps):
        sweep = readings.sweep(j)
        if np.any(np.isfinite(sweep.range_m)):
            at = int(np.argmin(sweep.range_m))
            assert (points.depth_m[j], points.sigma_m[j]) == (sweep.range_m[at], sweep.sigma_m[at])
            assert points.gap[j] == Gap.NONE
        else:
            assert points.gap[j] == Gap.NO_VALID_READING
    np.testing.assert_array_equal(points.dc, np.isfinite(readings.range_m))


def test_a_function_of_one_sweep_gives_the_same_bits() -> None:
    readings = scan(200)
    many = per_stop("nearest", GateParameters(), nearest).replay(SCENE, readings, GRID).points
    single = per_stop("nearest", GateParameters(), one_by_one(nearest_of_one)).replay(SCENE, readings, GRID).points
    assert many == single


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    readings, method = scan(300), per_stop("nearest", GateParameters(), nearest)
    before = method.replay(SCENE, readings, GRID).points
    monkeypatch.setattr(adapter, "LEAST_PIECE", 10)
    monkeypatch.setattr(adapter, "CALL", 16)
    assert method.replay(SCENE, readings, GRID).points == before


def test_a_depth_that_is_not_finite_is_a_gap_with_its_reason() -> None:
    def none(value_m: np.ndarray, sigma_m: np.ndarray) -> Fused:
        return Fused(np.full(value_m.shape[1], np.nan), sigma_m[0])

    points = per_stop("none", GateParameters(), none).replay(SCENE, scan(50), GRID).points
    heard = points.gap != Gap.NO_VALID_READING
    assert np.all(points.gap[heard] == Gap.NO_CONFIDENCE)
    assert np.all(np.isnan(points.sigma_m))


def test_weights_become_the_degrees_of_confidence() -> None:
    def weighted(value_m: np.ndarray, sigma_m: np.ndarray) -> Fused:
        return Fused(value_m[0], sigma_m[0], np.full(value_m.shape, 0.25))

    readings = scan(50)
    points = per_stop("weighted", GateParameters(), weighted).replay(SCENE, readings, GRID).points
    np.testing.assert_array_equal(points.dc, np.where(np.isfinite(readings.range_m), 0.25, 0.0))


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (lambda v, s: Fused(v.mean(axis=1), s.mean(axis=1)), r"'odd' made \(\d,\) depths .* reduce axis 0"),
        (lambda v, s: Fused(v[0], s[0], v[0]), "'odd' made"),
        (lambda v, s: Fused(v[0], -s[0]), "'odd' gave a depth the standard deviation -"),
        (lambda v, s: Fused(v[0], s[0] * np.nan), "'odd' gave a depth the standard deviation nan"),
    ],
)
def test_an_answer_that_cannot_be_is_refused_with_its_cure(answer, what: str) -> None:
    with pytest.raises(DataError, match=what):
        per_stop("odd", GateParameters(), answer).replay(SCENE, scan(40), GRID)
