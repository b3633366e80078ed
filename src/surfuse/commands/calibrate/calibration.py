"""Calibration from files: the camera from pictures of a target, its place on the shoulder from joint angles, too.

Both write TOML that is a part of a cell file, so that `--cell` takes it as it is.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.calibrate.calibration_output import (
    ShoulderResult,
    camera_summary,
    camera_table,
    camera_toml,
    shoulder_summary,
    shoulder_table,
    shoulder_toml,
)
from surfuse.commands.outcome import Outcome
from surfuse.durable import refuse_existing, write_text
from surfuse.errors import DataError, UsageError
from surfuse.records import ByteArray, CameraModel, FloatArray
from surfuse.rig.description import camera_model
from surfuse.rig.mounts import mount_of
from surfuse.settings import load
from surfuse.vision.calibration_camera import CalibrationParameters, calibrate_camera
from surfuse.vision.calibration_ranger import ShoulderRanger, calibrate_shoulder_ranger
from surfuse.vision.calibration_shoulder import ShoulderCamera, calibrate_shoulder_camera
from surfuse.vision.calibration_target import NotSeen, Target, TargetView, look_for
from surfuse.vision.picture import read_picture

_COLUMNS = ("image", "joint1_deg")


@dataclass(frozen=True)
class AngleView:
    """One row of the table of views: the picture, the angle of joint 1, and the shoulder ranger's range (nan: none)."""

    image: Path
    joint1_rad: float
    range_m: float


def camera_from_pictures(
    images: list[Path], target: Target, parameters: CalibrationParameters, out: Path, force: bool = False
) -> Outcome:
    """Calibrate a camera from picture files of a target and write its section of a cell file.

    Raises
    ------
    UsageError : no pictures, or `out` is not a TOML file.
    DataError : a file that is no picture, pictures of different sizes, or views that do not determine the camera.
    StorageError : `out` exists and `force` is not given.
    """
    if not images:
        raise UsageError("no pictures", cure="give the files of at least 5 pictures of the board")
    check_output(out, force)
    pictures = [read_picture(image) for image in images]
    size_px = _common_size(pictures, images)
    seen = tuple(look_for(target, picture, path.name) for picture, path in zip(pictures, images, strict=True))
    found = calibrate_camera(target, seen, size_px, parameters)
    write_text(out, camera_toml(found, target), overwrite=force)
    return Outcome(camera_summary(found, out), camera_table(found, out))


def shoulder_from_views(
    views: Path,
    target: Target,
    first_corner_m: FloatArray,
    camera_file: Path | None,
    ranger_height_m: float | None,
    out: Path,
    force: bool = False,
) -> Outcome:
    """Find the camera's (and the ranger's) place on the shoulder from a table of views, and write it for the cell file.

    `first_corner_m` (3,) is the target's first inner corner in the world, `camera_file` a cell file with the calibrated
    camera (default: the reference camera), `ranger_height_m` the ranger's axis above the floor (default: the cell's).

    Raises
    ------
    UsageError : `out` is not a TOML file.
    DataError : a table or picture that cannot be used, or views that do not determine the place.
    StorageError : `out` exists and `force` is not given.
    """
    check_output(out, force)
    settings = load(camera_file)
    camera = camera_model(settings)
    angle_views = read_views(views)
    seen = [look(target, angle_view.image, camera) for angle_view in angle_views]
    used = [
        (angle_view, view) for angle_view, view in zip(angle_views, seen, strict=True) if isinstance(view, TargetView)
    ]
    left_out = tuple(view for view in seen if isinstance(view, NotSeen))
    angles = np.array([angle_view.joint1_rad for angle_view, _ in used])
    found = calibrate_shoulder_camera(camera, target, tuple(view for _, view in used), angles, first_corner_m)
    height_m = settings.ranger.height_m if ranger_height_m is None else ranger_height_m
    ranger = _ranger(angle_views, found, height_m)
    mount = mount_of(found.shoulder_from_camera)
    result = ShoulderResult(found, mount, ranger, height_m, len(used), left_out)
    write_text(out, shoulder_toml(result, camera, settings.camera.noise_levels), overwrite=force)
    return Outcome(shoulder_summary(result, out), shoulder_table(result, out))


def place_of(text: str) -> FloatArray:
    """A place (3,) written as X,Y,Z in metres.

    Raises
    ------
    UsageError : not three finite numbers.
    """
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.all(np.isfinite(place)):
        raise UsageError(f"place '{text}'", cure="give three numbers X,Y,Z in metres")
    return place


def read_views(path: Path) -> tuple[AngleView, ...]:
    """Rows of a CSV file with the columns image (relative to the file), joint1_deg and perhaps range_m.

    Raises
    ------
    DataError : unreadable, without the columns or rows, or an angle or range that is no number.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            header = reader.fieldnames or []
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(f"cannot read the table ({why})", cure="give a CSV file", where=str(path)) from error
    missing = [name for name in _COLUMNS if name not in header]
    if missing:
        raise DataError(
            f"no column {', '.join(missing)}", cure="give the columns image,joint1_deg,range_m", where=str(path)
        )
    if not rows:
        raise DataError("the table has no rows", cure="give one row a picture", where=str(path))
    return tuple(_angle_view(row, path, line) for line, row in enumerate(rows, 2))


def _angle_view(row: dict[str, str], path: Path, line: int) -> AngleView:
    def number(name: str) -> float:
        text = (row.get(name) or "").strip()
        try:
            return float(text) if text else math.nan
        except ValueError:
            raise DataError(f"{name} = '{text}'", cure="give a number", where=f"{path}:{line}") from None

    angle = number("joint1_deg")
    if not math.isfinite(angle):
        raise DataError(f"joint1_deg = '{row.get('joint1_deg')}'", cure="give degrees", where=f"{path}:{line}")
    image = (row.get("image") or "").strip()
    if not image:
        raise DataError("no picture", cure="give a file name", where=f"{path}:{line}")
    return AngleView(path.parent / image, math.radians(angle), number("range_m"))


def look(target: Target, image: Path, camera: CameraModel) -> TargetView | NotSeen:
    """Look for the target in a picture of the camera.

    Raises
    ------
    DataError : no picture, or one of another size.
    """
    picture = read_picture(image)
    if picture.shape != (camera.height_px, camera.width_px):
        raise DataError(
            f"{picture.shape[1]} x {picture.shape[0]} pixels, the camera has {camera.width_px} x {camera.height_px}",
            cure="give the camera's own file with --camera",
            where=str(image),
        )
    return look_for(target, picture, image.name)


def _ranger(angle_views: tuple[AngleView, ...], found: ShoulderCamera, height_m: float) -> ShoulderRanger | None:
    """From all rows with a range, also those whose picture does not show the target; None without any."""
    ranges = np.array([angle_view.range_m for angle_view in angle_views])
    if not np.any(np.isfinite(ranges)):
        return None
    angles = np.array([angle_view.joint1_rad for angle_view in angle_views])
    return calibrate_shoulder_ranger(found.world_from_target, angles, ranges, height_m)


def check_output(out: Path, force: bool) -> None:
    """Refuse an output that is no TOML file, or that is there already.

    Raises
    ------
    UsageError, StorageError : which of them.
    """
    if out.suffix.lower() != ".toml":
        raise UsageError(f"output file '{out}'", cure="give a name that ends in .toml")
    refuse_existing(out, force)


def _common_size(pictures: list[ByteArray], images: list[Path]) -> tuple[int, int]:
    height, width = pictures[0].shape
    for picture, image in zip(pictures, images, strict=True):
        if picture.shape != (height, width):
            raise DataError(
                f"{picture.shape[1]} x {picture.shape[0]} pixels, the first picture {width} x {height}",
                cure="give pictures of one camera, all of one size",
                where=str(image),
            )
    return width, height
