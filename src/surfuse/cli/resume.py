"""`surfuse resume`: go on with an interrupted acquisition."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Go on with an interrupted acquisition, from the first stop that is not on disk.

\b
Example:
    surfuse resume runs/relief-20260314-101500
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("resume", help=HELP)(resume)


def resume(
    run: Annotated[Path, typer.Argument(help="Folder of the interrupted run.")],
    yes: options.Yes = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Finish the run."""
    from surfuse.cli._progress import TerminalWatcher

    with TerminalWatcher(quiet or as_json) as watcher:
        # The import takes seconds: it comes while the watcher shows that something goes on.
        from surfuse.commands.acquire import acquisition

        outcome = acquisition.resume(run, watcher, watcher.asker(), yes)
    return options.show(outcome.summary, outcome.table, as_json, quiet, outcome.complete)
