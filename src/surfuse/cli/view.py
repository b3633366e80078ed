"""`surfuse view`: look at a run in the browser, live."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli._numbers import PORT_MAX, Whole

HELP = """Serve the 3-D view of a run on this machine only, until Ctrl-C.

From elsewhere: ssh -L 8080:127.0.0.1:8080 user@host, then open the printed address.

\b
Example:
    surfuse view runs/mine --port 8080
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("view", help=HELP)(view)


def view(
    run: Annotated[Path, typer.Argument(help="Run folder or map file.")],
    port: Annotated[
        int,
        typer.Option("--port", help="Port on 127.0.0.1; 0: any free one.", parser=Whole(0, PORT_MAX), metavar="PORT"),
    ] = 0,
) -> None:
    """Serve until interrupted."""
    from surfuse.commands.maps import report as reporting

    reporting.view(run, port)
