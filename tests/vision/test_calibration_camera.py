"""Calibration of the camera from views that the twin takes, and sets of views that cannot determine it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.records import CameraModel
from surfuse.rig.simulated.board_pictures import seen_board
from surfuse.vision.calibration_camera import CalibrationParameters, calibrate_camera, view_error
from surfuse.vision.calibration_target import NotSeen, Target, TargetView, look_for
from surfuse.vision.rays import pixels_of

CAMERA = CameraModel(500, 582, 520.0, 760.0, 262.0, 280.0, (-0.16, 0.05, 0.001, -0.001, 0.0))
SIZE = (500, 582)
BOARD = Target("checkerboard", 9, 7, 0.03)
CHARUCO = Target("charuco", 7, 5, 0.04)


def place(target, x, y, tilt_x, tilt_y, spin=0.1, distance=0.55):
    turn = rotation_about([0, 0, 1], spin) @ rotation_about([1, 0, 0], tilt_x) @ rotation_about([0, 1, 0], tilt_y)
    return pose(turn, np.array([x, y, distance]) - turn @ target.points().mean(axis=0))


PLACES = [
    (-0.05, -0.05, 0.4, 0.0),
    (0.05, -0.05, -0.4, 0.1),
    (-0.05, 0.05, 0.0, 0.45),
    (0.05, 0.05, 0.1, -0.45),
    (0.0, 0.0, 0.35, 0.35),
    (0.02, -0.02, -0.3, 0.3),
    (-0.06, 0.0, 0.3, -0.3),
    (0.06, 0.0, -0.2, -0.2),
]


def exact(target, places=PLACES, noise=0.05, camera=CAMERA, seed=0):
    """Views of corners that were computed, not rendered."""
    g = np.random.default_rng(seed)
    views = []
    for i, where in enumerate(places):
        pixels = pixels_of(camera, transform_points(place(target, *where), target.points()))
        views.append(TargetView(f"v{i}", pixels + g.normal(0, noise, pixels.shape), np.arange(len(pixels)), 2.0))
    return tuple(views)


def picture(target, where, camera=CAMERA, seed=0):
    return seen_board(camera, target, place(target, *where), np.random.default_rng(seed))


@pytest.mark.parametrize("target", [BOARD, CHARUCO])
def test_camera_comes_back_from_pictures(target):
    seen = tuple(look_for(target, picture(target, where), f"v{i}") for i, where in enumerate(PLACES))
    assert all(isinstance(view, TargetView) for view in seen)
    found = calibrate_camera(target, seen, SIZE)
    for name in ("fx_px", "fy_px", "cx_px", "cy_px"):
        error = abs(getattr(found.camera, name) - getattr(CAMERA, name))
        assert error < 5.0 * getattr(found.sigma, name) + 0.2
        assert error < 2.0
    for value, true, sigma in zip(found.camera.distortion, CAMERA.distortion, found.sigma.distortion, strict=True):
        assert abs(value - true) <= 5.0 * sigma + 0.001
    assert found.reprojection_px < 0.15
    assert 0.25 < found.coverage < 1.0


def test_corners_are_where_they_are():
    for target in (BOARD, CHARUCO):
        view = look_for(target, picture(target, PLACES[4]), "v")
        truth = pixels_of(CAMERA, transform_points(place(target, *PLACES[4]), target.points()))
        assert np.abs(view.corners_px - truth[view.numbers]).max() < 0.25
        assert 1.5 < view.edge_px < 4.0


def test_stated_deviations_are_honest():
    errors, sigmas = [], []
    for seed in range(20):
        found = calibrate_camera(BOARD, exact(BOARD, noise=0.1, seed=seed), SIZE)
        errors.append([getattr(found.camera, n) - getattr(CAMERA, n) for n in ("fx_px", "fy_px", "cx_px", "cy_px")])
        sigmas.append([getattr(found.sigma, n) for n in ("fx_px", "fy_px", "cx_px", "cy_px")])
    ratio = np.sqrt(np.mean(np.square(np.array(errors) / np.array(sigmas)), axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.6))


def test_lens_models():
    straight = replace(CAMERA, distortion=(0.0,) * 5)
    found = calibrate_camera(BOARD, exact(BOARD, camera=straight), SIZE, CalibrationParameters(lens="none"))
    assert found.camera.distortion == (0.0,) * 5
    assert found.sigma.distortion == (0.0,) * 5
    found = calibrate_camera(BOARD, exact(BOARD), SIZE, CalibrationParameters(lens="radial"))
    assert found.camera.distortion[2:] == (0.0, 0.0, 0.0)
    with pytest.raises(ConfigError, match="usual"):
        CalibrationParameters(lens="usuall")


def test_too_few_views():
    with pytest.raises(DataError, match="4 usable views, at least 5"):
        calibrate_camera(BOARD, exact(BOARD, PLACES[:4]), SIZE)
    with pytest.raises(DataError, match="v9: no board"):
        calibrate_camera(BOARD, (*exact(BOARD, PLACES[:4]), NotSeen("v9", "no board")), SIZE)


def test_identical_views_count_once():
    views = exact(BOARD, PLACES[:4])
    again = tuple(replace(view, name=f"copy of {view.name}") for view in views)
    with pytest.raises(DataError, match="the same view as v0"):
        calibrate_camera(BOARD, (*views, *again), SIZE)


def test_blurred_views_are_left_out():
    image = picture(BOARD, PLACES[0])
    sharp = look_for(BOARD, image, "sharp")
    blurred = look_for(BOARD, np.asarray(cv2.GaussianBlur(image, (0, 0), 3.5)), "blurred")
    assert isinstance(blurred, NotSeen) or blurred.edge_px > 2.0 * sharp.edge_px
    soft = tuple(replace(view, edge_px=9.0) for view in exact(BOARD))
    with pytest.raises(DataError, match=r"blurred: edges 9\.0 px"):
        calibrate_camera(BOARD, soft, SIZE)
    one = replace(exact(BOARD)[0], edge_px=5.9)
    found = calibrate_camera(BOARD, (one, *exact(BOARD)[1:]), SIZE)
    assert found.left_out[0].reason.startswith("blurred")


def test_frontal_views_are_refused():
    flat = [(x, y, 0.0, 0.0, spin, d) for x, y, spin, d in
            [(-0.05, 0, 0, 0.5), (0.05, 0, 0.3, 0.6), (0, 0.05, -0.3, 0.7), (0, -0.05, 0.1, 0.55), (0, 0, 0.2, 0.8),
             (0.03, 0.03, -0.2, 0.65)]]  # fmt: skip
    with pytest.raises(DataError, match=r"parallel within|uncertain|converge"):
        calibrate_camera(BOARD, exact(BOARD, flat), SIZE)


def test_small_boards_far_away_leave_the_camera_uncertain():
    far = [(x, y, a, b, 0.1, 3.0) for x, y, a, b in PLACES]
    with pytest.raises(DataError, match="uncertain"):
        calibrate_camera(BOARD, exact(BOARD, far, noise=0.3), SIZE)


def test_two_cameras_in_one_set_are_refused():
    other = replace(CAMERA, fx_px=600.0, cx_px=200.0)
    with pytest.raises(DataError, match="one camera"):
        calibrate_camera(BOARD, (*exact(BOARD, PLACES[:4]), *exact(BOARD, PLACES[4:], camera=other)), SIZE)


def test_mirrored_markers_are_named():
    image = picture(CHARUCO, PLACES[0])
    seen = look_for(CHARUCO, np.ascontiguousarray(image[:, ::-1]), "v")
    assert isinstance(seen, NotSeen)
    assert "mirror" in seen.reason


def test_one_mirrored_checkerboard_is_refused():
    views = exact(BOARD)
    corners = views[2].corners_px.reshape(6, 8, 2)[:, ::-1].reshape(-1, 2)
    flipped = replace(views[2], corners_px=np.column_stack([499.0 - corners[:, 0], corners[:, 1]]))
    with pytest.raises(DataError, match=r"v2 seems to be mirrored|one camera"):
        calibrate_camera(BOARD, (*views[:2], flipped, *views[3:]), SIZE)


def test_error_of_a_view():
    (view,) = exact(BOARD, PLACES[:1], noise=0.0)
    assert view_error(CAMERA, BOARD, view) < 1e-3


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("charuko", 9, 7, 0.03), "charuco"),
        (("checkerboard", 3, 7, 0.03), "3 x 7"),
        (("charuco", 30, 30, 0.03), "250"),
        (("checkerboard", 9, 7, 0.0), "0 mm"),
    ],
)
def test_boards_that_cannot_be(arguments, word):
    with pytest.raises(ConfigError, match=word):
        Target(*arguments)
