"""Pictures for trying out a calibration: the twin's camera looks at a board, so that the right answer is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from surfuse.commands.outcome import Outcome
from surfuse.durable import storage_error, write_bytes, write_text
from surfuse.errors import StorageError, UsageError
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.interfaces import Generator
from surfuse.records import ByteArray, CameraModel, FloatArray
from surfuse.rig.devices import world_from_shoulder
from surfuse.rig.simulated.assembly import camera_model, camera_mount, ranger_mount, shoulder_spec
from surfuse.settings import load
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.shapes import box
from surfuse.twin.targets import SQUARE_CELLS, charuco, checkerboard, target_bodies
from surfuse.twin.world import Twin
from surfuse.vision.calibration_target import DICTIONARY, Target
from surfuse.vision.drawing import encoded_png
from surfuse.vision.rays import pixels_of

_LIGHT = OpticsParameters((0.0, 0.0, 1.8), ambient=0.6, exposure=280.0, background=60.0)
_BOARD_MIDDLE_M = (0.85, 0.15, 1.35)
_BOARD_YAW_RAD = 0.2


def camera_pictures(folder: Path, target: Target, count: int, cell_file: Path | None, seed: int) -> Outcome:
    """Write pictures of a board in random poses, as the cell's camera sees them.

    Raises
    ------
    UsageError : fewer than 1 picture.
    StorageError : the folder exists.
    """
    if count < 1:
        raise UsageError(f"{count} pictures", cure="give at least 1")
    camera = camera_model(load(cell_file))
    _make(folder)
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        picture = seen_board(camera, target, _random_pose(camera, target, generator), generator)
        write_bytes(folder / f"view{number:02d}.png", encoded_png(picture))
    return Outcome({"folder": str(folder), "pictures": count}, [("pictures", f"{count} in {folder}")])


def shoulder_pictures(folder: Path, target: Target, count: int, cell_file: Path | None, seed: int) -> Outcome:
    """Write pictures of a fixed board at several angles of joint 1, and the table of angles and shoulder ranges.

    Raises
    ------
    UsageError : fewer than 2 pictures.
    StorageError : the folder exists.
    """
    if count < 2:
        raise UsageError(f"{count} pictures", cure="give at least 2")
    settings = load(cell_file)
    camera, spec = camera_model(settings), shoulder_spec(settings)
    world_from_target = _fixed_board(target)
    twin = Twin(Scene((_backing(target, world_from_target),)), seed=seed)
    _make(folder)
    middle = math.atan2(_BOARD_MIDDLE_M[1], _BOARD_MIDDLE_M[0])
    lines = ["image,joint1_deg,range_m"]
    for number, offset in enumerate(np.linspace(-0.2, 0.2, count).tolist()):
        generator = np.random.default_rng([seed, number])
        turn = world_from_shoulder(middle + offset)
        camera_pose = turn @ camera_mount(settings).shoulder_from_device
        picture = seen_board(camera, target, inverse(camera_pose) @ world_from_target, generator)
        write_bytes(folder / f"view{number:02d}.png", encoded_png(picture))
        twin.begin("calibration", number)
        heard, _ = twin.ping(turn @ ranger_mount(settings).shoulder_from_device, spec, 10, float(number))
        usable = heard[np.isfinite(heard)]
        text = f"{usable.mean():.5f}" if len(usable) else "inf"
        lines.append(f"view{number:02d}.png,{math.degrees(middle + offset):.4f},{text}")
    write_text(folder / "views.csv", "\n".join([*lines, ""]))
    corner = transform_points(world_from_target, target.points()[:1])[0]
    place = ",".join(f"{value:.5f}" for value in corner.tolist())
    summary: dict[str, object] = {"folder": str(folder), "pictures": count, "first_corner_m": corner.tolist()}
    return Outcome(summary, [("pictures", f"{count} in {folder}"), ("first corner", f"{place} m")])


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


def _fixed_board(target: Target) -> FloatArray:
    """Upright in front of the arm, turned a little."""
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


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise StorageError("the folder exists", where=str(folder), cure="give a new name") from error
    except OSError as error:
        raise storage_error(error, folder, "create the folder") from error
