"""What stands on the table: ragged feet of things behind it, the table itself, parts cut by the picture."""

import cv2
import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL
from surfuse.errors import ConfigError
from surfuse.geometry.poses import inverse, pose, transform_points
from surfuse.records import CameraFrame, Detection
from surfuse.vision.rays import pixels_of
from surfuse.vision.standing_parts import StandingParameters, on_table
from surfuse.vision.table import TableRing, edge_rows, foot_rows

HEIGHT, WIDTH = REFERENCE_MODEL.height_px, REFERENCE_MODEL.width_px
POSE = pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), [0.1, 0.0, 1.3])
EMPTY = CameraFrame(np.zeros((HEIGHT, WIDTH), np.uint8), 0.0, REFERENCE_MODEL, POSE)
FAR = foot_rows(EMPTY, np.array([250.0, 400.0]), TableRing())[0]


def seen(corners):
    """Detection of a polygon (K, 2), its contour sampled every pixel, and the picture: table before a dark room."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [np.rint(corners).astype(np.int32).reshape(-1, 1, 2)], 1)
    image = np.full((HEIGHT, WIDTH), 20, np.uint8)
    image[int(FAR) :] = 45
    image[mask > 0] = 180
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=len).reshape(-1, 2).astype(float)
    low, high = contour.min(axis=0), contour.max(axis=0)
    touches = bool(low.min() <= 0 or high[0] >= WIDTH - 1 or high[1] >= HEIGHT - 1)
    return Detection(contour, contour.mean(axis=0), float(mask.sum()), touches, 100, 1.0, 1.0), image


def stands(detection, image):
    return on_table(detection, EMPTY, image, TableRing(), StandingParameters())


def block(left, right, top, bottom):
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], dtype=float)


def test_foot_decides():
    assert stands(*seen(block(200, 260, 300, FAR + 30)))
    assert not stands(*seen(block(200, 260, 300, FAR - 20)))
    assert not stands(*seen(block(200, 260, 300, FAR)))


@pytest.mark.parametrize("level", [60, 75])
def test_threads_of_noise_do_not_put_a_thing_behind_the_table_onto_it(level):
    upper = block(200, 260, 300, FAR)
    with_thread = np.vstack([upper[:3], [[226, FAR], [226, FAR + 12], [220, FAR + 12], [220, FAR]], upper[3:]])
    detection, image = seen(with_thread)
    assert stands(detection, image)
    image[int(FAR) + 1 :, 220:227] = level
    assert not stands(detection, image)


@pytest.mark.parametrize(("level", "down"), [(65, False), (180, True)], ids=["hardly different", "clearly different"])
def test_the_foot_of_what_is_hardly_different_is_not_a_thread(level, down):
    """A narrow foot of a bright thing is a foot; of a faint one it may be noise that hangs down."""
    upper = block(200, 260, 300, FAR)
    narrow = np.vstack([upper[:3], [[226, FAR], [226, FAR + 12], [220, FAR + 12], [220, FAR]], upper[3:]])
    for corners, expected in ((narrow, down), (block(200, 260, 300, FAR + 12), True)):
        detection, image = seen(corners)
        image[image == 180] = level
        assert stands(detection, image) == expected


def test_dark_part_on_a_bright_table_is_decided_the_same_way():
    detection, image = seen(block(200, 260, 300, FAR + 30))
    assert stands(detection, 255 - image)


def test_lit_side_of_the_table_is_no_part():
    columns = np.arange(0.0, 321.0, 20.0)
    far = edge_rows(EMPTY, np.column_stack([columns, np.full(len(columns), FAR)]), TableRing())[:, 0]
    table = np.vstack([np.column_stack([columns, far]), [[320.0, HEIGHT - 1.0], [0.0, HEIGHT - 1.0]]])
    detection, image = seen(table)
    assert detection.touches_border
    assert not stands(detection, image)


def test_part_cut_by_the_side_is_one():
    detection, image = seen(block(0, 80, 300, FAR + 30))
    assert detection.touches_border
    assert stands(detection, image)


def test_edge_rows_lie_on_the_edges_of_the_table():
    angle = np.linspace(-0.25, 0.25, 9)
    for edge, radius in ((0, 1.25), (1, 0.95)):
        ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(9, 1.0)])
        pixels = pixels_of(REFERENCE_MODEL, transform_points(inverse(POSE), ring))
        assert edge_rows(EMPTY, pixels, TableRing())[:, edge] == pytest.approx(pixels[:, 1], abs=1e-6)


def test_no_edge_where_the_camera_looks_away():
    outside = POSE.copy()
    outside[0, 3] = 2.0
    frame = CameraFrame(EMPTY.image, 0.0, REFERENCE_MODEL, outside)
    assert np.isnan(edge_rows(frame, np.array([[250.0, 400.0], [10.0, 300.0]]), TableRing())).all()


@pytest.mark.parametrize("values", [{"behind_px": -1.0}, {"foot_slack_px": float("inf")}, {"along_edge_max": 1.5}])
def test_impossible_parameters_are_refused(values):
    with pytest.raises(ConfigError):
        StandingParameters(**values)


def test_faint_thing_behind_the_table_ends_where_it_is_wide():
    upper = block(200, 290, 300, FAR)
    thread = [[246, FAR], [246, FAR + 25], [240, FAR + 25], [240, FAR]]
    detection, image = seen(np.vstack([upper[:3], thread, upper[3:]]))
    image[(image == 180)] = 90
    image[int(FAR) + 1 :, 240:247] = 65
    assert not stands(detection, image)
