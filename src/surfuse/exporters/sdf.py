"""SDF (ISO 25178-71): heights only, ISO-1.0 with int32, the dialect that Gwyddion and others read."""

from __future__ import annotations

import io
from pathlib import Path

import sdfio

from surfuse.durable import write_bytes
from surfuse.errors import DataError, StorageError
from surfuse.map_files.heights import equal_step, heights_or_nan, map_of_heights
from surfuse.map_files.placement import placement_in, placement_text
from surfuse.records import SurfaceMap

SUFFIXES = (".sdf",)
SUMMARY = "SDF (ISO 25178-71, ISO-1.0): heights for surface metrology programs"
MARKS_PRIOR = False


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the heights; cells that no reading holds are marked as not measured.

    Raises
    ------
    DataError : the steps of the map are not equal, or no cell has a value.
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    du, dv = equal_step(surface.grid.u_m, "u"), equal_step(surface.grid.v_m, "v")
    head = sdfio.Metadata(
        revision=sdfio.Revision.ISO_1_0,
        manufacturer_id="surfuse",
        create_date=None,
        mod_date=None,
        data_type=sdfio.DataType.INT32,
    )
    buffer = io.BytesIO()
    where = placement_text(surface.grid, from_first_node=True)
    sdfio.write(buffer, heights_or_nan(surface), x_scale=du, y_scale=dv, metadata=head, trailer=f"{where}\r\n")
    write_bytes(path, buffer.getvalue(), overwrite=overwrite)


def read(path: Path) -> SurfaceMap:
    """Read heights as a map; in a file of anyone else the part frame is the world, its origin the first point.

    Raises
    ------
    DataError : not there, not SDF, or damaged.
    """
    try:
        file = sdfio.read(path)
    except FileNotFoundError as error:
        raise DataError("there is no such map file", where=str(path)) from error
    except OSError as error:
        raise StorageError(f"cannot be read: {error.strerror}", where=str(path)) from error
    except (sdfio.SdfError, ValueError, OverflowError, MemoryError) as error:
        raise DataError(f"not a sound SDF file: {error}", where=str(path), cure="export it again") from error
    try:
        text = file.trailer if isinstance(file.trailer, str) else file.trailer.decode("latin-1")
        return map_of_heights(file.data, file.header.x_scale, file.header.y_scale, "sdf", placement_in(text))
    except DataError as error:
        raise DataError(error.what, where=str(path), cure=error.cure) from error
