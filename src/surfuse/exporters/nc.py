"""NetCDF4 with CF conventions: the native map format, all layers and (optionally) the fused points."""

from __future__ import annotations

from pathlib import Path

from surfuse.durable import replacing
from surfuse.map_files.native import write_native
from surfuse.map_files.native_reader import read_native, read_native_points
from surfuse.records import FusedPoints, SurfaceMap

SUFFIXES = (".nc", ".nc4")
SUMMARY = "NetCDF4, CF-1.11: all layers to the last bit (native)"
MARKS_PRIOR = True


def write(path: Path, surface: SurfaceMap, overwrite: bool = False, points: FusedPoints | None = None) -> None:
    """Write a map, with the fused points that it was made from when they are given; atomic and synced.

    Raises
    ------
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    with replacing(path, overwrite=overwrite) as temporary:
        write_native(temporary, surface, points)


def read(path: Path) -> SurfaceMap:
    """Read a map back, bit by bit.

    Raises
    ------
    DataError : not there, not a map of ours, newer, or damaged.
    """
    return read_native(path)


def read_points(path: Path) -> FusedPoints | None:
    """The fused points stored with the map (why a cell has its value), or None."""
    return read_native_points(path)
