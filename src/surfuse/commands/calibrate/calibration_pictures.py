"""Pictures for trying out a calibration: the twin's camera looks at a board, so that the right answer is known."""

from __future__ import annotations

import math
from pathlib import Path

from surfuse.commands.outcome import Outcome
from surfuse.durable import storage_error, write_bytes, write_text
from surfuse.errors import StorageError, UsageError
from surfuse.geometry.poses import transform_points
from surfuse.rig.description import camera_model
from surfuse.rig.simulated.board_pictures import camera_views, fixed_board, shoulder_views
from surfuse.settings import load
from surfuse.vision.calibration_target import Target
from surfuse.vision.drawing import encoded_png


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
    for number, picture in enumerate(camera_views(camera, target, count, seed)):
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
    _make(folder)
    lines = ["image,joint1_deg,range_m"]
    for number, view in enumerate(shoulder_views(settings, target, count, seed)):
        name = f"view{number:02d}.png"
        write_bytes(folder / name, encoded_png(view.picture))
        text = f"{view.range_m:.5f}" if math.isfinite(view.range_m) else "inf"
        lines.append(f"{name},{math.degrees(view.joint1_rad):.4f},{text}")
    write_text(folder / "views.csv", "\n".join([*lines, ""]))
    corner = transform_points(fixed_board(target), target.points()[:1])[0]
    place = ",".join(f"{value:.5f}" for value in corner.tolist())
    summary: dict[str, object] = {"folder": str(folder), "pictures": count, "first_corner_m": corner.tolist()}
    return Outcome(summary, [("pictures", f"{count} in {folder}"), ("first corner", f"{place} m")])


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise StorageError("the folder exists", where=str(folder), cure="give a new name") from error
    except OSError as error:
        raise storage_error(error, folder, "create the folder") from error
