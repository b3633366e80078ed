"""`surfuse evaluate`: the error of a map against truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Error of a map against truth: a mesh, or another map.

A mesh is in the frame of the readings, unless surfuse exported it or --truth-frame says otherwise.

\b
Examples:
    surfuse evaluate runs/mine --truth truth.ply
    surfuse evaluate surface.nc --truth reference.nc --json
    surfuse evaluate runs/mine --truth drawing.stl --scale 0.001 --truth-frame part
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("evaluate", help=HELP)(evaluate)


def evaluate(
    surface: Annotated[Path, typer.Argument(metavar="MAP", help="Map file or run folder.")],
    truth: Annotated[Path, typer.Option("--truth", help="Mesh (STL, PLY, OBJ), map file or run folder.")],
    scale: options.Scale = 1.0,
    truth_frame: options.TruthFrame = "auto",
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Score a map."""
    from surfuse.commands.judge import evaluation as scoring
    from surfuse.commands.judge.truth_files import TruthFrame

    outcome = scoring.evaluate(surface, truth, scale, TruthFrame(truth_frame))
    return options.show(outcome.summary, outcome.table, as_json, quiet)
