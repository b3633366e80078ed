"""A camera on the tool and a fixed one: exact views give the exact pose, noisy ones honest deviations."""

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import CameraModel
from surfuse.vision.calibration_hand_eye import calibrate_hand_eye
from surfuse.vision.calibration_target import Target, TargetView
from surfuse.vision.rays import pixels_of

CAMERA = CameraModel(640, 480, 600.0, 610.0, 322.0, 238.0, (-0.1, 0.02, 0.0, 0.0, 0.0))
TARGET = Target("checkerboard", 9, 7, 0.02)
DOWN = np.diag([1.0, -1.0, -1.0])
TOOL_FROM_CAMERA = pose(rotation_about([0, 0, 1], 0.4) @ rotation_about([1, 0, 0], 0.05), [0.06, -0.02, 0.03])
WORLD_FROM_CAMERA = pose(rotation_about([0, 0, 1], 0.3) @ DOWN @ rotation_about([1, 0, 0], 0.2), [0.4, 0.1, 1.0])
BOARD = pose(DOWN, [-0.08, 0.07, 0.02])  # its z points into the table
TOOL_FROM_BOARD = pose(rotation_about([0, 0, 1], 0.2), [-0.08, -0.06, 0.05]) @ pose(DOWN, [0.0, 0.12, 0.0])


def poses(count, fixed, tilt=0.35, seed=3):
    g = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        turn = rotation_about([1, 0, 0], g.uniform(-tilt, tilt)) @ rotation_about([0, 1, 0], g.uniform(-tilt, tilt))
        turn = rotation_about([0, 0, 1], g.uniform(-0.5, 0.5)) @ turn
        place = g.uniform(-0.03, 0.03, 3)
        middle = np.array([0.4, 0.0, 0.5] if fixed else [0.0, 0.0, 0.45])
        found.append(pose(turn if fixed else DOWN @ turn, middle + place))
    return np.array(found)


def views(world_from_tool, fixed, noise=0.0, seed=0):
    g = np.random.default_rng(seed)
    shots = []
    for k, tool in enumerate(world_from_tool):
        camera = WORLD_FROM_CAMERA if fixed else tool @ TOOL_FROM_CAMERA
        board = tool @ TOOL_FROM_BOARD if fixed else BOARD
        seen = transform_points(inverse(camera) @ board, TARGET.points())
        assert seen[:, 2].min() > 0.1
        pixels = pixels_of(CAMERA, seen)
        shots.append(TargetView(f"v{k}", pixels + g.normal(0.0, noise, pixels.shape), np.arange(len(pixels)), 2.0))
    return tuple(shots)


@pytest.mark.parametrize("fixed", [False, True])
def test_exact_views_give_the_exact_pose(fixed):
    tools = poses(8, fixed)
    found = calibrate_hand_eye(CAMERA, TARGET, views(tools, fixed), tools, fixed)
    wanted, board = (WORLD_FROM_CAMERA, TOOL_FROM_BOARD) if fixed else (TOOL_FROM_CAMERA, BOARD)
    np.testing.assert_allclose(found.carrier_from_camera, wanted, atol=1e-6)
    np.testing.assert_allclose(found.other_from_target, board, atol=1e-6)
    assert found.reprojection_px < 1e-4


def test_stated_deviations_are_honest():
    tools = poses(10, False)
    errors, sigmas = [], []
    for seed in range(20):
        found = calibrate_hand_eye(CAMERA, TARGET, views(tools, False, 0.1, seed), tools)
        errors.append(found.carrier_from_camera[:3, 3] - TOOL_FROM_CAMERA[:3, 3])
        sigmas.append(found.sigma[:3])
    ratio = np.sqrt(np.mean(np.square(np.array(errors) / np.array(sigmas)), axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.5))
    assert np.mean(sigmas, axis=0).max() < 0.001


def test_what_leaves_the_place_open_is_refused():
    tools = poses(8, False)
    with pytest.raises(DataError, match=r"found in 4 pictures, at least 5"):
        calibrate_hand_eye(CAMERA, TARGET, views(tools[:4], False), tools[:4])
    flat = poses(8, False, tilt=0.0)
    with pytest.raises(DataError, match=r"about one axis only .*tilt the tool"):
        calibrate_hand_eye(CAMERA, TARGET, views(flat, False), flat)
    with pytest.raises(DataError, match=r"px from where the result puts them .*each pose belongs to its picture"):
        calibrate_hand_eye(CAMERA, TARGET, views(tools, False), tools[::-1])
