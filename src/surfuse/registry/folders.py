"""What plug-ins there are, and how one is imported: built-in ones are the files of their folders.

Other packages add theirs by entry points `surfuse.<kind>` that point at modules. Nothing of them is imported until one
is asked for by its name, or listed; none of them can take the place of a built-in one.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, distributions, entry_points
from types import ModuleType

from surfuse.errors import ConfigError, UsageError, nearest
from surfuse.extras import missing_package
from surfuse.registry.form import faults

PACKAGES = {
    "arms": "surfuse.arms",
    "cameras": "surfuse.cameras",
    "control_laws": "surfuse.motion.control",
    "exporters": "surfuse.exporters",
    "fusion": "surfuse.fusion",
    "sensors": "surfuse.sensors",
}
NOUNS = {
    "arms": "arm driver",
    "cameras": "camera driver",
    "control_laws": "control law",
    "exporters": "map format",
    "fusion": "fusion method",
    "sensors": "sensor driver",
}
KINDS = tuple(PACKAGES)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True)
class Found:
    """The plug-ins of a kind: names of the built-in ones, those of other packages, and one line on each refused one."""

    built_in: tuple[str, ...]
    others: Mapping[str, EntryPoint]
    refused: tuple[str, ...]


@cache
def found(kind: str) -> Found:
    """All plug-ins of a kind; nothing is imported.

    Raises
    ------
    UsageError : no such kind.
    """
    if kind not in KINDS:
        raise UsageError(f"unknown kind of plug-in '{kind}'", cure=nearest(kind, KINDS))
    folder = importlib.import_module(PACKAGES[kind])
    built_in = sorted(module.name for module in pkgutil.iter_modules(folder.__path__) if not module.ispkg)
    points, refused = _entry_points(f"surfuse.{kind}")
    others: dict[str, EntryPoint] = {}
    for point in sorted(points, key=lambda point: (owner(point), point.value)):
        who = f"{NOUNS[kind]} {point.name!r} of {owner(point)} is left out"
        if not _NAME.fullmatch(point.name):
            refused.append(f"{who}: a name has letters, digits, '_', '-' and '.'")
        elif point.name in built_in:
            refused.append(f"{who}: that is the name of a built-in one")
        elif point.name in others:
            refused.append(f"{who}: {owner(others[point.name])} has one of that name")
        else:
            others[point.name] = point
    return Found(tuple(built_in), others, tuple(refused))


def names(kind: str) -> tuple[str, ...]:
    """Sorted names of the plug-ins of a kind, those of other packages included."""
    here = found(kind)
    return tuple(sorted((*here.built_in, *here.others)))


def load(kind: str, name: str) -> ModuleType:
    """Import one plug-in.

    Raises
    ------
    UsageError : no such name (the nearest valid name is given).
    ConfigError : the plug-in needs a package that is not installed, or that of another package cannot be imported or
        is none.
    """
    here = found(kind)
    if name in here.others:
        return _load_other(kind, here.others[name])
    if name not in here.built_in:
        raise UsageError(f"unknown {NOUNS[kind]} '{name}'", cure=nearest(name, names(kind)))
    try:
        return importlib.import_module(f"{PACKAGES[kind]}.{name}")
    except ModuleNotFoundError as error:
        raise missing_package(error, f"{NOUNS[kind]} '{name}'") from error


def owner(point: EntryPoint) -> str:
    """The package that an entry point belongs to."""
    try:
        name = point.dist.name if point.dist is not None else ""
    except Exception:  # its metadata are missing or damaged
        name = ""
    return f"the package '{name}'" if name else "an unknown package"


def _load_other(kind: str, point: EntryPoint) -> ModuleType:
    who = f"{NOUNS[kind]} '{point.name}' of {owner(point)}"
    cure = "correct that package, or remove it"
    try:
        module = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever it raises, SystemExit too: it ends neither the program nor its message
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigError(f"{who} cannot be imported: {why}", cure=cure) from error
    wrong = faults(kind, module)
    if wrong:
        raise ConfigError(f"{who} is no plug-in: {wrong}", cure=cure)
    assert isinstance(module, ModuleType)
    return module


def _entry_points(group: str) -> tuple[list[EntryPoint], list[str]]:
    """The entry points of a group, and one line on each package whose own cannot be read."""
    try:
        return list(entry_points(group=group)), []
    except Exception:  # one package with a damaged list makes them all unreadable: look at each
        points: list[EntryPoint] = []
        damaged: list[str] = []
        for package in distributions():
            try:
                points += package.entry_points.select(group=group)
            except Exception as error:
                damaged.append(f"the package '{package.name}' is left out: its entry points are damaged ({error})")
        return points, damaged
