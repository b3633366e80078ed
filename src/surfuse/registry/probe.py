"""What the process says that imports a plug-in of another package before the program does; see `listed`."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint

from surfuse.registry.form import faults
from surfuse.registry.listed import MARK


def tell(kind: str, name: str, value: str, group: str) -> None:
    """Import the plug-in and print one line on it."""
    wrong, summary, suffixes = "", "", ()
    try:
        module = EntryPoint(name, value, group).load()
        wrong = faults(kind, module)
        if not wrong:
            summary = " ".join(module.SUMMARY.split())
            suffixes = getattr(module, "SUFFIXES", ())
    except BaseException as error:  # SystemExit too
        wrong = " ".join(f"it cannot be imported: {type(error).__name__}: {error}".split())
    told = {"name": name, "wrong": wrong, "summary": summary, "suffixes": suffixes}
    print("\n" + MARK + json.dumps(told), flush=True)
