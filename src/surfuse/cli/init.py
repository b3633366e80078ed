"""`surfuse init`: a folder to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Write a commented cell file, a bridge for it and a sample log, and say what to do next.

\b
Examples:
    surfuse init    (into this folder)
    surfuse init my_rig && cd my_rig && surfuse acquire --cell rig.toml
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("init", help=HELP)(init)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to write into; default: this one.")] = Path(),
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Write them."""
    from surfuse.commands.machine import starter

    outcome = starter.start(folder, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
