"""`surfuse bridge`: the twin as a rig behind the bridge protocol."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import PORT_MAX, Whole

HELP = """Serve the built-in twin of a cell file as a rig behind the bridge protocol, for programs that speak it.

\b
Examples:
    surfuse bridge --port 5005    (the paper's cell, on this computer only)
    surfuse bridge --cell cell.toml --port 5005 --set scene.name=tilted
    surfuse bridge    (on standard input and output, as `command` in a cell file)
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("bridge", help=HELP)(bridge)


def bridge(
    cell: options.Cell = None,
    port: Annotated[
        int | None,
        typer.Option(
            "--port",
            parser=Whole(0, PORT_MAX),
            metavar="PORT",
            help="TCP port on loopback; 0: a free one; none: stdio.",
        ),
    ] = None,
    assignments: options.Set = None,
    seed: options.Seed = None,
) -> int:
    """Serve until Ctrl-C."""
    from surfuse import settings
    from surfuse.commands.machine import bridge_program
    from surfuse.commands.machine.node_program import ended_by_signals

    configuration = settings.load(cell, options.overrides(assignments, None, seed))
    with ended_by_signals() as stop:
        bridge_program.serve_twin(configuration, port, stop, lambda text: print(text, file=sys.stderr, flush=True))
    return 0
