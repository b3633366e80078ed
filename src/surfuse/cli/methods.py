"""`surfuse methods`: the fusion methods, one line each."""

from __future__ import annotations

import typer

from surfuse.cli import _options as options


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("methods", help="List the fusion methods, one line each.")(methods)


def methods(as_json: options.Json = False) -> int:
    """List."""
    from surfuse.commands.fuse import methods

    lines = methods.method_lines(options.note)
    return options.show({"methods": dict(lines)}, lines, as_json, quiet=False)
