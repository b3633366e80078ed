"""`surfuse threshold`: the threshold methods on any picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surfuse.cli import _options as options

HELP = """Threshold a picture by one or all of the four methods.

\b
Examples:
    surfuse threshold photo.png
    surfuse threshold photo.png --method all --mask truth.png --json
    surfuse threshold photo.png --out methods.png
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("threshold", help=HELP)(threshold)


def threshold(
    image: Annotated[Path, typer.Argument(help="Picture file.")],
    method: Annotated[
        str, typer.Option("--method", help="otsu, maximum_entropy, uniform_error, minimum_error, all.")
    ] = "all",
    mask: Annotated[Path | None, typer.Option("--mask", help="Reference mask: non-zero is the part.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="PNG file: picture, histogram and foregrounds side by side.")
    ] = None,
    polarity: Annotated[
        str, typer.Option("--polarity", help="Parts are bright, dark, or (auto) unlike the picture's rim.")
    ] = "auto",
    force: options.Force = False,
    as_json: options.Json = False,
) -> int:
    """Threshold."""
    from surfuse.commands.pictures import threshold_comparison

    outcome = threshold_comparison.threshold(image, method, mask, out, polarity, force)
    return options.show(outcome.summary, outcome.table, as_json, quiet=False)
