"""`surfuse accept`: the acceptance test of a ranger."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options
from surfuse.cli._numbers import SEED_MAX, Whole

REFUSED = 1
HELP = """Test a ranger: accuracy, noise, dropouts, slips, drift, beam, incidence, cross-talk; exit status 1 if refused.

\b
Examples:
    surfuse accept polaroid --out accept.html --model model.toml
    surfuse accept polaroid --plant drift
    surfuse accept polaroid --material metal
    surfuse accept sensors.toml --log readings.csv --distances 0.4,0.6,0.8 --model model.toml
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("accept", help=HELP)(accept)


def accept(
    spec: Annotated[str, typer.Argument(help="polaroid, polaroid_bare, or a sensors.toml.")],
    sensor: Annotated[str | None, typer.Option("--sensor", help="Which table of the sensors.toml.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Page (.html).")] = None,
    model: Annotated[Path | None, typer.Option("--model", help="sensors.toml of what was measured.")] = None,
    log: Annotated[Path | None, typer.Option("--log", help="Readings of a facing plate, instead of the twin.")] = None,
    distances: Annotated[
        str | None, typer.Option("--distances", metavar="M,M,...", help="Distances in the log, in its order, in m.")
    ] = None,
    warm_up: Annotated[
        Path | None, typer.Option("--warm-up", help="Log of a plate that stands still, from switching on.")
    ] = None,
    plant: Annotated[str | None, typer.Option("--plant", help="Fault to plant in the twin.")] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Seed of the twin; default 1.", parser=Whole(0, SEED_MAX), metavar="N")
    ] = None,
    material: Annotated[
        str | None, typer.Option("--material", help="Of the plate that is tilted: painted, matte, metal or foam.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Test."""
    from surfuse.commands.rangers import acceptance

    metres = acceptance.metres(distances)
    source = acceptance.TrialSource(log, metres, warm_up, plant, seed, material)
    outcome = acceptance.accept(spec, sensor, out, model, source, force=force)
    options.show(outcome.summary, outcome.table, as_json, quiet)
    return 0 if outcome.summary["passed"] else REFUSED
