"""`surfuse devices`: what is plugged into this machine."""

from __future__ import annotations

import typer

from surfuse.cli import _options as options

HELP = """List serial ports, CAN adapters, cameras and IIO devices, and what seems to be on them; nothing is opened.

Then all drivers, with what they still need.

\b
Examples:
    surfuse devices
    surfuse devices --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("devices", help=HELP)(devices)


def devices(as_json: options.Json = False) -> int:
    """List."""
    from surfuse.commands.machine import devices as listing

    outcome = listing.devices()
    return options.show(outcome.summary, outcome.table, as_json, quiet=False)
