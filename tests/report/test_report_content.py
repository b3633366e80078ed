from dataclasses import replace

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.report.content import ComparisonContent, FoundPartView, PlanView, ReportContent, Scenery, plan_view


def test_title_is_the_only_thing_needed():
    content = ReportContent(title="x")
    assert content.maps == ()
    assert content.truth is None
    assert "safety" in content.safety


@pytest.mark.parametrize("title", ["", "  \n"])
def test_empty_titles_are_refused(title):
    with pytest.raises(DataError):
        ReportContent(title=title)
    with pytest.raises(DataError):
        ComparisonContent(title=title, scenes=())


def test_points_of_another_scan_are_refused(run_content, synthetic):
    _, other = synthetic.scan(np.random.default_rng(0), step_m=0.02)
    with pytest.raises(DataError, match=r"ReportContent\.points"):
        replace(run_content, points=other)


def test_arm_of_another_scan_is_refused(run_content):
    with pytest.raises(DataError, match="arm_m"):
        replace(run_content, arm_m=run_content.arm_m[:-1])
    with pytest.raises(DataError, match="arm_m"):
        replace(run_content, arm_m=np.zeros((3, 2)))


def test_arrays_are_copies_that_cannot_be_written():
    outline = np.zeros((3, 2))
    plan = PlanView(outline, np.zeros((1, 2)))
    outline[0, 0] = 9.0
    assert plan.outline_m[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        plan.outline_m[0, 0] = 1.0


@pytest.mark.parametrize("image", [np.zeros((4, 4)), np.zeros((4, 4, 3), np.uint8), np.zeros((0, 4), np.uint8)])
def test_only_grey_images_are_taken(image):
    with pytest.raises(DataError, match="grey uint8"):
        FoundPartView("p", image)


def test_found_part_checks_its_numbers():
    image = np.zeros((4, 4), np.uint8)
    with pytest.raises(DataError, match="pixel_aspect"):
        FoundPartView("p", image, pixel_aspect=float("nan"))
    with pytest.raises(DataError, match="histogram"):
        FoundPartView("p", image, histogram=np.zeros(10, np.int64))
    with pytest.raises(DataError, match="contour_px"):
        FoundPartView("p", image, contour_px=np.zeros((5, 3)))


def test_scenery_checks_shapes():
    with pytest.raises(DataError, match="faces"):
        Scenery("table", np.zeros((3, 3)), np.zeros((1, 4), np.int64))


def test_plan_view_takes_stops_margin_and_reasons_from_the_plan():
    from surfuse.records import Outline, ScanPlan, SkippedStop

    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    plan = ScanPlan(
        world_from_grip=np.tile(np.eye(4), (2, 1, 1)),
        uv_m=np.array([[0.1, 0.2], [0.3, 0.2]]),
        row=np.zeros(2, dtype=np.int64),
        joints_rad=np.zeros((2, 6)),
        outline=Outline(1.2 * square, np.eye(4), margin_m=0.02),
        step_m=0.2,
        standoff_m=0.43,
        skipped=(SkippedStop(0.5, 0.5, "far"),),
    )
    view = plan_view(plan, square)
    assert np.array_equal(view.stops_m, plan.uv_m)
    assert np.array_equal(view.enlarged_m, 1.2 * square)
    assert (view.margin_m, view.step_m, view.skipped[0].reason) == (0.02, 0.2, "far")
