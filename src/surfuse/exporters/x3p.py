"""X3P (ISO 5436-2, now ISO 25178-72): heights only, in the revision of 2000 that other programs read."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import x3pio

from surfuse import __version__
from surfuse.durable import write_bytes
from surfuse.errors import DataError, StorageError
from surfuse.map_files.heights import equal_step, heights_or_nan, map_of_heights
from surfuse.map_files.placement import placement_in, placement_text
from surfuse.records import SurfaceMap

SUFFIXES = (".x3p",)
SUMMARY = "X3P (ISO 5436-2): heights for surface metrology programs"
MARKS_PRIOR = False
_MAX_BYTES = 1 << 30


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the heights as float64; cells that no reading holds are marked as not measured.

    Raises
    ------
    DataError : the steps of the map are not equal, or no cell has a value.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    du, dv = equal_step(surface.grid.u_m, "u"), equal_step(surface.grid.v_m, "v")
    today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    buffer = io.BytesIO()
    x3pio.write(
        buffer,
        heights_or_nan(surface),
        x_scale=du,
        y_scale=dv,
        revision=x3pio.Revision.ISO5436_2000,
        metadata=replace(
            x3pio.Metadata.for_software("surfuse", __version__, date=today),
            comment=placement_text(surface.grid, from_first_node=True),
        ),
    )
    write_bytes(path, buffer.getvalue(), overwrite=overwrite)


def read(path: Path) -> SurfaceMap:
    """Read the first layer of a surface as a map.

    In a file of anyone else the part frame is the world, its origin the first point.

    Raises
    ------
    DataError : not there, not X3P, not a regular surface, damaged (checksums are verified), or bigger than 1 GiB.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > _MAX_BYTES:
            raise DataError(f"unpacks to {size} bytes, at most {_MAX_BYTES} are read", where=str(path))
        file = x3pio.read(path)
    except FileNotFoundError as error:
        raise DataError("there is no such map file", where=str(path)) from error
    except OSError as error:
        raise StorageError(f"cannot be read: {error.strerror}", where=str(path)) from error
    except (x3pio.X3pError, zipfile.BadZipFile, ValueError, OverflowError, MemoryError) as error:
        raise DataError(f"not a sound X3P file: {error}", where=str(path), cure="export it again") from error
    if not isinstance(file, x3pio.Surface) or not file.is_regular_grid:
        raise DataError("the file holds no surface on a regular grid", where=str(path), cure="give an areal surface")
    where = placement_in((file.metadata.comment if file.metadata is not None else None) or "")
    return map_of_heights(file.layers[0].z, file.header.x.increment, file.header.y.increment, "x3p", where)
