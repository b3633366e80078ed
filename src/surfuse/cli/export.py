"""`surfuse export`: give a map to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Write a map in another format, chosen by the suffix of FILE.

\b
Examples:
    surfuse export runs/mine surface.ply
    surfuse export runs/mine/surface.nc surface.stl --force
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("export", help=HELP)(export)


def export(
    surface: Annotated[Path, typer.Argument(metavar="MAP", help="Map file or run folder.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Target; its suffix chooses the format.")],
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Convert."""
    from surfuse.commands.maps import export as conversion

    outcome = conversion.export(surface, file, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
