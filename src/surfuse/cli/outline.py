"""`surfuse outline`: the dominant points of the part in any picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Outline the largest part of a picture by dominant points, in millimetres.

\b
Example:
    surfuse outline photo.png --scale 0.5 --out outline.csv
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("outline", help=HELP)(outline)


def outline(
    image: Annotated[Path, typer.Argument(help="Picture file.")],
    scale: Annotated[float, typer.Option("--scale", help="Millimetres per pixel.", min=1e-6)],
    out: Annotated[Path, typer.Option("--out", help="CSV file with columns u,v in metres; a .png overlay beside it.")],
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="How far the outline may cut a corner, pixels.", min=0.1)
    ] = 1.5,
    force: options.Force = False,
    as_json: options.Json = False,
) -> int:
    """Outline."""
    from surfuse import pipeline

    outcome = pipeline.outline(image, scale, out, tolerance, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet=False)
