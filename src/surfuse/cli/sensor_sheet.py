"""`surfuse sensor-sheet`: the data sheet of a ranger."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import SEED_MAX, Whole

HELP = """Draw the data sheet of a ranger: beam, errors, limits, noise; in the twin, or from a log with known truth.

\b
Examples:
    surfuse sensor-sheet polaroid --out polaroid.html
    surfuse sensor-sheet sensors.toml --sensor left --out left.svg --numbers left.json
    surfuse sensor-sheet sensors.toml --log readings.csv --truth part.ply --out measured.html
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("sensor-sheet", help=HELP)(sensor_sheet)


def sensor_sheet(
    spec: Annotated[str, typer.Argument(help="polaroid, polaroid_bare, or a sensors.toml.")],
    sensor: Annotated[str | None, typer.Option("--sensor", help="Which table of the sensors.toml.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Page (.html) or picture (.svg).")] = None,
    numbers: Annotated[Path | None, typer.Option("--numbers", help="JSON file of all numbers.")] = None,
    log: Annotated[Path | None, typer.Option("--log", help="Measured readings instead of the twin.")] = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="Mesh of the true surface, in the log's frame.")] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Seed of the twin; default 1.", parser=Whole(0, SEED_MAX), metavar="N")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Make the sheet."""
    from surfuse.commands.rangers import sensor_sheet as sheets

    source = sheets.SheetSource(log, truth, seed)
    outcome = sheets.sensor_sheet(spec, sensor, out, numbers, source, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
