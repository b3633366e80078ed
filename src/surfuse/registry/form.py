"""What a plug-in module must have."""

from __future__ import annotations

import dataclasses
from types import ModuleType


def faults(kind: str, module: object) -> str:
    """What a module lacks to be a plug-in of this kind; empty when it is one."""
    if not isinstance(module, ModuleType):
        return f"its entry point is {type(module).__name__}, not a module"
    has = vars(module)
    wrong = [] if isinstance(has.get("SUMMARY"), str) else ["SUMMARY (one line)"]
    if kind == "exporters":
        suffixes = has.get("SUFFIXES")
        if not (isinstance(suffixes, tuple) and suffixes and all(isinstance(one, str) for one in suffixes)):
            wrong.append("SUFFIXES ('.abc', ...)")
        wrong += [] if isinstance(has.get("MARKS_PRIOR"), bool) else ["MARKS_PRIOR (bool)"]
        wrong += [] if callable(has.get("write")) else ["write(path, surface, overwrite)"]
        wrong += [] if callable(has.get("read")) or isinstance(has.get("NOT_READ"), str) else ["read(path) or NOT_READ"]
    else:
        of_plug_in = has.get("Parameters")
        if not (isinstance(of_plug_in, type) and dataclasses.is_dataclass(of_plug_in)):
            wrong.append("Parameters (a frozen dataclass)")
        wrong += [] if callable(has.get("create")) else ["create(parameters)"]
    return f"it has no {', '.join(wrong)}" if wrong else ""
