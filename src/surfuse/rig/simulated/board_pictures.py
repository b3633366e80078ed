"""A calibration board before the twin's camera and ranger: pictures and ranges whose right answer is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.interfaces import Generator
from surfuse.records import ByteArray, CameraModel, FloatArray
from surfuse.rig.description import camera_model, camera_mount, ranger_mount, shoulder_spec
from surfuse.rig.mounts import world_from_shoulder
from surfuse.settings import Settings
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.shapes import box
from surfuse.twin.targets import SQUARE_CELLS, charuco, checkerboard, target_bodies
from surfuse.twin.world import Twin
from surfuse.vision.calibration_target import DICTIONARY, Target
from surfuse.vision.rays import pixels_of

_LIGHT = OpticsParameters((0.0, 0.0, 1.8), ambient=0.6, exposure=280.0, background=60.0)
_BOARD_MIDDLE_M = (0.85, 0.15, 1.35)
_BOARD_YAW_RAD = 0.2
_PINGS = 10


@dataclass(frozen=True)
class ShoulderView:
    """The board at one angle of joint 1: the picture (H, W), and the shoulder ranger's range (inf: no echo)."""

    joint1_rad: float
    picture: ByteArray
    range_m: float


def camera_views(camera: CameraModel, target: Target, count: int, seed: int) -> Iterator[ByteArray]:
    """Pictures (H, W) of a board in random poses."""
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        yield seen_board(camera, target, _random_pose(camera, target, generator), generator)


def shoulder_views(settings: Settings, target: Target, count: int, seed: int) -> Iterator[ShoulderView]:
    """A fixed board seen and heard at several angles of joint 1."""
    camera, spec = camera_model(settings), shoulder_spec(settings)
    world_from_target = fixed_board(target)
    twin = Twin(Scene((_backing(target, world_from_target),)), seed=seed)
    middle = math.atan2(_BOARD_MIDDLE_M[1], _BOARD_MIDDLE_M[0])
    for number, offset in enumerate(np.linspace(-0.2, 0.2, count).tolist()):
        generator = np.random.default_rng([seed, number])
        turn = world_from_shoulder(middle + offset)
        camera_pose = turn @ camera_mount(settings).shoulder_from_device
        picture = seen_board(camera, target, inverse(camera_pose) @ world_from_target, generator)
        twin.begin("calibration", number)
        heard, _ = twin.ping(turn @ ranger_mount(settings).shoulder_from_device, spec, _PINGS, float(number))
        usable = heard[np.isfinite(heard)]
        yield ShoulderView(middle + offset, picture, float(usable.mean()) if len(usable) else math.inf)


def seen_board(camera: CameraModel, target: Target, camera_from_target: FloatArray, generator: Generator) -> ByteArray:
    """The picture (H, W) of a board alone, lit from beside the camera, at a pose in the camera's frame."""
    # The light is given in the world; here the camera stands at its usual height and looks along x.
    world_from_camera = pose([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [0.0, 0.0, 1.3])
    scene = Scene(board_bodies(target, world_from_camera @ camera_from_target))
    return render(scene, camera, world_from_camera, generator, _LIGHT)


def board_bodies(target: Target, world_from_target: FloatArray) -> tuple[SceneBody, ...]:
    """The board of a calibration target, with a border of one square."""
    if target.pattern == "checkerboard":
        dark, cell_m = checkerboard(target.columns, target.rows), target.square_m
    else:
        dark, cell_m = charuco(target.columns, target.rows, DICTIONARY), target.square_m / SQUARE_CELLS
    return target_bodies(dark, cell_m, world_from_target, target.square_m)


def _random_pose(camera: CameraModel, target: Target, generator: Generator) -> FloatArray:
    """Tilted by up to 35 degrees, as near as it can be with all corners in the picture."""
    turn = np.eye(3)
    for axis, limit in (([0.0, 0.0, 1.0], 0.3), ([1.0, 0.0, 0.0], 0.6), ([0.0, 1.0, 0.0], 0.6)):
        turn = turn @ rotation_about(axis, generator.uniform(-limit, limit))
    middle = target.points().mean(axis=0)
    aside = generator.uniform(-0.3, 0.3, 2)
    for distance in np.geomspace(2.0, 200.0, 60) * target.square_m:
        place = pose(turn, distance * np.array([aside[0] * 0.8, aside[1] * 0.6, 1.0]) - turn @ middle)
        there = transform_points(place, target.points())
        if there[:, 2].min() > 0.3 * distance:
            pixels = pixels_of(camera, there)
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            if low.min() > 12.0 and np.all(high < np.array([camera.width_px, camera.height_px]) - 13.0):
                break
    farther = generator.uniform(1.0, 1.5)
    return pose(turn, farther * (place[:3, 3] + turn @ middle) - turn @ middle)


def fixed_board(target: Target) -> FloatArray:
    """Pose (4, 4) of the board of `shoulder_views` in the world: upright in front of the arm, turned a little."""
    turn = rotation_about([0.0, 0.0, 1.0], _BOARD_YAW_RAD) @ np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    return pose(turn, np.array(_BOARD_MIDDLE_M) - turn @ target.points().mean(axis=0))


def _backing(target: Target, world_from_target: FloatArray) -> SceneBody:
    """The board as the ranger hears it: a plate as large as board and border, its front in the target's plane."""
    border = 2.0 * target.square_m
    width, height = target.columns * target.square_m + border, target.rows * target.square_m + border
    plate = box(width, 0.01, height)
    # x of the solid goes into the board, its y is the board's -x, its z the board's -y.
    target_from_plate = pose(
        [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]],
        [0.5 * width - target.square_m, height - target.square_m, 0.0],
    )
    return SceneBody(plate.vertices_m, plate.triangles, Material.PART, world_from_target @ target_from_plate)
