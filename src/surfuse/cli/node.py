"""`surfuse node`: the program of a sensor node."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import PORT_MAX, Whole

HELP = """Be a sensor node on a CAN bus until Ctrl-C: own rangers from a file, else simulated ones.

\b
Examples:
    surfuse node    (simulated, UDP multicast; then: surfuse acquire --node udp)
    surfuse node rangers.toml
    surfuse node rangers.toml --bus socketcan --channel can0
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("node", help=HELP)(node)


def node(
    file: Annotated[Path | None, typer.Argument(help="Node file (TOML) with [[sensor]] tables.")] = None,
    bus: Annotated[str | None, typer.Option("--bus", help="udp, or one of python-can's interfaces.")] = None,
    channel: Annotated[str | None, typer.Option("--channel", help="Name, port or group of the adapter.")] = None,
    port: Annotated[
        int | None, typer.Option("--port", help="UDP port.", parser=Whole(1024, PORT_MAX), metavar="PORT")
    ] = None,
    tether: Annotated[
        int | None,
        typer.Option(
            "--tether-port",
            help="TCP port for the host of simulated sensors; 0: none.",
            parser=Whole(0, PORT_MAX),
            metavar="PORT",
        ),
    ] = None,
    address: Annotated[
        int | None, typer.Option("--id", help="Address of the node, 1 to 7.", parser=Whole(1, 7), metavar="N")
    ] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Serve."""
    from surfuse.commands.machine import node_program

    keys: dict[str, object] = {
        "interface": {"udp": "udp_multicast"}.get(bus or "", bus),
        "channel": channel,
        "port": port,
        "tether_port": tether,
        "node": address,
    }

    def say(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    with node_program.ended_by_signals() as stop:
        outcome = node_program.node(file, keys, stop, say)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
