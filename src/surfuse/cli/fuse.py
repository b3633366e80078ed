"""`surfuse fuse`: fuse recorded readings again, of this or any other rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Fuse readings: LOG is a run folder, an .mcap file or a readings .csv (or a folder that holds readings.csv).

Beside a CSV, sensors.toml, frame.toml and outline.csv are used when they exist. With any log, those given as options
win over what the log says.

\b
Examples:
    surfuse fuse readings.csv --out runs/mine
    surfuse fuse runs/relief-20260314-101500 --method median --out runs/again
    surfuse fuse scan.csv --sensors rig.toml --set fusion.parameters.weighted_average.use_dc1=false
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("fuse", help=HELP)(fuse)


def fuse(
    log: Annotated[Path, typer.Argument(help="Run folder, .mcap or .csv.")],
    out: options.Out = None,
    method: options.Method = None,
    sensors: Annotated[
        Path | None, typer.Option("--sensors", help="sensors.toml of the log, or its corrections.")
    ] = None,
    frame: Annotated[Path | None, typer.Option("--frame", help="frame.toml: the part frame.")] = None,
    outline: Annotated[
        Path | None, typer.Option("--outline", help="outline.csv: columns u,v in the part frame.")
    ] = None,
    assignments: options.Set = None,
    seed: options.Seed = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fuse a log."""
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.fuse import fuse_log as replay

    with TerminalWatcher(quiet or as_json, checkpoints=False) as watcher:
        outcome = replay.fuse(
            log,
            out,
            watcher,
            overrides=options.overrides(assignments, method, seed),
            sensors=sensors,
            frame=frame,
            outline=outline,
        )
    return options.show(outcome.summary, outcome.table, as_json, quiet, outcome.complete)
