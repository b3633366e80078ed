"""`surfuse threshold-study`: the four thresholds over simulated pictures, against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import SEED_MAX, Whole

HELP = """Compare the four thresholds over simulated pictures of the cell, against the true mask of the part.

Conditions: plain, illumination gradient, low contrast, noise, small part, shiny part.

\b
Examples:
    surfuse threshold-study
    surfuse threshold-study --scenes 100 --seed 2 --out study.csv
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("threshold-study", help=HELP)(threshold_study)


def threshold_study(
    scenes: Annotated[
        int, typer.Option("--scenes", help="Pictures of each condition.", parser=Whole(1, 10000), metavar="N")
    ] = 30,
    seed: Annotated[
        int, typer.Option("--seed", help="Seed of everything that is random.", parser=Whole(0, SEED_MAX), metavar="N")
    ] = 1,
    out: Annotated[Path | None, typer.Option("--out", help="CSV file for the table.")] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Run the study."""
    from surfuse.commands.pictures import threshold_study as work

    outcome = work.threshold_study(scenes, seed, out, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
