"""`surfuse report`: write the page of a run again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Write the report of a run (again).

\b
Examples:
    surfuse report runs/mine --force
    surfuse report runs/mine --file /tmp/mine.html
    surfuse report runs/mine --against carving --force
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", help=HELP)(report)


def report(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    file: Annotated[Path | None, typer.Option("--file", help="Where to; default: report.html in the run.")] = None,
    against: Annotated[
        str | None,
        typer.Option(
            "--against", help="Method to show beside the run's; default: the paper's, or beam for the paper's."
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write the page."""
    from surfuse.commands.maps import report as reporting

    outcome = reporting.report(run, file, force, against)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
