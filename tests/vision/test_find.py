"""Finding parts: what is one, what is none, and hostile pictures."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL
from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.records import CameraFrame
from surfuse.vision.flatten import flattened
from surfuse.vision.part_finder import FindParameters, find_parts, find_regions
from surfuse.vision.picture import read_picture
from surfuse.vision.table import TableRing, foot_rows
from surfuse.vision.threshold import METHODS

IMAGES = Path(__file__).parents[1] / "data" / "images"
HEIGHT, WIDTH = REFERENCE_MODEL.height_px, REFERENCE_MODEL.width_px
LEVEL_CAMERA = pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), [0.1, 0.0, 1.15])


def scene(parts=(), noise=2.0, seed=0, background=20.0, gradient=0.0):
    generator = np.random.default_rng(seed)
    image = np.full((HEIGHT, WIDTH), background)
    image[400:460] = background + 25.0
    for top, bottom, left, right, grey in parts:
        image[top:bottom, left:right] = grey
    image *= 1.0 + gradient * np.linspace(-0.5, 0.5, WIDTH)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + generator.normal(0.0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def frame(image):
    return CameraFrame(image, 0.0, REFERENCE_MODEL, LEVEL_CAMERA)


PART = (250, 415, 200, 300, 180.0)


@pytest.mark.parametrize("method", ["otsu", "minimum_error"])
@pytest.mark.parametrize("noise", [1.0, 12.0])
@pytest.mark.parametrize("gradient", [0.0, 0.8])
def test_part_on_the_table_is_found_alone(method, noise, gradient):
    (found,) = find_parts(frame(scene([PART], noise, gradient=gradient)), FindParameters(method), TableRing())
    assert found.centroid_px == pytest.approx([249.5, 332.0], abs=1.0)
    assert found.area_px == pytest.approx(165 * 100, rel=0.02)
    assert not found.touches_border
    assert found.confidence > 0.9
    low, high = found.contour_px.min(axis=0), found.contour_px.max(axis=0)
    assert low == pytest.approx([199.5, 249.5], abs=0.8)
    assert high == pytest.approx([299.5, 414.5], abs=0.8)


def test_small_part_is_found_under_noise_and_gradient():
    image = scene([(395, 415, 100, 116, 150.0)], noise=10.0, gradient=0.6)
    (found,) = find_parts(frame(image), table=TableRing())
    assert found.centroid_px == pytest.approx([107.5, 404.5], abs=1.0)


def test_every_part_in_the_picture_is_found_and_the_largest_comes_first():
    image = scene([PART, (350, 412, 60, 90, 120.0), (380, 410, 400, 430, 220.0)])
    found = find_parts(frame(image), table=TableRing())
    assert [round(part.centroid_px[0]) for part in found] == [250, 74, 414]


@pytest.mark.parametrize(
    "thing",
    [
        (50, 150, 200, 300, 180.0),
        (480, 560, 200, 300, 180.0),
        (100, 200, 0, 500, 180.0),
        (400, 460, 0, 500, 110.0),
    ],
)
def test_things_that_do_not_stand_on_the_table_are_no_parts(thing):
    assert find_parts(frame(scene([thing])), table=TableRing()) == ()
    assert len(find_parts(frame(scene([thing, PART])), table=TableRing())) == 1


def test_what_stands_behind_the_table_is_no_part():
    # The table hides its foot: it ends in the picture where the table's far edge is.
    far, _ = foot_rows(frame(scene()), np.array([250.0, 300.0]), TableRing())
    hidden = (200, int(far), 200, 300, 180.0)
    assert find_parts(frame(scene([hidden])), table=TableRing()) == ()
    standing = (200, int(far) + 6, 200, 300, 180.0)
    assert len(find_parts(frame(scene([standing])), table=TableRing())) == 1


def test_part_cut_by_the_side_is_marked():
    (found,) = find_parts(frame(scene([(250, 415, 0, 60, 180.0)])), table=TableRing())
    assert found.touches_border


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["black", "white", "noise", "wide noise", "ramp", "noisy ramp", "two levels of noise"])
def test_pictures_without_a_part_have_none(method, kind):
    generator = np.random.default_rng(4)
    shape = (HEIGHT, WIDTH)
    image = {
        "black": np.zeros(shape),
        "white": np.full(shape, 255.0),
        "noise": generator.normal(120.0, 13.0, shape),
        "wide noise": generator.uniform(0.0, 256.0, shape) // 1,
        "ramp": np.broadcast_to(np.linspace(0.0, 230.0, WIDTH), shape),
        "noisy ramp": np.linspace(0.0, 200.0, WIDTH) + generator.normal(0.0, 13.0, shape),
        "two levels of noise": 100.0 + generator.integers(0, 2, shape),
    }[kind]
    picture = np.clip(image, 0, 255).astype(np.uint8)
    assert find_regions(picture, FindParameters(method)) == ()
    assert find_parts(frame(picture), FindParameters(method), TableRing()) == ()


def test_dark_part_before_a_bright_wall():
    image = (255 - scene([PART])).astype(np.uint8)
    (found,) = find_regions(image[:395])
    assert found.centroid_px[0] == pytest.approx(249.5, abs=1.0)
    (wall,) = find_regions(image[:395], FindParameters(polarity="bright"))
    assert wall.touches_border
    assert len(wall.holes_px) == 0


def test_holes_are_kept():
    image = scene([PART, (300, 350, 230, 270, 20.0)])
    (found,) = find_parts(frame(image), table=TableRing())
    (hole,) = found.holes_px
    assert hole.min(axis=0) == pytest.approx([229.5, 299.5], abs=0.8)
    assert hole.max(axis=0) == pytest.approx([269.5, 349.5], abs=0.8)
    assert found.area_px == pytest.approx(165 * 100 - 50 * 40, rel=0.02)


def test_all_coins_of_the_photograph_and_the_horse():
    assert len(find_regions(read_picture(IMAGES / "coins.png"))) == 24
    (horse,) = find_regions(read_picture(IMAGES / "horse.png"))
    assert horse.area_px == pytest.approx(43440, rel=0.01)


def test_foot_rows_equal_the_geometry_of_a_level_camera():
    rows = foot_rows(frame(scene()), np.array([REFERENCE_MODEL.cx_px, 400.0]), TableRing())
    fall = 0.15
    expected = [REFERENCE_MODEL.cy_px + REFERENCE_MODEL.fy_px * fall / (radius - 0.1) for radius in (1.25, 0.95)]
    assert rows == pytest.approx(expected)


def test_foot_rows_are_unknown_for_a_camera_outside_that_looks_away():
    outside = LEVEL_CAMERA.copy()
    outside[0, 3] = 2.0
    assert foot_rows(CameraFrame(scene(), 0.0, REFERENCE_MODEL, outside), np.array([250.0, 400.0]), TableRing()) is None


def test_flattening_removes_a_quadratic_and_leaves_what_stands_out():
    y, x = np.meshgrid(np.linspace(-1, 1, 200), np.linspace(-1, 1, 240), indexing="ij")
    ground = 120 + 40 * x - 20 * y + 15 * x * y - 25 * x * x
    image = ground.copy()
    image[60:120, 80:150] += 60
    residual, noise = flattened(np.rint(image).astype(np.uint8))
    assert residual[65:115, 85:145].mean() == pytest.approx(60.0, abs=2.0)
    assert np.abs(residual[130:-8, 8:-8]).max() < 3.0
    assert noise < 1.0


@pytest.mark.parametrize(
    "values",
    [
        {"method": "otsi"},
        {"polarity": "brigt"},
        {"separability_min": 1.5},
        {"area_min_px": -1.0},
        {"blur_px": float("nan")},
    ],
)
def test_impossible_parameters_are_refused(values):
    with pytest.raises(ConfigError):
        FindParameters(**values)
    with pytest.raises(ConfigError):
        replace(FindParameters(), **values)


def test_impossible_table_is_refused():
    with pytest.raises(ConfigError):
        TableRing(1.0, 1.3, 1.2)


def test_part_joined_with_the_table_is_found_beside_one_that_is_not():
    # Half of the table is as bright as the dark part on it, so the first threshold takes both for one ragged region.
    image = scene([(300, 440, 440, 500, 200.0), (330, 415, 200, 250, 110.0)], noise=6.0)
    image[402:, :380] = np.clip(image[402:, :380].astype(int) + 45, 0, 255)
    found = find_parts(frame(image), table=TableRing())
    assert sorted(round(part.centroid_px[0]) for part in found) == [
        pytest.approx(225, abs=3),
        pytest.approx(469, abs=3),
    ]
