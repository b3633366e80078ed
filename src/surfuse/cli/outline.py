"""`surfuse outline`: the dominant points of the part in any picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import Real

HELP = """Outline the largest part of a picture by dominant points.

The CSV file has columns u,v in metres: u to the right, v up, origin in the lower left corner of the bounding box.
With --all it also has columns part and ring: ring 0 is the outer boundary, the others are holes.

\b
Examples:
    surfuse outline photo.png --scale 0.5 --out outline.csv
    surfuse outline coins.png --scale 0.2 --out coins.csv --all
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("outline", help=HELP)(outline)


def outline(
    image: Annotated[Path, typer.Argument(help="Picture file.")],
    scale: Annotated[
        float, typer.Option("--scale", help="Millimetres per pixel.", parser=Real(1e-6, 1e6), metavar="MM")
    ],
    out: Annotated[Path, typer.Option("--out", help="CSV file with columns u,v in metres; a .png overlay beside it.")],
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance", help="How far the outline may cut a corner, pixels.", parser=Real(0.1, 1e4), metavar="PIXELS"
        ),
    ] = 1.5,
    all_parts: Annotated[
        bool, typer.Option("--all", help="All parts with their holes, not the largest alone.")
    ] = False,
    cut: Annotated[bool, typer.Option("--cut", help="Allow parts that the border of the picture cuts.")] = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> int:
    """Outline."""
    from surfuse.commands.pictures import picture_outline

    outcome = picture_outline.outline(image, scale, out, tolerance, force, all_parts, cut)
    return options.show(outcome.summary, outcome.table, as_json, quiet=False)
