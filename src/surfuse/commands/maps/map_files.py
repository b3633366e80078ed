"""Maps by file name: the suffix chooses the format, a run folder means its native map."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from surfuse import registry
from surfuse.errors import ConfigError, DataError, StorageError, UsageError, nearest
from surfuse.exporters import csv
from surfuse.records import SurfaceMap

NATIVE = "surface.nc"
LOG_SUFFIXES = (".csv", ".mcap", "")
MESH_SUFFIXES = (".ply", ".stl", ".obj", ".glb", ".off")


def format_of(path: Path) -> ModuleType:
    """The exporter module for a file name.

    Raises
    ------
    UsageError : no format has that suffix.
    ConfigError : the format needs a package that is not installed.
    """
    formats, suffix = _formats(path.suffix.lower()), path.suffix.lower()
    if suffix not in formats:
        raise UsageError(f"'{path.name}': no map format has the suffix '{suffix}'", cure=nearest(suffix, formats))
    return formats[suffix]


def _formats(wanted: str) -> dict[str, ModuleType]:
    """Suffix -> format, of all formats whose packages are installed; that of the wanted suffix must be.

    Formats of other packages are looked at only for a suffix that no built-in one has.
    """
    formats: dict[str, ModuleType] = {}
    for name in registry.found("exporters").built_in:
        try:
            module = registry.load("exporters", name)
        except ConfigError:
            # Its package is not installed: that matters only to who asks for this format.
            if wanted == f".{name}":
                raise
            continue
        formats.update(dict.fromkeys(module.SUFFIXES, module))
    if wanted not in formats:
        others = [one.name for one in registry.listing("exporters").plug_ins if wanted in one.suffixes]
        if others:
            formats[wanted] = registry.load("exporters", others[0])
    return formats


def map_path(path: Path) -> Path:
    """The file behind a MAP argument: itself, or the native map of a run folder."""
    if path.is_dir():
        if not (path / NATIVE).is_file():
            raise DataError(f"the folder holds no {NATIVE}", cure="give a map file or a finished run", where=str(path))
        return path / NATIVE
    if not path.exists():
        mesh = "a mesh, " if path.suffix.lower() in MESH_SUFFIXES else ""
        raise StorageError("no such file or folder", cure=f"give {mesh}a map file or a run folder", where=str(path))
    return path


def is_map_file(path: Path) -> bool:
    """Whether a file is a map rather than a log, by its suffix; a CSV by its first line."""
    suffix = path.suffix.lower()
    if suffix == ".csv" and path.is_file():
        with path.open("rb") as stream:
            return stream.readline().lstrip(b"\xef\xbb\xbf").startswith(csv.MARK.encode())
    return suffix not in LOG_SUFFIXES and (suffix in MESH_SUFFIXES or suffix in _formats(suffix))


def read_map(path: Path) -> SurfaceMap:
    """Read a map file, or the map of a run folder.

    Raises
    ------
    DataError : the file is of no kind that holds a map which can be read back; or it is damaged.
    """
    file = map_path(path)
    suffix = file.suffix.lower()
    formats = _formats(suffix)
    chosen = formats.get(suffix)
    read = None if chosen is None else vars(chosen).get("read")
    if read is None:
        why = "" if chosen is None else f" ({chosen.NOT_READ})"
        readable = ", ".join(key for key, module in sorted(formats.items()) if "read" in vars(module))
        truth = "; the mesh of a true shape goes to --truth" if suffix in MESH_SUFFIXES else ""
        raise DataError(
            f"a {suffix or 'file without suffix'} holds no map that can be read back{why}",
            cure=f"give a run folder or a map as {readable}{truth}",
            where=str(file),
        )
    surface: SurfaceMap = read(file)
    return surface
