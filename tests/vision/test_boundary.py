"""Boundaries: counts, centroids, holes, borders; edges between pixels."""

import cv2
import numpy as np
import pytest

from surfuse.vision.boundary import refine, trace


def disc(radius=40.3, centre=(70.4, 61.7), shape=(130, 140), blur=1.0, low=40.0, high=200.0):
    """A bright disc as a camera sees it: each pixel collects light over its area, then blur."""
    fine = 8
    y, x = ((np.arange(size * fine) + 0.5) / fine - 0.5 for size in shape)
    inside = np.hypot(x[None, :] - centre[0], y[:, None] - centre[1]) <= radius
    share = inside.reshape(shape[0], fine, shape[1], fine).mean(axis=(1, 3))
    image = cv2.GaussianBlur((low + (high - low) * share).astype(np.float32), (0, 0), blur)
    return np.rint(image).astype(np.uint8)


def blob(seed):
    generator = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(generator.normal(size=(90, 110)).astype(np.float32), (0, 0), 9.0)
    mask = (rough > 0.02).astype(np.uint8)
    mask[:2], mask[-2:], mask[:, :2], mask[:, -2:] = 0, 0, 0, 0
    return cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))


@pytest.mark.parametrize("seed", range(5))
def test_area_and_centroid_equal_those_of_the_pixels(seed):
    mask = blob(seed)
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    regions = trace(mask, 1.0)
    assert len(regions) == count - 1
    for region in regions:
        x, y = region.contour_px[0].astype(int)
        label = labels[y, x]
        assert region.area_px == pytest.approx(stats[label, cv2.CC_STAT_AREA], rel=0.03)
        assert region.centroid_px == pytest.approx(centroids[label], abs=0.7)
    assert [r.area_px for r in regions] == sorted((r.area_px for r in regions), reverse=True)


def test_rectangle_with_a_hole_is_counted_exactly():
    mask = np.zeros((60, 80), np.uint8)
    mask[10:40, 20:70] = 1
    mask[15:25, 30:50] = 0
    (region,) = trace(mask, 20.0)
    assert region.area_px == 30 * 50 - 10 * 20
    expected = np.argwhere(mask)[:, ::-1].mean(axis=0)
    assert region.centroid_px == pytest.approx(expected)
    assert len(region.holes_px) == 1
    assert not region.touches_border
    assert trace(mask, 250.0)[0].holes_px == ()


@pytest.mark.parametrize("where", [np.s_[0:20, 10:30], np.s_[10:30, 0:20], np.s_[30:50, 10:30], np.s_[10:30, 40:60]])
def test_regions_at_the_border_are_marked(where):
    mask = np.zeros((50, 60), np.uint8)
    mask[where] = 255
    assert trace(mask, 10.0)[0].touches_border


def test_specks_are_left_out():
    mask = np.zeros((50, 50), np.uint8)
    mask[10:13, 10:13] = 1
    mask[30:40, 30:40] = 1
    assert [region.area_px for region in trace(mask, 64.0)] == [100.0]
    assert trace(np.zeros((5, 5), np.uint8), 1.0) == ()


@pytest.mark.parametrize("bright", [True, False])
@pytest.mark.parametrize("blur", [0.6, 1.2])
def test_edge_of_a_disc_is_found_between_pixels(bright, blur):
    image = disc(blur=blur)
    image = image if bright else (255 - image).astype(np.uint8)
    mask = (image > 120 if bright else image < 135).astype(np.uint8)
    contour, edge = refine(image, trace(mask, 10.0)[0].contour_px, bright, 12.0)
    radius = np.hypot(*(contour - [70.4, 61.7]).T)
    assert edge.all()
    assert radius.mean() == pytest.approx(40.3, abs=0.05)
    assert radius.std() < 0.12


@pytest.mark.parametrize("level", [70, 120, 180])
def test_edge_does_not_move_with_the_threshold(level):
    image = disc(blur=1.0)
    contour, _ = refine(image, trace((image > level).astype(np.uint8), 10.0)[0].contour_px, True, 12.0)
    assert np.hypot(*(contour - [70.4, 61.7]).T).mean() == pytest.approx(40.3, abs=0.07)


def test_boundary_without_a_step_has_no_edge():
    flat = np.full((60, 60), 90, np.uint8)
    mask = np.zeros((60, 60), np.uint8)
    mask[20:40, 20:40] = 1
    contour = trace(mask, 10.0)[0].contour_px
    placed, edge = refine(flat, contour, True, 12.0)
    assert not edge.any()
    assert np.array_equal(placed, contour)


def test_long_contours_are_sampled_in_parts():
    mask = np.zeros((40, 9000), np.uint8)
    mask[10:30, 5:-5] = 1
    contour, edge = refine(mask * 200, trace(mask, 10.0)[0].contour_px, True, 12.0)
    assert len(contour) > 8192
    assert edge.mean() > 0.99
    assert contour[:, 1].max() == pytest.approx(29.5, abs=0.3)
