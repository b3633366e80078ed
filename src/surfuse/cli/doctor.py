"""`surfuse doctor`: what is installed, connected, reachable, calibrated."""

from __future__ import annotations

import typer

from surfuse.cli import _options as options


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("doctor", help="Say what is installed, connected, reachable and calibrated.")(doctor)


def doctor(cell: options.Cell = None, assignments: options.Set = None, as_json: options.Json = False) -> int:
    """Check; status 3 when something is wrong, so that a script can ask."""
    from surfuse.commands.machine import doctor
    from surfuse.errors import ConfigError

    outcome = doctor.doctor(cell, list(assignments or []))
    shown = options.show(outcome.summary, outcome.table, as_json, quiet=False)
    return ConfigError.exit_status if outcome.summary["problems"] else shown
