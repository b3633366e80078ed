"""Pictures of the twin: geometry, shading, determinism."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL
from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.twin.materials import MATERIALS, Material
from surfuse.twin.optics import OpticsParameters, pixel_rays, render
from surfuse.twin.scene import Scene, SceneBody

SMALL = replace(REFERENCE_MODEL, width_px=120, height_px=140, fx_px=125.0, fy_px=183.0, cx_px=59.5, cy_px=69.5)
AHEAD = pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), [0.0, 0.0, 1.0])
PURE = OpticsParameters(blur_px=0.0, noise_levels=0.0)


def plate(distance=1.0, half=0.1, yaw=0.0, material=Material.PART, height=1.0):
    """An upright square in front of the camera, facing it."""
    y, z = half * np.array([-1, 1, 1, -1]), half * np.array([-1, -1, 1, 1])
    vertices = np.column_stack([np.zeros(4), y, z])
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    triangles = np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int64)
    return SceneBody(vertices, triangles, material, pose(turn, [distance, 0.0, height]))


def picture(bodies, parameters=PURE, camera=SMALL, seed=0, where=AHEAD):
    return render(Scene(bodies), camera, where, np.random.default_rng(seed), parameters)


def test_plate_covers_the_pixels_that_the_pinhole_says():
    image = picture([plate()]).astype(float)
    bright, dark = image[70, 60], image[0, 0]
    share = (image - dark) / (bright - dark)
    assert share.sum() == pytest.approx(0.2 * SMALL.fx_px * 0.2 * SMALL.fy_px, rel=0.01)
    assert share[70].sum() == pytest.approx(0.2 * SMALL.fx_px, abs=0.3)
    assert share[:, 60].sum() == pytest.approx(0.2 * SMALL.fy_px, abs=0.3)


def test_grey_levels_follow_lamberts_law():
    parameters = replace(PURE, light_m=(0.0, 0.0, 3.0), ambient=0.3, exposure=250.0)
    for yaw in (0.0, 0.6):
        to_light = np.array([-1.0, 0.0, 2.0]) / math.sqrt(5.0)
        facing = max(float(np.array([-math.cos(yaw), -math.sin(yaw), 0.0]) @ to_light), 0.0)
        expected = 250.0 * MATERIALS[Material.PART].albedo * (0.3 + 0.7 * facing)
        assert picture([plate(yaw=yaw)], parameters)[70, 60] == pytest.approx(expected, abs=0.51)


def test_both_sides_of_a_triangle_are_seen_alike():
    body = plate()
    flipped = replace(body, triangles=body.triangles[:, ::-1].copy())
    assert np.array_equal(picture([body]), picture([flipped]))


def test_room_is_seen_where_nothing_is():
    assert picture([plate()], replace(PURE, background=33.0))[0, 0] == 33


def test_same_generator_gives_the_same_picture():
    noisy = OpticsParameters(noise_levels=4.0)
    assert np.array_equal(picture([plate()], noisy, seed=3), picture([plate()], noisy, seed=3))
    assert not np.array_equal(picture([plate()], noisy, seed=3), picture([plate()], noisy, seed=4))


def test_noise_has_the_stated_deviation():
    parameters = OpticsParameters(noise_levels=5.0, background=100.0)
    sky = picture([plate()], parameters)[:40].astype(float)
    assert sky.std() == pytest.approx(5.0, rel=0.05)
    assert sky.mean() == pytest.approx(100.0, abs=0.3)


def test_illumination_gradient_from_left_to_right_and_top_to_bottom():
    image = picture([plate(half=3.0)], replace(PURE, gradient_x=0.4, gradient_y=-0.2, exposure=150.0)).astype(float)
    middle = image[69:71, 59:61].mean()
    assert image[70, -1] / middle == pytest.approx(1.2, abs=0.02)
    assert image[70, 0] / middle == pytest.approx(0.8, abs=0.02)
    assert image[0, 60] / middle == pytest.approx(1.1, abs=0.02)


def test_shadow_falls_on_what_the_lamp_does_not_see():
    wall = plate(distance=2.0, half=3.0)
    blind = plate(distance=1.9, half=0.2, height=1.5)
    lit = picture([wall, blind], PURE).astype(int)
    shaded = picture([wall, blind], replace(PURE, shadows=True)).astype(int)
    assert np.all(shaded <= lit)
    rows = np.flatnonzero((shaded < lit - 20)[:, 60])
    # The light comes from (-1, 0, 1.6): the blind's lower edge, 0.1 m before the wall, throws its shadow 0.16 m lower.
    lower_edge = SMALL.cy_px - SMALL.fy_px * (1.3 - 0.16 - 1.0) / 2.0
    hidden_by_the_blind = SMALL.cy_px - SMALL.fy_px * (1.3 - 1.0) / 1.9
    assert rows.max() == pytest.approx(lower_edge, abs=1.0)
    assert rows.min() == pytest.approx(hidden_by_the_blind, abs=1.0)


def test_lens_distortion_moves_the_edges_as_the_model_says():
    barrel = replace(SMALL, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    straight, bent = (picture([plate(half=0.3)], camera=camera)[70] > 60 for camera in (SMALL, barrel))
    x = 0.3
    assert straight.sum() == pytest.approx(2 * SMALL.fx_px * x, abs=1.1)
    assert bent.sum() == pytest.approx(2 * SMALL.fx_px * x * (1 - 0.2 * x * x), abs=1.1)


def test_pixel_rays_have_unit_length_and_the_axis_points_ahead():
    rays = pixel_rays(SMALL, np.array([[SMALL.cx_px, SMALL.cy_px], [0.0, 0.0]]))
    assert np.linalg.norm(rays, axis=1) == pytest.approx([1.0, 1.0])
    assert rays[0] == pytest.approx([0.0, 0.0, 1.0])


def test_edges_lie_between_pixels_only_with_several_rays():
    shifted = replace(plate(), world_from_body=pose(np.eye(3), [1.0, 0.3 / SMALL.fx_px, 1.0]))
    widths = []
    for samples in (1, 8):
        row = picture([shifted], replace(PURE, edge_samples=samples))[70].astype(float)
        share = (row - row[0]) / (row[60] - row[0])
        widths.append(share.sum())
    assert widths[0] == round(widths[0])
    assert widths[1] == pytest.approx(0.2 * SMALL.fx_px, abs=0.1)


@pytest.mark.parametrize(
    "values",
    [
        {"ambient": 1.2},
        {"exposure": -1.0},
        {"gradient_x": 5.0},
        {"edge_samples": 0},
        {"noise_levels": math.nan},
        {"light_m": (0.0, math.inf, 1.0)},
    ],
)
def test_impossible_parameters_are_refused(values):
    with pytest.raises(ConfigError):
        OpticsParameters(**values)
