"""The margin from the outline's uncertainty, and the outline as seen along w: closed forms and rendered scenes."""

import math

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.geometry.polygons import is_simple, signed_distance
from surfuse.plan.front_view import front_view
from surfuse.plan.margin import MarginParameters, enlarged, margin_for, margin_in_words, scan_area
from surfuse.plan.scan_plan import PlanParameters
from surfuse.records import Outline

EYE = np.array([0.02, 0.30, 0.95])


def seen_from(eye, points_m):
    """Where points (N, 3) of the part frame are seen on the plane w = 0."""
    points = np.asarray(points_m, dtype=float)
    reach = eye[2] / (eye[2] - points[:, 2])
    return eye[:2] + reach[:, None] * (points[:, :2] - eye[:2])


def outline_of(vertices, eye=EYE, sigma=0.002):
    return Outline(np.asarray(vertices, dtype=float), np.eye(4), sigma_m=np.full(len(vertices), sigma), viewpoint_m=eye)


def turned_plate(yaw, width=0.2, height=0.25):
    """Corners of an upright plate turned about its middle, and its true outline along w."""
    half = 0.5 * width * np.array([-1.0, 1.0, 1.0, -1.0])
    v = np.array([0.0, 0.0, height, height])
    corners = np.column_stack([half * math.cos(yaw), v, half * math.sin(yaw)])
    return corners, corners[:, :2]


@pytest.mark.parametrize("yaw", [-0.5, -0.1, 0.0, 0.3, 0.6])
def test_turned_plate_is_put_right(yaw):
    corners, truth = turned_plate(yaw)
    seen = outline_of(seen_from(EYE, corners))
    view = front_view(seen)
    assert is_simple(view.vertices_m)
    for corner in truth:
        assert np.linalg.norm(view.vertices_m - corner, axis=1).min() < 0.0015
    assert view.relief_m == pytest.approx(0.2 / math.sqrt(12.0) * abs(math.sin(yaw)), abs=0.006)
    if abs(yaw) > 0.2:
        before = -signed_distance(truth, seen.vertices_m).min()
        assert before > 0.006


def test_flat_part_in_the_plane_stays_as_it_is():
    square = [[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]]
    view = front_view(outline_of(square))
    assert view.vertices_m == pytest.approx(np.array(square), abs=1e-6)
    assert view.relief_m == pytest.approx(0.0, abs=1e-9)


def test_without_a_viewpoint_or_above_nothing_moves():
    corners, _ = turned_plate(0.4)
    seen = seen_from(EYE, corners)
    for eye in (None, np.array([0.0, 0.01, 0.95]), np.array([0.0, 0.3, -0.1])):
        outline = Outline(seen, np.eye(4), viewpoint_m=eye)
        assert np.array_equal(front_view(outline).vertices_m, seen)


def test_overhang_is_as_far_away_as_its_foot():
    # A T on a foot in the plane: the bar does not stand on the table.
    t_shape = [[-0.02, 0], [0.02, 0], [0.02, 0.15], [0.1, 0.15], [0.1, 0.2], [-0.1, 0.2], [-0.1, 0.15], [-0.02, 0.15]]
    view = front_view(outline_of(t_shape))
    assert view.vertices_m == pytest.approx(np.array(t_shape), abs=1e-6)


def test_margin_grows_with_the_stated_deviation_and_the_containment():
    square = [[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]]
    exact = margin_for(outline_of(square, sigma=0.0))
    assert exact == pytest.approx(MarginParameters().unseen_m)
    assert margin_for(outline_of(square, sigma=0.004)) == pytest.approx(exact + 2.3263 * 0.004, abs=1e-6)
    half = MarginParameters(containment=0.5)
    assert margin_for(outline_of(square, sigma=0.004), half) == pytest.approx(exact)


def test_relief_of_the_foot_counts_once():
    corners, _ = turned_plate(0.5)
    seen = seen_from(EYE, corners)
    aside = np.abs(seen - EYE[:2]).max(axis=1) / EYE[2]
    relief = front_view(outline_of(seen)).relief_m
    stated = np.hypot(0.002, relief * aside)
    outline = Outline(seen, np.eye(4), sigma_m=stated, viewpoint_m=EYE)
    assert margin_for(outline) == pytest.approx(MarginParameters().unseen_m + 2.3263 * 0.002, abs=1e-4)


def test_scan_area_is_the_front_view_enlarged_by_the_margin():
    corners, truth = turned_plate(0.4)
    seen = outline_of(seen_from(EYE, corners), sigma=0.003)
    area = scan_area(seen, 0.005)
    assert area.margin_m == pytest.approx(margin_for(seen))
    assert np.all(signed_distance(truth, area.vertices_m) > area.margin_m - 0.002)
    assert area.viewpoint_m is None


@pytest.mark.parametrize(("step", "sigma", "margin"), [(0.01, 0.0, 0.02), (0.04, 0.0, 0.02), (0.003, 0.0, 0.008)])
def test_scan_runs_in_two_steps_before_the_rim(step, sigma, margin):
    square = outline_of([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], sigma=sigma)
    assert scan_area(square, step).margin_m == pytest.approx(margin)


def test_an_uncertain_outline_gets_more_than_the_run_in():
    square = outline_of([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], sigma=0.01)
    assert scan_area(square, 0.01).margin_m == pytest.approx(margin_for(square))
    assert margin_for(square) > 0.03


def test_a_given_margin_is_taken_as_it_is():
    square = outline_of([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
    assert enlarged(square, 0.03).margin_m == 0.03
    assert PlanParameters().margin_m is None


@pytest.mark.parametrize(
    "bad", [{"containment": 0.4}, {"containment": 1.0}, {"unseen_m": -0.001}, {"run_in_stops": -1.0}]
)
def test_bad_parameters(bad):
    with pytest.raises(ConfigError):
        MarginParameters(**bad)


def test_words_say_where_the_margin_comes_from():
    square = outline_of([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], sigma=0.002)
    asked = f"{1e3 * margin_for(square):.1f} mm"
    assert (
        margin_in_words(square, 0.03, given=True)
        == f"30.0 mm as configured; the outline's uncertainty asks for {asked}"
    )
    assert (
        margin_in_words(square, 0.02, given=False) == f"20.0 mm, the run-in; the outline's uncertainty asks for {asked}"
    )
    assert (
        margin_in_words(square, margin_for(square), given=False) == f"{asked}, asked for by the outline's uncertainty"
    )
