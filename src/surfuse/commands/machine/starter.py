"""A folder to start from: a cell file that runs as it is, a bridge for it, and a log to fuse."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

from surfuse import durable
from surfuse.commands.outcome import Outcome
from surfuse.errors import StorageError

CELL, BRIDGE, LOG = "rig.toml", "bridge.py", "readings.csv"
# Shipped as text: the checks of the package are not for a program of the user's.
SHIPPED = {
    CELL: "rig.toml",
    BRIDGE: "bridge.py.txt",
    LOG: "readings.csv",
    "sensors.toml": "sensors.toml",
    "frame.toml": "frame.toml",
}


def start(folder: Path, overwrite: bool) -> Outcome:
    """Write the files, all or none, and say what to do with them.

    Raises
    ------
    StorageError : one of them is there, or the folder cannot be written.
    """
    there = [name for name in SHIPPED if (folder / name).exists()]
    if there and not overwrite:
        raise StorageError(
            f"{', '.join(there)} would be overwritten",
            where=str(folder),
            cure="give another folder, or --force to replace them",
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise durable.storage_error(error, folder, "create the folder") from error
    for name in SHIPPED:
        durable.write_text(folder / name, shipped(name), overwrite=overwrite)
    written = [str(folder / name) for name in SHIPPED]
    return Outcome({"folder": str(folder), "files": written}, _what_next(folder))


def shipped(name: str) -> str:
    """The text of a file; the cell file names Python as this system does."""
    text = files(__package__).joinpath("starter", SHIPPED[name]).read_text("utf-8")
    return text.replace('"python3"', '"python"') if name == CELL and os.name == "nt" else text


def _what_next(folder: Path) -> list[tuple[str, str]]:
    return [
        ("written", f"{', '.join(SHIPPED)} in {folder}"),
        *([] if folder.resolve() == Path.cwd() else [("first", f"cd {folder}")]),
        ("a log of yours", f"surfuse fuse {LOG}"),
        ("a scan", f"surfuse acquire --cell {CELL} --yes   (bridge.py pretends to be a gantry: nothing moves)"),
        (
            "your rig",
            f"put your robot into {BRIDGE}, your sensors into {CELL}; docs/how-to/real_rig.md goes through it",
        ),
    ]
