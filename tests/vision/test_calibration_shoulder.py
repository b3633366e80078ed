"""Camera and ranger on the shoulder: exact views give exact poses, noisy ones honest deviations."""

import math

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import CameraModel
from surfuse.rig.mounts import looking_outwards
from surfuse.vision.calibration_ranger import calibrate_shoulder_ranger
from surfuse.vision.calibration_shoulder import ShoulderParameters, calibrate_shoulder_camera
from surfuse.vision.calibration_target import Target, TargetView
from surfuse.vision.rays import pixels_of

CAMERA = CameraModel(500, 582, 520.0, 760.0, 252.0, 288.0, (-0.15, 0.05, 0.001, -0.001, 0.0))
TARGET = Target("charuco", 9, 7, 0.03)
TURN = rotation_about([0, 0, 1], 0.04) @ rotation_about([0, 1, 0], 0.03) @ rotation_about([1, 0, 0], -0.02)
TRUE = pose(TURN @ looking_outwards(0, 0)[:3, :3], [0.11, -0.02, 1.30])
BOARD = pose(rotation_about([0, 0, 1], 0.5) @ np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), [0.9, 0.55, 1.42])
CORNER = transform_points(BOARD, TARGET.points()[:1])[0]
ANGLES = np.radians([10.0, 16.0, 22.0, 28.0, 34.0, 40.0, 46.0])


def views(angles=ANGLES, noise=0.0, seed=0):
    g = np.random.default_rng(seed)
    shots = []
    for i, angle in enumerate(angles):
        world_from_camera = pose(rotation_about([0, 0, 1], angle), np.zeros(3)) @ TRUE
        pixels = pixels_of(CAMERA, transform_points(inverse(world_from_camera) @ BOARD, TARGET.points()))
        inside = np.flatnonzero(np.all((pixels > 0) & (pixels < [499, 581]), axis=1))
        shots.append(TargetView(f"v{i}", pixels[inside] + g.normal(0, noise, (len(inside), 2)), inside, 2.0))
    return tuple(shots)


def test_exact_views_give_the_exact_pose():
    found = calibrate_shoulder_camera(CAMERA, TARGET, views(), ANGLES, CORNER)
    assert found.shoulder_from_camera == pytest.approx(TRUE, abs=1e-6)
    assert found.world_from_target == pytest.approx(BOARD, abs=1e-6)
    assert found.reprojection_px < 1e-4


def test_stated_deviations_are_honest():
    errors, sigmas = [], []
    for seed in range(20):
        found = calibrate_shoulder_camera(CAMERA, TARGET, views(noise=0.1, seed=seed), ANGLES, CORNER)
        turned = found.shoulder_from_camera[:3, :3] @ TRUE[:3, :3].T
        turn = [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
        errors.append(np.concatenate([found.shoulder_from_camera[:3, 3] - TRUE[:3, 3], 0.5 * np.array(turn)]))
        sigmas.append(found.sigma)
    ratio = np.sqrt(np.mean(np.square(np.array(errors) / np.array(sigmas)), axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.5))
    assert np.mean(sigmas, axis=0)[:3].max() < 0.004


def test_wrong_sign_of_the_joint_is_refused():
    with pytest.raises(DataError, match="their sign"):
        calibrate_shoulder_camera(CAMERA, TARGET, views(), -ANGLES, CORNER)


def test_too_few_views_and_too_small_turns_are_refused():
    with pytest.raises(DataError, match="3 pictures, at least 4"):
        calibrate_shoulder_camera(CAMERA, TARGET, views()[:3], ANGLES[:3], CORNER)
    near = np.radians([20.0, 21.0, 22.0, 23.0])
    with pytest.raises(DataError, match=r"3\.0 degrees"):
        calibrate_shoulder_camera(CAMERA, TARGET, views(near), near, CORNER)
    with pytest.raises(DataError, match="does not move"):
        calibrate_shoulder_camera(CAMERA, TARGET, views()[:1] * 4, ANGLES[:4], CORNER)


def test_noisy_views_that_determine_nothing_are_refused():
    strict = ShoulderParameters(position_sigma_max_m=0.002)
    with pytest.raises(DataError, match="mm"):
        calibrate_shoulder_camera(CAMERA, TARGET, views(ANGLES[:4], noise=0.5), ANGLES[:4], CORNER, strict)


def ranges(place, angles=ANGLES, noise=0.0):
    g = np.random.default_rng(0)
    normal, ahead = BOARD[:3, 2], BOARD[:3, 2] @ BOARD[:3, 3]
    there = np.array([rotation_about([0, 0, 1], angle) @ place for angle in angles])
    return ahead - there @ normal + g.normal(0, noise, len(angles))


def test_ranger_is_where_its_ranges_say():
    place = np.array([0.13, 0.03, 1.2])
    heard = ranges(place)
    found = calibrate_shoulder_ranger(BOARD, ANGLES, heard, 1.2)
    assert found.forward_left_m == pytest.approx(place[:2], abs=1e-9)
    missing = heard.copy()
    missing[[0, 3]] = np.inf, np.nan
    missing[5] -= 0.2
    again = calibrate_shoulder_ranger(BOARD, ANGLES, missing, 1.2)
    assert again.forward_left_m == pytest.approx(place[:2], abs=1e-9)
    assert again.ranges == 4
    noisy = calibrate_shoulder_ranger(BOARD, ANGLES, ranges(place, noise=0.001), 1.2)
    assert np.all(np.abs(noisy.forward_left_m - place[:2]) < 4.0 * noisy.sigma_m)


def test_ranges_that_are_all_too_long_move_the_ranger_by_less_than_the_stated_deviation():
    place = np.array([0.13, 0.03, 1.2])
    for share in (0.995, 1.005):
        found = calibrate_shoulder_ranger(BOARD, ANGLES, share * ranges(place), 1.2)
        off = np.abs(found.forward_left_m - place[:2])
        assert off[0] > 1e-3
        assert np.all(off <= 1.02 * found.sigma_m)


def test_ranger_without_ranges_is_refused():
    with pytest.raises(DataError, match="3 usable ranges"):
        calibrate_shoulder_ranger(BOARD, ANGLES[:3], ranges(np.array([0.1, 0.0, 1.2]), ANGLES[:3]), 1.2)
    with pytest.raises(DataError, match="0 usable"):
        calibrate_shoulder_ranger(BOARD, ANGLES, np.full(7, math.inf), 1.2)
