"""Giving maps to other programs, and naming what is plugged in."""

from __future__ import annotations

from pathlib import Path

from surfuse.commands.maps.map_files import format_of, read_map
from surfuse.commands.outcome import Outcome


def export(surface_path: Path, file: Path, overwrite: bool) -> Outcome:
    """Write a map in the format of the file's suffix; an existing file is kept unless asked."""
    chosen = format_of(file)
    surface = read_map(surface_path)
    chosen.write(file, surface, overwrite=overwrite)
    size, prior = file.stat().st_size, int((surface.mask & ~surface.measured).sum())
    rows = [("written", f"{file} ({size} bytes): {chosen.SUMMARY}")]
    if prior:
        what = "marked" if chosen.MARKS_PRIOR else "left out, the format cannot mark them"
        rows.append(("prior only", f"{prior} cells that no reading holds are {what}"))
    return Outcome({"file": str(file), "bytes": size, "prior_cells": prior}, rows)
