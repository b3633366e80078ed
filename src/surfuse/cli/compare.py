"""`surfuse compare`: fusion methods on equal readings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.errors import UsageError

HELP = """Run every fusion method on the same readings; with --truth, print the errors of each; with --out, draw them.

\b
Example:
    surfuse compare readings.csv --truth truth.ply --out runs/methods
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compare", help=HELP)(compare)


def compare(
    log: Annotated[Path, typer.Argument(help="Run folder, .mcap or .csv.")],
    truth: Annotated[Path | None, typer.Option("--truth", help="Mesh or map.")] = None,
    scale: options.Scale = 1.0,
    truth_frame: options.TruthFrame = "auto",
    out: options.Out = None,
    assignments: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Compare."""
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.judge import method_comparison
    from surfuse.commands.judge.truth_files import TruthFrame

    wanted = None if truth is None else method_comparison.TruthFile(truth, scale, TruthFrame(truth_frame))
    if truth is None and (scale != 1.0 or truth_frame != "auto"):
        raise UsageError("--scale or --truth-frame without --truth", cure="give the truth, or leave them out")
    with TerminalWatcher(quiet or as_json, checkpoints=False) as watcher:
        outcome = method_comparison.compare(log, wanted, out, options.overrides(assignments, None, None), watcher)
    return options.show(outcome.summary, outcome.table, as_json, quiet)
