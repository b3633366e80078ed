"""`surfuse record`: somebody else moves the arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import Real

HELP = """Record while somebody else moves the arm, until Ctrl-C; then fuse what was seen.

Nothing is moved by surfuse: a person guides the arm, or its own program runs. The arm may be one of a bridge that
says "arm": null.

\b
Examples:
    surfuse record --cell rig.toml
    surfuse record --cell rig.toml --minutes 2 --out runs/by_hand
    surfuse fuse runs/by_hand --method median    (again, also after a crash)
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("record", help=HELP)(record)


def record(
    cell: Annotated[Path, typer.Option("--cell", help="Cell file (TOML) of the real rig.")],
    out: options.Out = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            "--minutes",
            parser=Real(0.0, 1e5, above=True),
            metavar="MINUTES",
            help="End after so many; default: at Ctrl-C.",
        ),
    ] = None,
    method: options.Method = None,
    assignments: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Record and fuse."""
    from surfuse import settings
    from surfuse.cli._progress import TerminalWatcher

    configuration = settings.load(cell, options.overrides(assignments, method, None))
    with TerminalWatcher(quiet or as_json) as watcher:
        from surfuse.commands.acquire import recording

        def show(tally: recording.Tally) -> None:
            watcher.count(f"record, {tally.rate_hz():.0f} sweeps/s", tally.sweeps)

        outcome = recording.record_run(configuration, out, watcher, minutes, show)
    return options.show(outcome.summary, outcome.table, as_json, quiet, outcome.complete)
