"""Maps by file name: the suffix chooses the format, a run folder means its native map."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from surfuse import registry
from surfuse.errors import ConfigError, DataError, StorageError, UsageError, nearest
from surfuse.records import SurfaceMap

NATIVE = "surface.nc"


def format_of(path: Path) -> ModuleType:
    """The exporter module for a file name.

    Raises
    ------
    UsageError : no format has that suffix.
    ConfigError : the format needs a package that is not installed.
    """
    suffixes: dict[str, str] = {}
    suffix = path.suffix.lower()
    for name in registry.names("exporters"):
        try:
            module = registry.load("exporters", name)
        except ConfigError:
            # Its package is not installed: that matters only to who asks for this format.
            if suffix == f".{name}":
                raise
            continue
        suffixes.update(dict.fromkeys(module.SUFFIXES, name))
    if suffix not in suffixes:
        raise UsageError(f"'{path.name}': no map format has the suffix '{suffix}'", cure=nearest(suffix, suffixes))
    return registry.load("exporters", suffixes[suffix])


def map_path(path: Path) -> Path:
    """The file behind a MAP argument: itself, or the native map of a run folder."""
    if path.is_dir():
        if not (path / NATIVE).is_file():
            raise DataError(f"the folder holds no {NATIVE}", cure="give a map file or a finished run", where=str(path))
        return path / NATIVE
    if not path.exists():
        raise StorageError("no such file or folder", cure="give a map file or a run folder", where=str(path))
    return path


def read_map(path: Path) -> SurfaceMap:
    """Read a map file, or the map of a run folder."""
    file = map_path(path)
    surface: SurfaceMap = format_of(file).read(file)
    return surface
