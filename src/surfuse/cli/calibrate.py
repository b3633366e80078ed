"""`surfuse calibrate camera | shoulder | hand-eye | pictures | sensor`: the camera, its place, the range sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import SEED_MAX, Real, Whole

HELP = "Calibrate the camera, where it sits (tool, shoulder, fixed), and the range sensors."
CAMERA_HELP = """Calibrate a camera from pictures of a flat board.

The result is the [camera] section of a cell file, with reprojection error and standard deviations. Views that cannot
determine the camera are refused with the reason. Columns and rows count squares, not inner corners.

\b
Examples:
    surfuse calibrate camera views/*.png --columns 9 --rows 7 --square-mm 30 --out camera.toml
    surfuse calibrate pictures views && surfuse calibrate camera views/*.png --out camera.toml
"""
SHOULDER_HELP = """Find where camera and ranger sit on the shoulder, from views of one fixed board while joint 1 turns.

VIEWS is a CSV file with the columns image,joint1_deg and, for the ranger, range_m. The place of the board's first inner
corner (upper left) must be known in the world, for example touched with the grip.

\b
Example:
    surfuse calibrate shoulder views.csv --corner 0.85,0.25,1.42 --camera camera.toml --out shoulder.toml
"""
HAND_EYE_HELP = """Find where a camera sits on the tool (hand-eye), or fixed in the world, from views of one board.

VIEWS is a CSV file with the columns image,m00,m01,...,m33: a picture, and the pose of the tool (world_from_tool, row by
row) when it was taken. For a camera on the tool the board lies still; with --fixed the board is on the tool. Turn the
tool about two axes between the views. The result is the [camera] table of a cell file.

\b
Examples:
    surfuse calibrate hand-eye views.csv --camera camera.toml --out on_tool.toml
    surfuse calibrate hand-eye views.csv --camera camera.toml --fixed --driver uvc --out fixed.toml
"""
PICTURES_HELP = """Let the twin take pictures of a board, to try a calibration out.

\b
Examples:
    surfuse calibrate pictures views
    surfuse calibrate pictures turned --of shoulder --count 9
"""

SENSOR_HELP = """Fit a sensor model to logs of known surfaces: offset, scale, sigma, capture angle, bias by tilt.

A facing plate gives offset and sigma, at two distances also the scale; a tilted plate the bias and scatter by tilt; a
facing step the capture angle. What the logs cannot determine stays open, with the reason. Each LOG needs the mesh of
what it looked at, in the frame of its readings: --truth in the order of the logs, or a truth.ply beside the log.

\b
Examples:
    surfuse calibrate sensor facing/readings.csv tilted/readings.csv step/readings.csv --out sensors.toml
    surfuse calibrate sensor plate.csv --truth plate.stl --out sensors.toml
"""

Pattern = Annotated[Literal["checkerboard", "charuco"], typer.Option("--pattern", help="Kind of board.")]
Columns = Annotated[int, typer.Option("--columns", help="Squares in a row.", parser=Whole(2, 1000), metavar="N")]
Rows = Annotated[int, typer.Option("--rows", help="Squares in a column.", parser=Whole(2, 1000), metavar="N")]
Square = Annotated[
    float,
    typer.Option(
        "--square-mm", help="Width of a square in millimetres.", parser=Real(0.0, 1e4, above=True), metavar="MM"
    ),
]
Toml = Annotated[Path, typer.Option("--out", help="TOML file, a part of a cell file.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help=HELP, no_args_is_help=True, rich_markup_mode=None)
    group.command("camera", help=CAMERA_HELP)(camera)
    group.command("shoulder", help=SHOULDER_HELP)(shoulder)
    group.command("hand-eye", help=HAND_EYE_HELP)(hand_eye)
    group.command("pictures", help=PICTURES_HELP)(pictures)
    group.command("sensor", help=SENSOR_HELP)(sensor)
    app.add_typer(group, name="calibrate")


def camera(
    images: Annotated[list[Path], typer.Argument(help="Picture files.")],
    out: Toml,
    pattern: Pattern = "checkerboard",
    columns: Columns = 9,
    rows: Rows = 7,
    square_mm: Square = 30.0,
    lens: Annotated[
        Literal["none", "radial", "usual", "full"],
        typer.Option("--lens", help="Distortion: none; radial k1, k2; usual with p1, p2; full with k3."),
    ] = "usual",
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Calibrate a camera."""
    from surfuse.commands.calibrate import calibration
    from surfuse.vision.calibration_camera import CalibrationParameters
    from surfuse.vision.calibration_target import Target

    target = Target(pattern, columns, rows, 1e-3 * square_mm)
    outcome = calibration.camera_from_pictures(images, target, CalibrationParameters(lens=lens), out, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)


def shoulder(
    views: Annotated[Path, typer.Argument(help="CSV file: image,joint1_deg,range_m.")],
    corner: Annotated[str, typer.Option("--corner", help="World place X,Y,Z of the first inner corner, metres.")],
    out: Toml,
    camera: Annotated[
        Path | None, typer.Option("--camera", help="TOML file of the calibrated camera; default: the reference camera.")
    ] = None,
    ranger_height: Annotated[
        float | None,
        typer.Option(
            "--ranger-height",
            help="Height of the ranger's axis above the floor, metres.",
            parser=Real(0.0, 5.0, above=True),
            metavar="M",
        ),
    ] = None,
    pattern: Pattern = "checkerboard",
    columns: Columns = 9,
    rows: Rows = 7,
    square_mm: Square = 30.0,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Calibrate the shoulder."""
    from surfuse.commands.calibrate import calibration
    from surfuse.vision.calibration_target import Target

    target = Target(pattern, columns, rows, 1e-3 * square_mm)
    place = calibration.place_of(corner)
    outcome = calibration.shoulder_from_views(views, target, place, camera, ranger_height, out, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)


def hand_eye(
    views: Annotated[Path, typer.Argument(help="CSV file: image,m00,m01,...,m33.")],
    camera: Annotated[Path, typer.Option("--camera", help="TOML file of the calibrated camera.")],
    out: Toml,
    fixed: Annotated[bool, typer.Option("--fixed", help="The camera stands still, the board is on the tool.")] = False,
    driver: Annotated[str, typer.Option("--driver", help="What takes the pictures in the cell file.")] = "bridge",
    pattern: Pattern = "checkerboard",
    columns: Columns = 9,
    rows: Rows = 7,
    square_mm: Square = 30.0,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Calibrate a camera on the tool, or a fixed one."""
    from surfuse.commands.calibrate import hand_eye as work
    from surfuse.vision.calibration_target import Target

    target = Target(pattern, columns, rows, 1e-3 * square_mm)
    outcome = work.hand_eye_from_views(views, target, camera, fixed, driver, out, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)


def pictures(
    folder: Annotated[Path, typer.Argument(help="New folder for the pictures.")],
    of: Annotated[
        Literal["camera", "shoulder"], typer.Option("--of", help="Which calibration they are for.")
    ] = "camera",
    count: Annotated[int, typer.Option("--count", help="Number of pictures.", parser=Whole(1, 1000), metavar="N")] = 12,
    cell: options.Cell = None,
    seed: Annotated[
        int, typer.Option("--seed", help="Seed of everything that is random.", parser=Whole(0, SEED_MAX), metavar="N")
    ] = 1,
    pattern: Pattern = "checkerboard",
    columns: Columns = 9,
    rows: Rows = 7,
    square_mm: Square = 30.0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Take simulated pictures."""
    from surfuse.commands.calibrate import calibration_pictures as work
    from surfuse.vision.calibration_target import Target

    target = Target(pattern, columns, rows, 1e-3 * square_mm)
    take = work.camera_pictures if of == "camera" else work.shoulder_pictures
    outcome = take(folder, target, count, cell, seed)
    return options.show(outcome.summary, outcome.table, as_json, quiet)


def sensor(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Run folders, .mcap or .csv.")],
    out: Annotated[Path, typer.Option("--out", help="TOML file in the form of a sensors.toml.")],
    truth: Annotated[
        list[Path] | None, typer.Option("--truth", help="Mesh of a log; in the order of the logs.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fit a sensor model."""
    from surfuse.commands.calibrate import sensor_calibration as work

    outcome = work.calibrate_sensor(logs, truth or [], out, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
