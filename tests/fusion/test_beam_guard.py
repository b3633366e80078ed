"""The guard: held-out readings and free space choose among surfaces, region by region."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surfuse.beam_model.echo.detector import DetectorModel, beam_table
from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.judge.held_out import (
    FREE_SLACK_M,
    LEAST_STATIONS,
    OWN,
    HeldOutVerdict,
    _decided,
    fallen_back,
    held_out,
    judged,
    regions,
)
from surfuse.beam_model.judge.plain_surfaces import NAMES, simple_surfaces
from surfuse.beam_model.map.tiles import sheet_of
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.descent import Solution
from surfuse.beam_model.search.estimation import Estimation, arrivals, problem
from surfuse.records import FloatArray, GuardReason, Regime, SensorSpec, in_words

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
RASTER = Raster(-0.1, -0.1, 0.01, np.ones((21, 21), dtype=bool))


@pytest.fixture(scope="module")
def over_a_plate() -> tuple[Estimation, Stations]:
    """Stations over a facing plate at w = 0: those shown to the estimate, and those held out."""
    axis = np.arange(-10, 11) * 0.01
    u, v = np.meshgrid(axis, axis)
    n = u.size
    rng = np.random.default_rng(3)
    all_of = Stations(
        np.column_stack([u.ravel(), v.ravel(), np.full(n, 0.43)]), np.tile([0.0, 0.0, -1.0], (n, 1)),
        0.43 + rng.normal(0.0, 3e-4, n), np.full(n, 3e-4), np.full(n, np.nan), np.zeros(n, dtype=np.int64),
        np.ones(n, dtype=np.int64), np.arange(n),
    )  # fmt: skip
    apart = held_out(all_of)
    tables = (beam_table(SPEC, 440, DetectorModel()),)
    return problem(all_of.select(~apart), tables, RASTER, 0.01), all_of.select(apart)


def solution(p: Estimation, height: FloatArray) -> Solution:
    return Solution(height, arrivals(p, height, 0.004), Stiffness(1e-3, 1e2, 0.5), 0.004, 0.0, "test")


def test_one_station_in_five_is_held_out_and_none_when_all_are_needed(
    over_a_plate: tuple[Estimation, Stations],
) -> None:
    p, judges = over_a_plate
    assert len(judges) == pytest.approx(441 / 5, abs=1)
    few = p.stations.select(np.arange(len(p.stations)) < LEAST_STATIONS - 1)
    assert not np.any(held_out(few))
    assert np.ptp(judges.foot_m[:, 0]) > 0.17
    assert np.ptp(judges.foot_m[:, 1]) > 0.17


def test_regions_are_squares_that_cover_the_raster() -> None:
    number = regions(RASTER)
    assert set(np.unique(number)) == {0, 1, 2, 3}
    assert np.all(number[:10, :10] == 0)
    assert np.all(number[11:, 11:] == 3)


def test_a_true_surface_is_kept_everywhere(over_a_plate: tuple[Estimation, Stations]) -> None:
    p, judges = over_a_plate
    verdict = judged(p, solution(p, np.zeros(RASTER.shape)), judges)
    assert not verdict.replaced
    assert all(one.reason is GuardReason.BEST and one.chosen == OWN for one in verdict.decisions)
    assert sum(one.cells for one in verdict.decisions) == 441
    assert sum(one.held_out for one in verdict.decisions) == len(judges)
    assert all(one.miss_m[0] < 4e-4 for one in verdict.decisions)
    assert in_words(verdict.decisions) == "of 4 regions beam in 4"


def test_a_surface_that_is_wrong_in_one_region_is_replaced_there_and_only_there(
    over_a_plate: tuple[Estimation, Stations],
) -> None:
    p, judges = over_a_plate
    wrong = np.where(regions(RASTER) == 3, -0.02, 0.0)
    found = solution(p, wrong)
    verdict = judged(p, found, judges)
    reasons = [one.reason for one in verdict.decisions]
    assert reasons[3] is GuardReason.BEATEN
    assert reasons[0] is GuardReason.BEST
    winner = verdict.decisions[3]
    assert winner.chosen in NAMES
    assert winner.miss_m[winner.candidates.index(winner.chosen)] < 0.5 * winner.miss_m[0]
    sheet = fallen_back(sheet_of(p, found), p, verdict, RASTER)
    inner = np.zeros(RASTER.shape, dtype=bool)
    inner[14:20, 14:20] = True
    assert np.max(np.abs(sheet.height_m[inner])) < 2e-3
    assert np.all(sheet.regime[inner] == Regime.MEASURED)
    # The mean size of a normal error is sqrt(2 / pi) of its standard deviation.
    miss_m = winner.miss_m[winner.candidates.index(winner.chosen)]
    np.testing.assert_allclose(sheet.sigma_m[inner], np.sqrt(np.pi / 2.0) * miss_m, rtol=1e-4)
    assert np.all(sheet.sigma_m[inner] < 2e-3)
    np.testing.assert_array_equal(sheet.height_m[:8, :8], wrong[:8, :8])


def test_a_better_predictor_in_free_space_is_refused(
    over_a_plate: tuple[Estimation, Stations], monkeypatch: pytest.MonkeyPatch
) -> None:
    p, judges = over_a_plate
    bound = np.full(RASTER.shape, -0.5 - FREE_SLACK_M)
    monkeypatch.setattr("surfuse.beam_model.judge.held_out.free_space", lambda *_: bound)
    verdict = judged(p, solution(p, np.full(RASTER.shape, -0.6)), judges)
    assert {one.reason for one in verdict.decisions} == {GuardReason.FREE_SPACE}
    assert not verdict.replaced


def test_without_judges_nothing_is_decided(over_a_plate: tuple[Estimation, Stations]) -> None:
    p, judges = over_a_plate
    nobody = judges.select(np.zeros(len(judges), dtype=bool))
    verdict = judged(p, solution(p, np.zeros(RASTER.shape)), nobody)
    assert {one.reason for one in verdict.decisions} == {GuardReason.TOO_FEW}
    assert all(np.isnan(one.miss_m[0]) for one in verdict.decisions)
    assert "not judged" in in_words(verdict.decisions)
    assert in_words((replace(verdict.decisions[0], reason=GuardReason.BEST),)) == "of 1 region beam in 1"
    assert not HeldOutVerdict(verdict.region, verdict.decisions).replaced


def test_simple_surfaces_of_a_plate_are_the_plate(over_a_plate: tuple[Estimation, Stations]) -> None:
    p, _ = over_a_plate
    for name, height in simple_surfaces(p).items():
        assert np.sqrt(np.mean(height**2)) < 2e-3, name


def decided(mean_gain_m: float, spread_m: float, judges: int = 16) -> str:
    """Who wins a region where one rival is nearer to the held-out ranges by a mean gain that scatters so much."""
    rng = np.random.default_rng(0)
    gain = rng.normal(size=judges)
    gain = mean_gain_m + spread_m * (gain - gain.mean()) / gain.std(ddof=1)
    miss = np.column_stack([np.full(judges, 0.004), 0.004 - gain])
    return _decided(RASTER, RASTER.domain, (OWN, "rival"), miss, np.zeros(2)).chosen


def test_a_rival_must_be_better_by_more_than_chance() -> None:
    """By two and a half standard errors of the mean gain: of 16 judges, by 0.625 of its scatter."""
    assert decided(0.002, 0.0) == "rival"
    assert decided(0.002, 0.0031) == "rival"
    assert decided(0.002, 0.0033) == OWN


def test_a_rival_must_be_better_by_a_quarter_of_the_miss() -> None:
    assert decided(0.00102, 0.0) == "rival"
    assert decided(0.00098, 0.0) == OWN
