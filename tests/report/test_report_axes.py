import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.records import SkippedStop
from surfuse.report.axes import AxesFrame, round_ticks
from surfuse.report.content import FoundPartView, PlanView
from surfuse.report.plan_drawing import plan_chart, skipped_reasons
from surfuse.report.search_drawing import histogram_chart, jpeg, search_image


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 12))
def test_ticks_are_round_even_and_inside(low, span, about):
    high = low + span
    if not high > low + 1e-9 * abs(low):
        return
    ticks = round_ticks(low, high, about)
    assert 1 <= len(ticks) <= 2.6 * about + 2
    assert all(low - 1e-6 * span <= tick <= high + 1e-6 * span for tick in ticks)
    if len(ticks) > 1:
        step = ticks[1] - ticks[0]
        lead = step / 10 ** math.floor(math.log10(step) + 1e-9)
        assert min(abs(lead - good) for good in (1, 2, 5, 10)) < 1e-3


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_ticks_of_no_range_are_harmless(low, high):
    assert len(round_ticks(low, high)) <= 1


def test_frame_puts_u_to_the_right_and_v_up():
    frame = AxesFrame(0.0, 10.0, 0.0, 5.0, 20.0, 30.0, 100.0, 50.0)
    assert (frame.x(0.0), frame.x(10.0)) == (20.0, 120.0)
    assert (frame.y(0.0), frame.y(5.0)) == (80.0, 30.0)


def plan(**more):
    square = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
    return PlanView(square, np.array([[-0.1, 0.0], [0.0, 0.0], [0.1, 0.0]]), **more)


def labels(svg):
    root = ET.fromstring(str(svg))
    return [node.text for node in root.iter("text")]


def test_plan_is_well_formed_with_units_on_both_axes():
    names = labels(plan_chart(plan()))
    assert "u (mm)" in names
    assert "v (mm)" in names
    assert "−100" in names
    assert "200" in names


def test_plan_has_one_scale_for_both_axes():
    wide = PlanView(np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.1]]), np.zeros((0, 2)))
    root = ET.fromstring(str(plan_chart(wide)))
    frame = next(node for node in root.iter("rect") if node.get("class") == "frame")
    assert 300 < float(frame.get("width")) < 700
    pad = 2 * 0.06 * 400
    assert float(frame.get("width")) / float(frame.get("height")) == pytest.approx((400 + pad) / (100 + pad), rel=1e-3)


def test_every_skipped_stop_says_why():
    view = plan(skipped=(SkippedStop(0.0, 0.1, "a<b>"), SkippedStop(0.1, 0.1, "far"), SkippedStop(0.2, 0.1, "far")))
    root = ET.fromstring(str(plan_chart(view)))
    assert [node.text for node in root.iter("title")] == ["a<b>", "far", "far"]
    assert skipped_reasons(view) == [("far", 2), ("a<b>", 1)]


def test_plan_without_stops_or_with_nan_still_draws():
    nothing = np.zeros((0, 2))
    ET.fromstring(str(plan_chart(PlanView(nothing, nothing))))
    ET.fromstring(str(plan_chart(PlanView(nothing, np.array([[np.nan, 0.0]])))))


def test_search_image_is_the_picture_in_true_proportions(synthetic):
    import cv2

    part = synthetic.found_part(np.random.default_rng(0))
    root = ET.fromstring(str(search_image(part, 5000)))
    _, _, width, height = (float(text) for text in root.get("viewBox").split())
    assert width / height == pytest.approx(1.552 * 500 / 582)
    assert len(list(root.iter("circle"))) == 4
    back = cv2.imdecode(np.frombuffer(jpeg(part.image, 5000), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert back.shape == part.image.shape
    assert np.abs(back.astype(float) - part.image).mean() < 4.0


def test_large_images_are_made_smaller():
    import cv2

    back = cv2.imdecode(np.frombuffer(jpeg(np.zeros((2000, 1000), np.uint8), 500), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert back.shape == (500, 250)


def test_histogram_is_left_out_when_there_is_none():
    assert histogram_chart(FoundPartView("p", np.zeros((2, 2), np.uint8))) is None


@pytest.mark.parametrize("threshold", [None, 0, 255])
def test_histogram_names_its_threshold(threshold):
    part = FoundPartView("p", np.zeros((2, 2), np.uint8), threshold=threshold, histogram=np.arange(256))
    names = labels(histogram_chart(part))
    assert (f"threshold {threshold}" in names) == (threshold is not None)
