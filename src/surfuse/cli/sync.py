"""`surfuse sync`: the time lag between ranges and poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import Real

HELP = """Time lag between ranges and poses, for logs whose sensors moved while they read.

The lag is the shift of the poses under which all hit points agree best on one surface: planes that are fitted to the
readings, or the mesh given as truth. A range of time t belongs to the pose at t + lag.

\b
Examples:
    surfuse sync readings.csv
    surfuse sync flight.mcap --truth hall.ply --max-lag 200 --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("sync", help=HELP)(sync)


def sync(
    log: Annotated[Path, typer.Argument(help="Log of moving sensors: .mcap, .csv or a folder.")],
    truth: Annotated[Path | None, typer.Option("--truth", help="Mesh in the frame of the poses.")] = None,
    max_lag: Annotated[
        float, typer.Option("--max-lag", help="Search up to this lag, ms.", parser=Real(10.0, 5000.0), metavar="MS")
    ] = 500.0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Find the lag."""
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.calibrate import sync as work

    with TerminalWatcher(quiet or as_json, checkpoints=False) as watcher:
        outcome = work.sync(log, truth, max_lag, watcher)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
