"""`surfuse coverage`: is the stated standard deviation honest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """How often the truth lies within the 50, 90 and 99 % intervals of a map, overall and regime by regime.

LOG is a map file or a finished run (its map is taken as it is), or a log, which is fused first. With --method or --set
a run is fused again.

\b
Examples:
    surfuse coverage runs/mine --truth truth.ply
    surfuse coverage readings.csv --truth truth.ply --method median --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("coverage", help=HELP)(coverage)


def coverage(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Map file, run folder, .mcap or .csv.")],
    truth: Annotated[Path, typer.Option("--truth", help="Mesh (STL, PLY, OBJ), map file or run folder.")],
    scale: options.Scale = 1.0,
    truth_frame: options.TruthFrame = "auto",
    method: options.Method = None,
    assignments: options.Set = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Check the intervals."""
    from surfuse.cli._progress import TerminalWatcher
    from surfuse.commands.judge import coverage as work
    from surfuse.commands.judge.truth_files import TruthFrame

    with TerminalWatcher(quiet or as_json, checkpoints=False) as watcher:
        texts = options.overrides(assignments, method, None)
        outcome = work.coverage(log, truth, scale, texts, watcher, TruthFrame(truth_frame))
    return options.show(outcome.summary, outcome.table, as_json, quiet)
