"""Pixels to metres: round trips through the camera, distance from range and foot, honest deviations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import CameraFrame, Detection
from surfuse.vision.distance import Distance, ProjectionSigmas, ShoulderRange, measure_distance
from surfuse.vision.outline import outline_part
from surfuse.vision.projection import project_outline
from surfuse.vision.rays import camera_rays, pixels_of
from surfuse.vision.table_contact import foot_points

LENS = replace(REFERENCE_MODEL, distortion=(-0.09, 0.02, 0.001, -0.001, 0.003))
TABLE = 1.0


def shoulder_pose(azimuth=0.4, height=1.15, forward=0.1, pitch=0.0, roll=0.0):
    ahead = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    level = np.column_stack([right, [0.0, 0.0, -1.0], ahead])
    turned = level @ rotation_about([1.0, 0.0, 0.0], -pitch) @ rotation_about([0.0, 0.0, 1.0], roll)
    return pose(turned, forward * ahead + [0.0, 0.0, height])


def rectangle(width=0.2, height=0.2, aside=0.0, lift=0.0, per_side=80):
    """Boundary (N, 2) of a plate in metres, to the right and up from its foot, and its corner indices."""
    corners = np.array([[-width / 2, 0], [width / 2, 0], [width / 2, height], [-width / 2, height]])
    corners = corners + np.array([aside, lift])
    share = np.arange(per_side)[:, None] / per_side
    sides = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.vstack(sides), np.arange(4) * per_side


def seen(boundary, distance, camera=REFERENCE_MODEL, world_from_camera=None, yaw=0.0):
    """A frame and the detection of a boundary on an upright plane, turned about its middle by `yaw`."""
    world_from_camera = shoulder_pose() if world_from_camera is None else world_from_camera
    ahead = world_from_camera[:3, 2].copy()
    ahead[2] = 0.0
    ahead /= np.linalg.norm(ahead)
    right = np.array([ahead[1], -ahead[0], 0.0])
    along = math.cos(yaw) * right + math.sin(yaw) * ahead
    eye = world_from_camera[:3, 3]
    points = eye + distance * ahead + boundary[:, :1] * along
    points[:, 2] = TABLE + boundary[:, 1]
    pixels = pixels_of(camera, transform_points(inverse(world_from_camera), points))
    frame = CameraFrame(np.zeros((camera.height_px, camera.width_px), np.uint8), 0.0, camera, world_from_camera)
    centre = points.mean(axis=0)[None, :]
    centroid = pixels_of(camera, transform_points(inverse(world_from_camera), centre))[0]
    return frame, Detection(pixels, centroid, 1000.0, False, 100, 1.0, 1.0), centre[0]


def ranger(frame, distance, sigma=0.004, error=0.0):
    ahead = frame.world_from_camera[:3, 2].copy()
    ahead[2] = 0.0
    ahead /= np.linalg.norm(ahead)
    position = frame.world_from_camera[:3, 3] - 0.03 * ahead
    return ShoulderRange(position, ahead, distance + 0.03 + error, sigma)


@pytest.mark.parametrize("camera", [REFERENCE_MODEL, LENS])
def test_rays_and_pixels_are_inverse(camera):
    pixels = np.array([[0.0, 0.0], [499.0, 581.0], [250.0, 290.0], [31.4, 500.2]])
    assert pixels_of(camera, camera_rays(camera, pixels) * 1.7) == pytest.approx(pixels, abs=2e-3)


@pytest.mark.parametrize("camera", [REFERENCE_MODEL, LENS])
@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.1, 0.0), (-0.05, 0.04)])
@pytest.mark.parametrize("aside", [0.0, 0.12])
@pytest.mark.parametrize("with_range", [True, False])
def test_outline_of_a_plate_is_its_rectangle(camera, pitch, roll, aside, with_range):
    boundary, _ = rectangle(aside=aside)
    frame, detection, centre = seen(boundary, 0.95, camera, shoulder_pose(pitch=pitch, roll=roll))
    found = outline_part(frame, detection, TABLE, ranger(frame, 0.95) if with_range else None)
    assert found.distance.distance_m == pytest.approx(0.95, abs=2e-3)
    vertices = found.outline.vertices_m
    assert len(vertices) == 4
    expected = {(-0.1, 0.0), (0.1, 0.0), (0.1, 0.2), (-0.1, 0.2)}
    for vertex in vertices:
        assert min(math.dist(vertex, corner) for corner in expected) < 1.5e-3
    x, y = vertices.T
    assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0.0
    origin = found.outline.world_from_part[:3, 3]
    assert origin == pytest.approx([centre[0], centre[1], TABLE], abs=3e-3)
    u, v, w = found.outline.world_from_part[:3, :3].T
    assert v == pytest.approx([0, 0, 1])
    assert np.cross(v, w) == pytest.approx(u)
    ahead = frame.world_from_camera[:3, 2]
    assert w[:2] @ ahead[:2] == pytest.approx(-np.linalg.norm(ahead[:2]))


def test_wrong_range_is_weighed_against_the_foot_and_a_contradiction_widens_sigma():
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95)
    agreeing = measure_distance(frame, detection.contour_px, corners, TABLE, ranger(frame, 0.95))
    wrong = measure_distance(frame, detection.contour_px, corners, TABLE, ranger(frame, 0.95, error=0.15))
    assert agreeing.disagreement < 0.2
    assert agreeing.sigma_m < min(agreeing.range_sigma_m, agreeing.foot_sigma_m)
    assert wrong.disagreement > 3.0
    assert wrong.sigma_m > 2.0 * agreeing.sigma_m
    assert wrong.foot_m < wrong.distance_m < wrong.range_m
    weights = 1 / wrong.range_sigma_m**2, 1 / wrong.foot_sigma_m**2
    mean = (weights[0] * wrong.range_m + weights[1] * wrong.foot_m) / sum(weights)
    assert wrong.distance_m == pytest.approx(mean)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_range_that_is_no_number_says_nothing(value):
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95)
    silent = replace(ranger(frame, 0.95), range_m=value)
    distance = measure_distance(frame, detection.contour_px, corners, TABLE, silent)
    assert math.isnan(distance.range_m)
    assert math.isnan(distance.disagreement)
    assert distance.distance_m == pytest.approx(distance.foot_m)


def test_without_range_and_foot_the_distance_is_unknown():
    boundary, corners = rectangle()
    low = shoulder_pose(height=TABLE - 0.05)
    frame, detection, _ = seen(boundary, 0.95, world_from_camera=low)
    with pytest.raises(DataError, match="distance of the part is unknown"):
        measure_distance(frame, detection.contour_px, corners, TABLE, None)
    ranged = outline_part(frame, detection, TABLE, ranger(frame, 0.95))
    assert ranged.outline.vertices_m[:, 1].max() == pytest.approx(0.2, abs=2e-3)


def test_foot_below_the_picture_leaves_the_range_and_the_known_height():
    boundary, _ = rectangle(height=0.25)
    frame, detection, _ = seen(boundary, 0.95, world_from_camera=shoulder_pose(height=1.5))
    contour = np.minimum(detection.contour_px, [499.0, 581.0])
    cut = replace(detection, contour_px=contour, touches_border=True)
    found = outline_part(frame, cut, TABLE, ranger(frame, 0.95))
    assert math.isnan(found.distance.foot_m)
    assert found.outline.vertices_m[:, 1].max() == pytest.approx(0.25, abs=2e-3)


def test_turned_plate_gives_the_distance_of_its_middle():
    boundary, corners = rectangle()
    yaw = math.radians(20.0)
    frame, detection, _ = seen(boundary, 0.95, yaw=yaw)
    distance = measure_distance(frame, detection.contour_px, corners, TABLE, None)
    assert distance.foot_m == pytest.approx(0.95, abs=5e-3)
    spread = 0.2 * math.sin(yaw) / math.sqrt(12.0)
    assert distance.relief_m == pytest.approx(math.hypot(spread, ProjectionSigmas().relief_m), rel=0.1)
    found = outline_part(frame, detection, TABLE)
    width = np.ptp(found.outline.vertices_m[:, 0])
    assert width == pytest.approx(0.2 * math.cos(yaw), abs=3e-3)


@pytest.mark.parametrize("yaw_deg", [-55.0, 40.0, 55.0])
def test_the_foot_of_a_plate_that_is_turned_far_is_still_its_whole_lower_edge(yaw_deg):
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95, yaw=math.radians(yaw_deg))
    distance = measure_distance(frame, detection.contour_px, corners, TABLE, None)
    # Its nearest corner is 3 to 8 cm nearer.
    assert distance.foot_m == pytest.approx(0.95, abs=0.01)


def test_foot_of_a_round_part_is_its_lowest_point():
    angle = 2 * np.pi * np.arange(400) / 400
    boundary = 0.08 * np.column_stack([np.cos(angle), np.sin(angle) + 1.0])
    frame, detection, _ = seen(boundary, 1.0)
    found = outline_part(frame, detection, TABLE)
    foot = foot_points(frame.camera, detection.contour_px, found.dominant.indices)
    rows = detection.contour_px[:, 1]
    assert rows[foot].min() >= rows.max() - 1.5 - 1e-9
    assert found.outline.vertices_m[:, 1].min() == pytest.approx(0.0, abs=2e-3)


def test_sigma_is_what_repeated_measurements_scatter():
    """Monte Carlo over the named errors of a flat plate, against the deviation that the outline states."""
    generator = np.random.default_rng(0)
    sigmas = ProjectionSigmas(
        pixel_px=0.3, focal=0.003, pitch_rad=0.002, height_m=0.001, range_share=0.005, relief_m=0.0
    )
    boundary, _ = rectangle(0.24, 0.22)
    truth = np.array([[-0.12, 0.0], [0.12, 0.0], [0.12, 0.22], [-0.12, 0.22]])
    errors, stated = [], []
    for _ in range(150):
        focal = 1.0 + sigmas.focal * generator.normal()
        camera = replace(REFERENCE_MODEL, fx_px=520.0 * focal, fy_px=760.0 * focal)
        pitch, height = sigmas.pitch_rad * generator.normal(), sigmas.height_m * generator.normal()
        real = shoulder_pose(pitch=pitch, height=1.15 + height)
        frame, detection, _ = seen(boundary, 0.95, camera, real)
        believed = CameraFrame(frame.image, 0.0, REFERENCE_MODEL, shoulder_pose())
        noisy = detection.contour_px + sigmas.pixel_px * generator.normal(size=detection.contour_px.shape)
        error = generator.normal() * math.hypot(0.004, sigmas.range_share * 0.98)
        found = outline_part(
            believed, replace(detection, contour_px=noisy), TABLE, ranger(believed, 0.95, error=error), sigmas=sigmas
        )
        for corner in truth:
            nearest = int(np.argmin(np.hypot(*(found.outline.vertices_m - corner).T)))
            errors.append(np.abs(found.outline.vertices_m[nearest] - corner).max())
            stated.append(found.outline.sigma_m[nearest])
    ratio = np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(stated)))
    assert 0.5 < ratio < 1.5


def test_holes_and_columns_as_unit_of_the_tolerance():
    boundary, _ = rectangle()
    frame, detection, _ = seen(boundary, 0.95)
    hole, _ = rectangle(0.05, 0.05, 0.02, 0.1)
    with_hole = replace(detection, holes_px=(seen(hole, 0.95)[1].contour_px,))
    found = outline_part(frame, with_hole, TABLE)
    (metres,) = found.outline.holes_m
    assert metres.min(axis=0) == pytest.approx([-0.005, 0.1], abs=2e-3)
    assert metres.max(axis=0) == pytest.approx([0.045, 0.15], abs=2e-3)


def test_camera_that_looks_down_is_refused():
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95)
    down = CameraFrame(frame.image, 0.0, frame.camera, pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 2.0]))
    with pytest.raises(DataError, match="straight up or down"):
        measure_distance(down, detection.contour_px, corners, TABLE, None)


def test_impossible_deviations_are_refused():
    with pytest.raises(ConfigError):
        ProjectionSigmas(pixel_px=-1.0)
    with pytest.raises(ConfigError):
        ProjectionSigmas(focal=math.nan)


def test_upwards_two_pixels_count_the_corner_s_and_the_foot_s():
    square = replace(REFERENCE_MODEL, fx_px=600.0, fy_px=600.0)
    only_pixels = ProjectionSigmas(pixel_px=0.3, focal=0.0, pitch_rad=0.0, height_m=0.0, range_share=0.0, relief_m=0.0)
    boundary, _ = rectangle()
    frame, detection, _ = seen(boundary, 0.95, square)
    exact = ranger(frame, 0.95, sigma=1e-9)
    found = outline_part(frame, detection, TABLE, exact, sigmas=only_pixels)
    one_pixel_m = 0.95 * 0.3 / 600.0
    assert found.outline.sigma_m == pytest.approx(math.sqrt(2.0) * one_pixel_m, rel=0.01)


@pytest.mark.parametrize(
    ("error", "size", "share"),
    [("pitch_rad", 0.002, 0.02), ("height_m", 0.002, 0.02), ("pixel_px", 0.5, 0.15), ("focal", 0.004, 0.15)],
)
def test_the_foot_s_sigma_is_what_each_error_alone_does_to_its_distance(error, size, share):
    """Of the last two the angle is taken for its tangent, a tenth too much at this height."""
    level = 1.3
    real = shoulder_pose(height=level + (size if error == "height_m" else 0.0), pitch=size * (error == "pitch_rad"))
    focal = 1.0 + size * (error == "focal")
    lens = replace(REFERENCE_MODEL, fx_px=REFERENCE_MODEL.fx_px * focal, fy_px=REFERENCE_MODEL.fy_px * focal)
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95, lens, real)
    believed = CameraFrame(frame.image, 0.0, REFERENCE_MODEL, shoulder_pose(height=level))
    contour = np.add(detection.contour_px, [0.0, size * (error == "pixel_px")])
    names = ("pixel_px", "focal", "pitch_rad", "height_m", "range_share", "relief_m")
    only = ProjectionSigmas(**{name: size * (name == error) for name in names})
    found = measure_distance(believed, contour, corners, TABLE, None, only)
    assert found.foot_sigma_m == pytest.approx(abs(found.foot_m - 0.95), rel=share)


def test_relief_moves_a_vertex_along_its_ray_away_from_what_is_straight_ahead():
    boundary, corners = rectangle(aside=0.05)
    frame, detection, _ = seen(boundary, 0.95)
    nothing = ProjectionSigmas(pixel_px=0.0, focal=0.0, pitch_rad=0.0, height_m=0.0, range_share=0.0, relief_m=0.0)
    exact = Distance(0.95, 0.0, 0.95, 0.0, math.nan, math.nan, relief_m=0.01)
    found = project_outline(frame, detection, corners, exact, TABLE, nothing)
    u, v = np.add(found.vertices_m, [0.05, 0.0]).T
    aside, up = np.abs(u), np.abs(v + TABLE - 1.15)
    assert found.sigma_m == pytest.approx(0.01 * np.maximum(aside, up) / 0.95, rel=0.02)


@pytest.mark.parametrize(
    ("errors", "own_m", "sigma_m"),
    [({}, 0.004, 0.004), ({"relief_m": 0.01}, 0.0, 0.01), ({"range_share": 0.02}, 0.0, 0.02 * 0.98)],
)
def test_the_range_s_sigma_holds_the_ranger_s_own_the_air_s_and_the_relief_s(errors, own_m, sigma_m):
    boundary, corners = rectangle()
    frame, detection, _ = seen(boundary, 0.95)
    names = ("pixel_px", "focal", "pitch_rad", "height_m", "range_share", "relief_m")
    only = ProjectionSigmas(**{"pixel_px": 0.3, **{name: errors.get(name, 0.0) for name in names[1:]}})
    shoulder = ranger(frame, 0.95, sigma=own_m)
    found = measure_distance(frame, detection.contour_px, corners, TABLE, shoulder, only)
    assert found.range_sigma_m == pytest.approx(sigma_m)
