"""`surfuse resume`: go on with an interrupted acquisition."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surfuse.cli import _options as options

if TYPE_CHECKING:
    from surfuse.commands.outcome import Outcome, Watcher
    from surfuse.commands.show.observer import ScanObserver

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
    view: options.View = False,
    view_port: options.ViewPort = 0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Finish the run."""
    from surfuse.cli._watching import watched_command

    def job(watcher: Watcher, observer: ScanObserver) -> Outcome:
        # The import takes seconds: it comes while the watcher shows that something goes on.
        from surfuse.commands.acquire import acquisition

        return acquisition.resume(run, watcher, observer, yes)

    return watched_command(job, as_json, quiet, view_port if view else None, not _moves_a_real_arm(run))


def _moves_a_real_arm(run: Path) -> bool:
    """Whether the first Ctrl-C must stop an arm; False for what is no run, which the job refuses."""
    from surfuse.errors import SurfuseError
    from surfuse.runs.configuration import read_configuration
    from surfuse.runs.folder import RunFolder
    from surfuse.settings import from_tree

    try:
        configuration = RunFolder(run).configuration
        return from_tree(read_configuration(configuration)[0], str(configuration)).arm.is_real
    except SurfuseError:
        return False
