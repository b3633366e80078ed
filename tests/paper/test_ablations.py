"""What each degree of confidence is for: the paper's method without one of them, on equal readings."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.records import FusedPoints, FusionResult, Gap, SurfaceMap
from surfuse.runs.scan_source import load_scan
from surfuse.settings import load
from surfuse.surface.score import score
from surfuse.surface.truth import read_truth_mesh, truth_around

PLATE_HALF_M = 0.10
STEP_AT_M = 0.10


@pytest.fixture(scope="module")
def without(experiment):
    """Points and map of a scene without the named factors."""
    scans = {}

    def fuse(scene: str, *factors: str, **more: object) -> tuple[FusionResult, SurfaceMap]:
        if scene not in scans:
            scans[scene] = load_scan(experiment(scene))
        values = {**{f"use_{factor}": "false" for factor in factors}, **more}
        texts = [f"fusion.parameters.weighted_average.{key}={value}" for key, value in values.items()]
        method = create_method(load(None, texts).fusion, "weighted_average")
        return fused(scans[scene], method, grid_of(scans[scene]))

    return fuse


def of_stops(points: FusedPoints, values: np.ndarray) -> np.ndarray:
    """Mean over the valid readings of each stop; nan where there is none."""
    found = np.full(len(points), np.nan)
    for j, (first, end) in enumerate(zip(points.start[:-1], points.start[1:], strict=True)):
        valid = points.gate[first:end] == 0
        if valid.any():
            found[j] = values[first:end][valid].mean()
    return found


@pytest.mark.parametrize("factor", ["dc1", "dc2", "dc3"])
def test_a_factor_that_is_off_is_one_for_every_valid_reading(without, factor):
    points = without("relief", factor)[0].points
    valid = points.gate == 0
    assert np.all(getattr(points, factor)[valid] == 1.0)
    others = {"dc1", "dc2", "dc3"} - {factor}
    assert all(np.any(getattr(points, other)[valid] < 0.9) for other in others)


def test_without_all_three_the_paper_has_the_plain_average(without, experiment):
    """Equation 1 with equal weights; only the validation is left."""
    points = without("relief", "dc1", "dc2", "dc3")[0].points
    readings = load_scan(experiment("relief")).readings
    for j in np.flatnonzero(points.gap == int(Gap.NONE)):
        rows = slice(points.start[j], points.start[j + 1])
        valid = points.gate[rows] == 0
        assert points.depth_m[j] == pytest.approx(readings.range_m[rows][valid].mean(), abs=1e-3)


def test_confidence_is_the_product_of_its_factors(without):
    """Equation 2."""
    points = without("relief")[0].points
    valid = points.gate == 0
    assert points.dc[valid] == pytest.approx((points.dc1 * points.dc2 * points.dc3)[valid], abs=1e-12)
    assert np.all(points.dc[~valid] == 0.0)
    for factor in (points.dc, points.dc1, points.dc2, points.dc3):
        assert factor[valid].min() >= 0.0
        assert factor[valid].max() <= 1.0


def test_boundary_confidence_falls_towards_the_rim(without):
    points = without("flat")[0].points
    u, v = np.abs(points.point_m[:, 0]), points.point_m[:, 1]
    dc3, middle = of_stops(points, points.dc3), (points.gap == int(Gap.NONE)) & (v > 0.05) & (v < 0.15)
    bands = [(0.0, 0.02), (0.05, 0.06), (0.07, 0.08), (0.09, PLATE_HALF_M)]
    means = [np.nanmean(dc3[middle & (u >= low) & (u < high)]) for low, high in bands]
    assert means == sorted(means, reverse=True)
    assert means[0] > 0.95
    assert means[-1] < 0.65


def test_boundary_confidence_keeps_stops_beside_the_part_out_of_the_map(without):
    with_it, without_it = without("flat")[0].points, without("flat", "dc3")[0].points
    beside = np.abs(with_it.point_m[:, 0]) > PLATE_HALF_M + 0.005
    assert beside.any()
    assert np.nansum(of_stops(with_it, with_it.dc)[beside]) < np.nansum(of_stops(without_it, without_it.dc)[beside])


def test_prediction_starts_afresh_where_the_surface_changes(without):
    plain, step = without("flat")[0].points, without("relief")[0].points
    inner = np.abs(plain.point_m[:, 0]) < PLATE_HALF_M - 0.02
    assert not np.any(plain.reset[inner])
    v = step.point_m[step.reset & (np.abs(step.point_m[:, 0]) < PLATE_HALF_M), 1]
    assert len(v) > 3
    assert np.median(np.abs(v - STEP_AT_M)) < 0.06


def test_a_window_that_never_starts_afresh_distrusts_the_change(without):
    """The heuristic of the paper: after a change no reading is punished for it."""
    points, stubborn = without("relief")[0].points, without("relief", change_m=10.0)[0].points
    resets = np.flatnonzero(points.reset & (points.gap == int(Gap.NONE)))
    assert not stubborn.reset[resets].all()
    assert np.nanmean(of_stops(points, points.dc1)[resets]) > np.nanmean(of_stops(stubborn, stubborn.dc1)[resets])


def test_agreement_falls_where_sensors_see_both_sides_of_the_step(without):
    flat, step = without("flat")[0].points, without("relief")[0].points

    def agreement(points: FusedPoints, low: float, high: float) -> float:
        v, inner = points.point_m[:, 1], np.abs(points.point_m[:, 0]) < 0.06
        return float(np.nanmean(of_stops(points, points.dc2)[inner & (v > low) & (v < high)]))

    assert agreement(flat, 0.03, 0.17) > 0.95
    assert agreement(step, 0.02, 0.08) > 0.85
    assert agreement(step, STEP_AT_M + 0.01, STEP_AT_M + 0.04) < 0.3


def test_the_paper_opposes_steep_slopes_whatever_is_switched_off(without, experiment):
    """Conclusion of the paper: big variations have to be treated in other ways than by weights."""
    vertices, triangles = read_truth_mesh(experiment("relief") / "truth.ply")
    for factors in ((), ("dc1",), ("dc2",), ("dc3",), ("dc1", "dc2", "dc3")):
        surface = without("relief", *factors)[1]
        assert 0.005 < score(surface, truth_around(vertices, triangles, surface.grid)).rmse_m < 0.05
