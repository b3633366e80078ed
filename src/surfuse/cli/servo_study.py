"""`surfuse servo-study`: the old arm controller against the new control laws."""

from __future__ import annotations

from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import Whole

HELP = """Compare the arm's old controller with the control laws of the servo cards, in the twin.

\b
Example:
    surfuse servo-study --out runs/servo
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("servo-study", help=HELP)(servo_study)


def servo_study(
    stops: Annotated[
        int,
        typer.Option(
            "--stops", help="Stops of the scan that the laws are compared on.", parser=Whole(1, 100_000), metavar="N"
        ),
    ] = 50,
    out: options.Out = None,
    cell: options.Cell = None,
    assignments: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Compare."""
    from surfuse import settings
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.servo.servo_study import servo_study as study

    configuration = settings.load(cell, options.overrides(assignments, None, None))
    with TerminalWatcher(quiet or as_json, checkpoints=False) as watcher:
        outcome = study(configuration, out, stops, watcher)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
