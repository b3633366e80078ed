"""`surfuse record`: somebody else moves the arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import Real

if TYPE_CHECKING:
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.acquire.recording_shown import Tally
    from surfuse.commands.outcome import Outcome
    from surfuse.commands.show.observer import ScanObserver

HELP = """Record while somebody else moves the arm, until Ctrl-C; then fuse what was seen.

Nothing is moved by surfuse: a person guides the arm, or its own program runs. The arm may be one of a bridge that
says "arm": null.

\b
Examples:
    surfuse record --cell rig.toml
    surfuse record --cell rig.toml --view    (open the printed address in a browser)
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
    view: options.View = False,
    view_port: options.ViewPort = 0,
    assignments: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Record and fuse."""
    from surfuse import settings
    from surfuse.cli._watching import watched_command

    configuration = settings.load(cell, options.overrides(assignments, method, None))

    def job(watcher: TerminalWatcher, observer: ScanObserver) -> Outcome:
        # The import takes seconds: it comes while the watcher shows that something goes on.
        from surfuse.commands.acquire import recording

        def show(tally: Tally) -> None:
            watcher.count(tally.in_words(), tally.sweeps)

        return recording.record_run(configuration, out, watcher, minutes, show, observer)

    return watched_command(job, as_json, quiet, view_port if view else None)
