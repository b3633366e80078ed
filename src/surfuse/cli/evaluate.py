"""`surfuse evaluate`: the error of a map against truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Error of a map against truth: a mesh in the frame of the readings, or another map.

\b
Examples:
    surfuse evaluate runs/mine --truth truth.ply
    surfuse evaluate surface.nc --truth reference.nc --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("evaluate", help=HELP)(evaluate)


def evaluate(
    surface: Annotated[Path, typer.Argument(metavar="MAP", help="Map file or run folder.")],
    truth: Annotated[Path, typer.Option("--truth", help="Mesh (STL, PLY, OBJ), map file or run folder.")],
    scale: Annotated[
        float, typer.Option("--scale", help="Factor on the mesh's numbers, 0.001 for mm.", min=1e-9)
    ] = 1.0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Score a map."""
    from surfuse.commands.judge import evaluation as scoring

    outcome = scoring.evaluate(surface, truth, scale)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
