"""Where a camera sits on the tool or in the world, from a table of pictures and poses of the tool."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse import __version__, registry
from surfuse.commands.calibrate.calibration import check_output, look
from surfuse.commands.calibrate.calibration_output import camera_lines
from surfuse.commands.outcome import Outcome
from surfuse.durable import write_text
from surfuse.errors import ConfigError, DataError
from surfuse.records import CameraModel, FloatArray
from surfuse.rig.description import camera_model
from surfuse.settings import load
from surfuse.settings.looking_tables import typed_pose
from surfuse.vision.calibration_hand_eye import HandEye, calibrate_hand_eye
from surfuse.vision.calibration_target import NotSeen, Target, TargetView

POSE_COLUMNS = tuple(f"m{row}{column}" for row in range(4) for column in range(4))


@dataclass(frozen=True)
class PosedPicture:
    """One row of the table: a picture, and the pose (4, 4) of the tool when it was taken."""

    image: Path
    world_from_tool: FloatArray


def hand_eye_from_views(
    views: Path, target: Target, camera_file: Path, fixed: bool, driver: str, out: Path, force: bool = False
) -> Outcome:
    """Find the camera's place and write the [camera] table of a cell file, for this driver of it.

    `fixed`: the camera stands still and the board is on the tool; else the camera is on the tool.

    Raises
    ------
    UsageError : `out` is not a TOML file, or there is no such driver.
    DataError : a table or picture that cannot be used, or views that do not determine the place.
    StorageError : `out` exists and `force` is not given.
    """
    check_output(out, force)
    registry.load("cameras", driver)
    camera = camera_model(load(camera_file))
    rows = read_posed_pictures(views)
    seen = [(row, look(target, row.image, camera)) for row in rows]
    used = [(row, view) for row, view in seen if isinstance(view, TargetView)]
    left_out = tuple(view for _, view in seen if isinstance(view, NotSeen))
    tools = np.array([row.world_from_tool for row, _ in used]).reshape(-1, 4, 4)
    found = calibrate_hand_eye(camera, target, tuple(view for _, view in used), tools, fixed)
    write_text(out, _toml(found, camera, fixed, driver), overwrite=force)
    return Outcome(_summary(found, fixed, used, left_out, out), _table(found, fixed, left_out, out))


def read_posed_pictures(path: Path) -> tuple[PosedPicture, ...]:
    """Rows of a CSV file with the columns image (relative to the file) and m00 to m33 (world_from_tool, row by row).

    Raises
    ------
    DataError : unreadable, without the columns or rows, or a pose that is none.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            header = reader.fieldnames or []
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(f"cannot read the table ({why})", cure="give a CSV file", where=str(path)) from error
    missing = [name for name in ("image", *POSE_COLUMNS) if name not in header]
    if missing:
        cure = "give the columns image,m00,m01,...,m33: the pose world_from_tool, row by row"
        raise DataError(f"no column {', '.join(missing[:3])}", cure=cure, where=str(path))
    if not rows:
        raise DataError("the table has no rows", cure="give one row a picture", where=str(path))
    return tuple(_row(row, path, line) for line, row in enumerate(rows, 2))


def _row(row: dict[str, str], path: Path, line: int) -> PosedPicture:
    where = f"{path}:{line}"
    try:
        numbers = [float(row[name]) for name in POSE_COLUMNS]
    except (TypeError, ValueError) as error:
        raise DataError(f"a pose that is not 16 numbers ({error})", cure="give numbers", where=where) from error
    if not all(map(math.isfinite, numbers)):
        raise DataError("a pose with a number that is not finite", cure="remove the row", where=where)
    try:
        exact = typed_pose(numbers, "the pose of the tool")
    except ConfigError as error:
        raise DataError(error.what, cure=error.cure, where=where) from error
    return PosedPicture(path.parent / (row["image"] or "").strip(), np.array(exact).reshape(4, 4))


def _key(fixed: bool) -> str:
    return "world_from_camera" if fixed else "tool_from_camera"


def pose_lines(key: str, matrix: FloatArray) -> list[str]:
    """A pose (4, 4) as the lines of a cell file, a row a line."""
    rows = ["    " + ", ".join(f"{value:.9f}" for value in row) + "," for row in matrix + 0.0]
    return [f"{key} = [", *rows, "]"]


def _toml(found: HandEye, camera: CameraModel, fixed: bool, driver: str) -> str:
    place = ", ".join(f"{1e3 * value:.2f}" for value in found.sigma[:3])
    turn = ", ".join(f"{math.degrees(value):.3f}" for value in found.sigma[3:])
    return "\n".join(
        [
            f"# Camera and its place, calibrated by surfuse {__version__} from {len(found.per_view_px)} views.",
            f"# Reprojection error {found.reprojection_px:.3f} px. Standard deviations along and about x, y, z:",
            f"# {place} mm; {turn} degrees.",
            "[camera]",
            f'driver = "{driver}"',
            f'mounted = "{"fixed" if fixed else "tool"}"',
            *pose_lines(_key(fixed), found.carrier_from_camera),
            *camera_lines(camera),
            "",
        ]
    )


def _summary(
    found: HandEye, fixed: bool, used: list[tuple[PosedPicture, TargetView]], left_out: tuple[NotSeen, ...], out: Path
) -> dict[str, object]:
    return {
        _key(fixed): found.carrier_from_camera.ravel().tolist(),
        "tool_from_target" if fixed else "world_from_target": found.other_from_target.ravel().tolist(),
        "sigma_m": found.sigma[:3].tolist(),
        "sigma_deg": np.degrees(found.sigma[3:]).tolist(),
        "reprojection_px": found.reprojection_px,
        "used": {view.name: px for (_, view), px in zip(used, found.per_view_px, strict=True)},
        "left_out": {view.name: view.reason for view in left_out},
        "out": str(out),
    }


def _table(found: HandEye, fixed: bool, left_out: tuple[NotSeen, ...], out: Path) -> list[tuple[str, str]]:
    places = zip("xyz", found.carrier_from_camera[:3, 3].tolist(), found.sigma[:3].tolist(), strict=True)
    turn = math.degrees(float(np.max(found.sigma[3:])))
    rows = [(f"camera {name}", f"{1e3 * value:9.2f} +- {1e3 * sigma:.2f} mm") for name, value, sigma in places]
    rows.append(("camera turn", f"+- {turn:.3f} degrees"))
    rows.append(("reprojection", f"{found.reprojection_px:.3f} px over {len(found.per_view_px)} views"))
    rows += [("left out", f"{view.name}: {view.reason}") for view in left_out]
    line = f"{_key(fixed)} = [{', '.join(f'{value:.6f}' for value in (found.carrier_from_camera + 0.0).ravel())}]"
    return [*rows, ("for the cell file", line), ("written", str(out))]
