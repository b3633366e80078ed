"""`surfuse reproduce`: the paper's three experiments in one report."""

from __future__ import annotations

import typer

from surfuse.cli import _options as options

HELP = """Acquire the paper's three scenes and show every fusion method on the same readings, in one report.

\b
Example:
    surfuse reproduce --out runs/paper
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("reproduce", help=HELP)(reproduce)


def reproduce(
    out: options.Out = None,
    cell: options.Cell = None,
    assignments: options.Set = None,
    seed: options.Seed = None,
    arm_driver: options.ArmDriver = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Run the three experiments."""
    from surfuse import settings
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.acquire import reproduction

    texts = [*options.overrides(assignments, None, seed), *options.arm_overrides(None, None, arm_driver)]
    configuration = settings.load(cell, texts)
    with TerminalWatcher(quiet or as_json) as watcher:
        outcome = reproduction.reproduce(configuration, out, watcher)
    return options.show(outcome.summary, outcome.table, as_json, quiet, outcome.complete)
