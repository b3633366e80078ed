from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError, DataError
from surfuse.node.averaging import (
    AMPLITUDE_STEPS,
    RANGE_STEPS_PER_M,
    AveragingParameters,
    average_echoes,
    average_pings,
    consistent,
)
from surfuse.records import Echo, Status

HALF_WAVE = 0.5 * 343.2 / 63e3
POLAROID = AveragingParameters(sigma_m=0.3e-3, half_wavelength_m=HALF_WAVE)
INF, NAN = float("inf"), float("nan")


def average(*ranges: float, parameters: AveragingParameters | None = POLAROID) -> Echo:
    return average_pings(np.array(ranges), np.full(len(ranges), 0.5), 1.5, parameters)


def test_equal_pings_are_their_mean_with_spread_and_count() -> None:
    echo = average(0.4298, 0.4300, 0.4302)
    assert (echo.range_m, echo.status, echo.count, echo.t_s) == (0.43, Status.OK, 3, 1.5)
    assert echo.spread_m == pytest.approx(0.2e-3)
    assert echo.amplitude == 0.5


@pytest.mark.parametrize(
    ("ranges", "status", "number", "count"),
    [
        ((INF, INF, INF, 0.4, 0.4), Status.NO_ECHO, INF, 3),
        ((INF, INF, 0.4, 0.4, 0.4), Status.OK, 0.4, 3),
        ((INF, 0.4), Status.NO_ECHO, INF, 1),
        ((-INF, -INF, 0.4), Status.TOO_CLOSE, -INF, 2),
        ((NAN, NAN, NAN), Status.FAULT, NAN, 3),
        ((NAN, 0.4, 0.4), Status.OK, 0.4, 2),
    ],
)
def test_the_majority_decides_what_the_answer_is(ranges, status: Status, number: float, count: int) -> None:
    echo = average(*ranges)
    assert echo.status is status
    assert echo.range_m == pytest.approx(number, nan_ok=True)
    assert echo.count == count


def test_an_outlier_takes_no_part() -> None:
    echo = average(0.4300, 0.4301, 0.4299, 0.3712, 0.4300)
    assert echo.range_m == pytest.approx(0.43, abs=2e-5)
    assert echo.count == 4


def test_cycle_slips_are_taken_back() -> None:
    generator = np.random.default_rng(2)
    for _ in range(200):
        slips = generator.integers(0, 3, 7)
        slips[:3] = 0
        ranges = 0.43 + slips * HALF_WAVE + 0.15e-3 * generator.normal(size=7)
        found = consistent(ranges, POLAROID)
        assert found.slips.tolist() == slips.tolist()
        assert found.range_m == pytest.approx(0.43, abs=0.3e-3)


def test_a_late_path_that_is_no_slip_is_an_outlier_not_moved() -> None:
    found = consistent(np.array([0.43, 0.4301, 0.4299, 0.43 + 2.5 * HALF_WAVE]), POLAROID)
    assert found.slips.tolist() == [0, 0, 0, 0]
    assert found.used.tolist() == [True, True, True, False]


def test_better_than_mean_and_median_under_slips_and_outliers() -> None:
    generator = np.random.default_rng(7)
    errors = {"own": [], "mean": [], "median": []}
    for _ in range(500):
        ranges = 0.43 + 0.3e-3 * generator.normal(size=7) + HALF_WAVE * (generator.random(7) < 0.3)
        ranges += 0.03 * (generator.random(7) < 0.1)
        errors["own"].append(consistent(ranges, POLAROID).range_m - 0.43)
        errors["mean"].append(ranges.mean() - 0.43)
        errors["median"].append(np.median(ranges) - 0.43)
    # A majority of outliers cannot be told from the truth by anyone: compare what holds nine times of ten.
    worst = {name: float(np.percentile(np.abs(values), 90)) for name, values in errors.items()}
    assert worst["own"] < 0.3e-3
    assert worst["own"] < 0.3 * worst["median"]
    assert worst["own"] < 0.1 * worst["mean"]


def test_one_early_ping_does_not_make_slips_of_all_others() -> None:
    found = consistent(np.array([0.43 - HALF_WAVE, 0.43, 0.4301, 0.4299, 0.43]), POLAROID)
    assert found.used.tolist() == [False, True, True, True, True]
    assert found.range_m == pytest.approx(0.43, abs=1e-4)


def test_pings_counted_by_a_coarse_clock_are_all_kept() -> None:
    step = 0.5 * 343.2 / 50e3
    counted = np.array([0.43, 0.43, 0.43, 0.43 + step])
    coarse = replace(POLAROID, resolution_m=step)
    assert consistent(counted, coarse).range_m == pytest.approx(counted.mean())
    # Who does not know of the clock takes the rare tick for an error.
    assert consistent(counted, POLAROID).range_m < 0.4303


def test_a_scatter_wider_than_expected_is_no_reason_to_drop_pings() -> None:
    wide = 0.43 + np.array([-0.02, -0.012, 0.0, 0.009, 0.019])
    found = consistent(wide, AveragingParameters(sigma_m=0.3e-3))
    assert found.used.all()
    assert found.range_m == pytest.approx(wide.mean())


@pytest.mark.parametrize("pings", [3, 5, 8])
@pytest.mark.parametrize(("slip", "stray"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.15), (0.15, 0.1)])
def test_not_worse_than_mean_or_median_whatever_the_pings_suffer_from(pings: int, slip: float, stray: float) -> None:
    generator = np.random.default_rng(pings)
    wrong = {"own": 0, "mean": 0, "median": 0}
    for _ in range(300):
        ranges = 0.43 + 0.3e-3 * generator.normal(size=pings) + HALF_WAVE * (generator.random(pings) < slip)
        ranges = np.where(generator.random(pings) < stray, generator.uniform(0.33, 0.6, pings), ranges)
        answers = (consistent(ranges, POLAROID).range_m, ranges.mean(), np.median(ranges))
        for name, answer in zip(wrong, answers, strict=True):
            wrong[name] += abs(answer - 0.43) > 1e-3
    chance = 2.0 * np.sqrt(min(wrong["mean"], wrong["median"]) + 1.0)
    assert wrong["own"] <= min(wrong["mean"], wrong["median"]) + chance
    if slip:
        assert wrong["own"] < 0.7 * min(wrong["mean"], wrong["median"])


@pytest.mark.parametrize("off_m", [-0.03, -0.012, 0.0038, 0.0043, 0.012, 0.02])
def test_two_pings_that_agree_outvote_one_that_does_not(off_m: float) -> None:
    """Any scatter explains any pings; the wide one must pay for it."""
    found = consistent(np.array([0.43, 0.43 + off_m, 0.43]), POLAROID)
    assert found.used.tolist() == [True, False, True]
    assert found.range_m == pytest.approx(0.43, abs=1e-6)


def test_without_a_wave_nothing_slips() -> None:
    found = consistent(np.array([0.43, 0.43, 0.43 + HALF_WAVE, 0.43 + HALF_WAVE]), AveragingParameters())
    assert not found.slips.any()


def test_values_are_those_that_the_bus_carries() -> None:
    echo = average(0.123456789, 0.123456789, 0.12345)
    assert echo.range_m == round(echo.range_m * RANGE_STEPS_PER_M) / RANGE_STEPS_PER_M
    odd = average_pings(np.array([0.5]), np.array([0.123456789]), 0.0)
    assert odd.amplitude == round(0.123456789 * AMPLITUDE_STEPS) / AMPLITUDE_STEPS
    assert np.isnan(odd.spread_m)
    assert np.isnan(average_pings(np.array([0.5]), np.array([NAN]), 0.0).amplitude)


@given(st.lists(st.one_of(st.floats(0.0, 10.0), st.sampled_from([INF, -INF, NAN])), min_size=1, max_size=31))
def test_any_pings_give_one_honest_answer(ranges: list[float]) -> None:
    echo = average(*ranges)
    finite = [value for value in ranges if np.isfinite(value)]
    assert 1 <= echo.count <= len(ranges)
    if echo.status is Status.OK:
        assert min(finite) - POLAROID.most_slips * HALF_WAVE - 1e-5 <= echo.range_m <= max(finite) + 1e-5
    else:
        assert not np.isfinite(echo.range_m)


@given(st.lists(st.floats(0.3, 4.0), min_size=1, max_size=12), st.randoms())
def test_the_order_of_the_pings_does_not_matter(ranges: list[float], shuffler) -> None:
    mixed = list(ranges)
    shuffler.shuffle(mixed)
    assert average(*mixed).range_m == pytest.approx(average(*ranges).range_m, abs=1.1e-5)


def test_echoes_average_like_their_pings() -> None:
    echoes = [Echo(value, Status.OK, time, 0.8) for value, time in ((0.4, 3.0), (0.402, 3.1), (0.401, 3.2))]
    echo = average_echoes(echoes)
    assert (echo.range_m, echo.t_s, echo.amplitude, echo.count) == (0.401, 3.0, 0.8, 3)


def test_nonsense_is_refused() -> None:
    with pytest.raises(DataError):
        average_pings(np.zeros(0), np.zeros(0), 0.0)
    with pytest.raises(DataError):
        average_pings(np.zeros(3), np.zeros(2), 0.0)
    with pytest.raises(DataError):
        average_echoes([])
    for wrong in (
        {"sigma_m": 0.0},
        {"outlier_sigmas": 0.1},
        {"half_wavelength_m": -1.0},
        {"most_slips": -1},
        {"slip_share": 0.0},
        {"outlier_share": 1.0},
        {"resolution_m": -1.0},
    ):
        with pytest.raises(ConfigError):
            AveragingParameters(**wrong)
