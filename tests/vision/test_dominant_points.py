"""Dominant points: the exact optimum, laws of invariance, and plain twins of the compiled kernels."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.vision.dominant_points import DominantPointParameters, dominant_points
from surfuse.vision.dominant_points.chords import Curve, chord_error, farthest, running_sums, slope, turn
from surfuse.vision.dominant_points.order import shape_order
from surfuse.vision.dominant_points.refinement import _best_polygon, total_error

CURVES = json.loads((Path(__file__).parents[1] / "data" / "dominant_point_curves.json").read_text())


def curve(name):
    return np.array(CURVES["curves"][name]["points"], dtype=float)[: CURVES["curves"][name]["n"]]


def chromosome():
    return curve("chromosome")


def semicircle():
    return curve("semicircle")


def flower(n=240, petals=5, depth=0.25):
    angle = 2.0 * np.pi * np.arange(n) / n
    radius = 80.0 * (1.0 + depth * np.cos(petals * angle + 0.3) + 0.05 * np.sin(2 * angle))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def rectangle(width=60, height=40):
    x = [*range(width), *[width] * height, *range(width, 0, -1), *[0] * height]
    y = [*[0] * width, *range(height), *[height] * width, *range(height, 0, -1)]
    return np.column_stack([x, y]).astype(float)


def plain_errors(contour, indices):
    """Integral square error and largest distance to the chord lines, point by point."""
    n, total, largest = len(contour), 0.0, 0.0
    for i, j in zip(indices, [*indices[1:], indices[0] + n], strict=True):
        p, d = contour[i], contour[j % n] - contour[i]
        length = math.hypot(*d)
        for k in range(i + 1, j):
            r = contour[k % n] - p
            distance = abs(d[0] * r[1] - d[1] * r[0]) / length if length else math.hypot(*r)
            total, largest = total + distance**2, max(largest, distance)
    return total, largest


@pytest.mark.parametrize("name", ["chromosome", "leaf", "semicircle"])
def test_squared_error_is_the_optimum_at_the_same_number_of_points(name):
    contour = curve(name)
    for count in range(10, 31):
        found = dominant_points(contour, n_points=count)
        assert len(found.indices) == count
        error, _ = plain_errors(contour, found.indices)
        optimum = CURVES["curves"][name]["optimal_ISE_by_n_d"][str(count)]
        assert optimum * (1.0 - 1e-4) <= error <= optimum * 1.02


@pytest.mark.parametrize("name", ["chromosome", "leaf", "semicircle"])
def test_ahead_of_every_published_row(name):
    contour = curve(name)
    for row in CURVES["published_table_from_memory"][name].values():
        error, _ = plain_errors(contour, dominant_points(contour, n_points=row[0]).indices)
        assert error < row[1]


@pytest.mark.parametrize("name", ["chromosome", "leaf", "semicircle"])
@pytest.mark.parametrize("tolerance", [0.6, 0.8, 1.0, 1.5, 2.0])
def test_tolerance_is_kept_and_close_to_the_optimum(name, tolerance):
    contour = curve(name)
    found = dominant_points(contour, DominantPointParameters(tolerance_px=tolerance))
    error, largest = plain_errors(contour, found.indices)
    assert largest <= tolerance + 1e-9
    optimum = CURVES["curves"][name]["optimal_ISE_by_n_d"].get(str(len(found.indices)))
    if optimum is not None:
        assert error <= 1.25 * optimum


def test_corners_of_a_polygon_and_nothing_else():
    contour = rectangle()
    found = dominant_points(contour)
    assert {tuple(p) for p in found.points_px} == {(0, 0), (60, 0), (60, 40), (0, 40)}
    assert found.turn_rad == pytest.approx([math.pi / 2] * 4, abs=1e-6)


def test_circle_is_followed_within_the_tolerance():
    angle = 2.0 * np.pi * np.arange(400) / 400
    contour = 100.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    found = dominant_points(contour, DominantPointParameters(tolerance_px=1.0))
    # A chord of half angle a leaves a circle of radius R by R (1 - cos a).
    least = math.pi / math.acos(1.0 - 1.0 / 100.0)
    assert least <= len(found.indices) <= 2.0 * least
    assert plain_errors(contour, found.indices)[1] <= 1.0


def test_small_sharp_corner_survives_where_a_gentle_bend_of_the_same_height_does_not():
    x = np.arange(0, 201.0)
    notch = np.where(np.abs(x - 100) < 3, 0.9 * (3 - np.abs(x - 100)) / 3, 0.0)
    bend = 0.9 * np.sin(np.pi * x / 200)
    sharp = dominant_points(np.column_stack([x, 3 * notch]), DominantPointParameters(tolerance_px=3.0), closed=False)
    gentle = dominant_points(np.column_stack([x, 3 * bend]), DominantPointParameters(tolerance_px=3.0), closed=False)
    assert gentle.indices.tolist() == [0, 200]
    assert 100 in sharp.candidates


@pytest.mark.parametrize("options", [{}, {"n_points": 12}])
@pytest.mark.parametrize("make", [flower, rectangle, chromosome, semicircle])
def test_result_does_not_depend_on_start_direction_turn_mirror_place_or_scale(make, options):
    contour = make()
    n = len(contour)
    parameters = DominantPointParameters(tolerance_px=1.2)
    reference = dominant_points(contour, parameters, **options)
    expected = {tuple(p) for p in reference.points_px}
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    for shift, backwards, scale in itertools.product((0, 1, n // 3, n - 1), (False, True), (1.0, 0.5, 3.7)):
        moved = np.roll(contour[::-1] if backwards else contour, shift, axis=0)
        scaled = DominantPointParameters(tolerance_px=1.2 * scale)
        found = dominant_points(moved @ quarter.T * scale + [30.0, -7.0], scaled, **options)
        back = moved[found.indices]
        if make in (rectangle, semicircle):
            # A mirror-symmetric shape has pairs of equally good answers, which its own symmetry maps onto each other.
            errors = plain_errors(moved, found.indices), plain_errors(contour, reference.indices)
            assert errors[0] == pytest.approx(errors[1])
            assert len(back) == len(expected)
        else:
            assert {tuple(p) for p in back} == expected


def test_open_curve_keeps_its_ends_and_may_be_read_either_way():
    contour = flower()[:150]
    found = dominant_points(contour, closed=False)
    assert found.indices[0] == 0
    assert found.indices[-1] == 149
    back = dominant_points(contour[::-1], closed=False)
    assert np.array_equal(np.sort(149 - back.indices), found.indices)


def test_open_optimum_equals_exhaustive_search():
    contour = np.round(flower(60)[:14])
    centred = contour - contour.mean(axis=0)
    best = min(
        sum(
            chord_error(Curve(centred, running_sums(centred), 14, False), i, j)
            for i, j in itertools.pairwise((0, *inner, 13))
        )
        for inner in itertools.combinations(range(1, 13), 3)
    )
    found = dominant_points(contour, closed=False, n_points=5)
    sums = running_sums(centred)
    assert total_error(Curve(centred, sums, 14, False), found.indices) == pytest.approx(best, abs=1e-9)


def test_shape_order_is_the_same_for_every_start_and_direction():
    contour = flower(97)
    expected = contour[shape_order(contour, True)]
    for shift in (1, 40, 96):
        for moved in (np.roll(contour, shift, axis=0), np.roll(contour, shift, axis=0)[::-1]):
            assert np.array_equal(moved[shape_order(moved, True)], expected)


def test_kernels_equal_their_plain_twins():
    generator = np.random.default_rng(2)
    points = np.cumsum(generator.normal(size=(30, 2)), axis=0)
    points -= points.mean(axis=0)
    doubled = np.concatenate([points, points])
    curve = Curve(doubled, running_sums(doubled), 30, True)
    for i, j in ((0, 9), (5, 29), (25, 38), (-4, 3), (7, 8), (31, 44)):
        numbers = np.arange(i + 1, j) % 30
        p, d = points[i % 30], points[j % 30] - points[i % 30]
        r = points[numbers] - p
        across = (d[0] * r[:, 1] - d[1] * r[:, 0]) / math.hypot(*d)
        assert chord_error(curve, i, j) == pytest.approx(float(across @ across), abs=1e-9)
        along = np.clip(r @ d / (d @ d), 0.0, 1.0)
        distance = np.hypot(*(r - along[:, None] * d).T)
        where, largest = farthest(curve, i, j, 0.0)
        if len(numbers):
            assert largest == pytest.approx(distance.max())
            assert where == i + 1 + int(np.argmax(distance))
        run = points[np.arange(i, j + 1) % 30]
        _, vectors = np.linalg.eigh(np.cov(run.T))
        fitted = vectors[:, 1] * np.sign(vectors[:, 1] @ d)
        assert math.cos(slope(curve, i, j) - math.atan2(fitted[1], fitted[0])) == pytest.approx(1.0)


def test_chord_between_equal_points_measures_the_distance_to_the_point():
    points = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0]])
    assert chord_error(Curve(points, running_sums(points), 3, False), 0, 2) == pytest.approx(25.0)
    assert farthest(Curve(points, running_sums(points), 3, False), 0, 2, 0.0) == (1, 5.0)


def test_turn_of_a_right_angle():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]]) - 1.0
    assert turn(Curve(points, running_sums(points), 5, False), 0, 2, 4) == pytest.approx(math.pi / 2)


def test_best_polygon_equals_exhaustive_search():
    contour = np.round(flower(40, 3) / 6)
    contour = contour[np.any(np.diff(contour, axis=0, append=contour[:1]) != 0, axis=1)][:16]
    n = len(contour)
    points = contour - contour.mean(axis=0)
    doubled = np.concatenate([points, points])
    curve = Curve(doubled, running_sums(doubled), n, True)
    pool = np.arange(n + 1)
    found = _best_polygon(curve, pool, 5, 0.0)
    errors = [total_error(curve, np.array([0, *rest])) for rest in itertools.combinations(range(1, n), 4)]
    assert total_error(curve, found) == pytest.approx(min(errors), abs=1e-9)


def test_points_that_repeat_or_cross_themselves_do_no_harm():
    eight = np.column_stack(
        [60 * np.sin(np.linspace(0, 2 * np.pi, 200)[:-1]), 30 * np.sin(np.linspace(0, 4 * np.pi, 200)[:-1])]
    )
    assert len(dominant_points(eight).indices) >= 8
    assert len(dominant_points(np.repeat(rectangle(10, 8), 3, axis=0)).indices) >= 4
    assert len(dominant_points(np.zeros((5, 2))).indices) == 3


def test_every_count_up_to_the_whole_contour_is_reached():
    contour = rectangle(8, 5)
    for count in range(3, len(contour) + 1):
        assert len(set(dominant_points(contour, n_points=count).indices.tolist())) == count


@pytest.mark.parametrize(
    ("contour", "options"),
    [
        (np.zeros((2, 2)), {}),
        (np.zeros((1, 2)), {"closed": False}),
        (np.zeros((9, 3)), {}),
        (np.full((9, 2), np.nan), {}),
        (rectangle(), {"n_points": 2}),
        (rectangle(), {"n_points": 9999}),
    ],
)
def test_impossible_contours_are_refused(contour, options):
    with pytest.raises(DataError):
        dominant_points(contour, **options)


@pytest.mark.parametrize(
    "values",
    [{"tolerance_px": 0.0}, {"tolerance_px": math.nan}, {"corner_rad": 0.0}, {"spacing_px": -1.0}, {"rounds": -1}],
)
def test_impossible_parameters_are_refused(values):
    with pytest.raises(ConfigError):
        DominantPointParameters(**values)
