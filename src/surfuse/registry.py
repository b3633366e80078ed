"""Name -> plug-in: every file of a plug-in folder is one, imported only when it is asked for."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType

from surfuse.errors import ConfigError, UsageError, nearest
from surfuse.extras import missing_package

KINDS = ("cameras", "arms", "sensors", "fusion", "exporters")


@cache
def names(kind: str) -> tuple[str, ...]:
    """Sorted names of the plug-ins of a kind: files of its folder, then entry points `surfuse.<kind>`."""
    if kind not in KINDS:
        raise UsageError(f"unknown kind of plug-in '{kind}'", cure=nearest(kind, KINDS))
    folder = importlib.import_module(f"surfuse.{kind}")
    own = {module.name for module in pkgutil.iter_modules(folder.__path__) if not module.ispkg}
    return tuple(sorted(own | {point.name for point in entry_points(group=f"surfuse.{kind}")}))


def load(kind: str, name: str) -> ModuleType:
    """Import one plug-in.

    Raises
    ------
    UsageError : no such name (the nearest valid name is given).
    ConfigError : the plug-in needs a package that is not installed.
    """
    if name not in names(kind):
        raise UsageError(f"unknown {kind} plug-in '{name}'", cure=nearest(name, names(kind)))
    try:
        for point in entry_points(group=f"surfuse.{kind}"):
            if point.name == name:
                module = point.load()
                break
        else:
            module = importlib.import_module(f"surfuse.{kind}.{name}")
    except ModuleNotFoundError as error:
        raise missing_package(error, f"{kind} plug-in '{name}'") from error
    if not isinstance(module, ModuleType):
        raise ConfigError(
            f"entry point '{name}' of surfuse.{kind} is {module!r}, not a module", cure="point it at a module"
        )
    return module
