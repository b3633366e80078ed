"""`surfuse why`: the readings behind a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Why the cell at U, V (mm, part frame) has its value: stops, poses, ranges, degrees of confidence, refusals.

MAP is a run folder or its surface.nc. The readings come from the run's log, or from the log that it was made from.

\b
Examples:
    surfuse why runs/mine 0 100
    surfuse why runs/mine -12.5 40 --json
    surfuse why surface.nc 0 100 --log readings.csv
"""


def register(app: typer.Typer) -> None:
    """Add the command; a negative number is a coordinate, not an option."""
    app.command("why", help=HELP, context_settings={"ignore_unknown_options": True})(why)


def why(
    surface: Annotated[Path, typer.Argument(metavar="MAP", help="Run folder or its surface.nc.")],
    u_mm: Annotated[float, typer.Argument(metavar="U", help="Along the scan line, mm.")],
    v_mm: Annotated[float, typer.Argument(metavar="V", help="Up from the table, mm.")],
    log: Annotated[Path | None, typer.Option("--log", help="The log of the map, when it lies elsewhere.")] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Explain a cell."""
    from surfuse.commands.explain import why as work

    outcome = work.why(surface, u_mm, v_mm, log)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
