"""`surfuse bridge`: the twin as a rig behind the bridge protocol."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import PORT_MAX, Real, Whole

HELP = """Serve the built-in twin of a cell file as a rig behind the bridge protocol, for programs that speak it.

With --wires every device is served at the protocol of its driver: pseudo-terminals, RTDE, IIO files, CAN nodes.

\b
Examples:
    surfuse bridge --port 5005    (the paper's cell, on this computer only)
    surfuse bridge --cell cell.toml --port 5005 --set scene.name=tilted
    surfuse bridge --cell rig.toml --wires wired.toml    (then: surfuse acquire --cell wired.toml)
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
    wires: Annotated[
        Path | None,
        typer.Option(
            "--wires", help="Serve each device at its maker's protocol; write the cell file with the addresses."
        ),
    ] = None,
    times_faster: Annotated[
        float,
        typer.Option(
            "--times-faster",
            parser=Real(0.1, 1000.0),
            metavar="NUMBER",
            help="With --wires: than the real sensors, 0.1 to 1000.",
        ),
    ] = 1.0,
    assignments: options.Set = None,
    seed: options.Seed = None,
) -> int:
    """Serve until Ctrl-C."""
    from surfuse import settings
    from surfuse.commands.machine import bridge_program
    from surfuse.commands.machine.node_program import ended_by_signals
    from surfuse.errors import UsageError

    configuration = settings.load(cell, options.overrides(assignments, None, seed))

    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    if wires is not None and cell is None:
        raise UsageError("--wires without a cell file", cure="give --cell FILE: its devices are served")
    with ended_by_signals() as stop:
        if wires is None or cell is None:
            bridge_program.serve_twin(configuration, port, stop, say)
        else:
            job = bridge_program.WiresJob(cell, wires, port or 0, times_faster)
            bridge_program.serve_wires(configuration, job, stop, say)
    return 0
