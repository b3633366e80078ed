"""Reading the native map file back: bit by bit, or a clear refusal; its checksum is always verified."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError, StorageError
from surfuse.map_files.decisions import read_decisions
from surfuse.map_files.native import (
    FORMAT,
    FORMAT_VERSION,
    alternative_arrays,
    checksum_of,
    later_columns,
    layer_arrays,
    point_arrays,
)
from surfuse.records import FloatArray, FusedPoints, MapGrid, SurfaceMap
from surfuse.records.fused import POINT_COLUMNS

_MAX_VALUES = 100_000_000
_DAMAGE = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, IndexError, MemoryError)


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """A file of ours, open; whatever goes wrong inside becomes a DataError that names the file."""
    if not path.is_file():
        raise DataError("there is no such map file", where=str(path), cure="give a surface.nc or a run folder")
    try:
        # h5py and not h5netcdf: the latter leaves a half-made object behind when a damaged file does not open.
        with h5py.File(path, "r") as file:
            _check_kind(file, path)
            yield file
    except PermissionError as error:
        raise StorageError("may not be read", where=str(path), cure="check its permissions") from error
    except DataError as error:
        raise DataError(error.what, where=error.where or str(path), cure=error.cure) from error
    except _DAMAGE as error:
        why = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise DataError(
            f"not a map of ours, or damaged ({why})", where=str(path), cure="write the map again"
        ) from error


def _check_kind(file: h5py.File, path: Path) -> None:
    if file.attrs.get("format") != FORMAT:
        names = ", ".join(sorted(file)[:8])
        raise DataError(
            f"a map file of another kind (it holds: {names})", where=str(path), cure="give a map made by surfuse"
        )
    version = _whole_attribute(file, "format_version")
    if version > FORMAT_VERSION:
        raise DataError(
            f"the map has format version {version}, this surfuse reads up to {FORMAT_VERSION}",
            where=str(path),
            cure="install a newer surfuse",
        )


def _whole_attribute(group: h5py.Group, name: str) -> int:
    """An attribute as a number; NetCDF stores it as an array of one."""
    return int(np.asarray(group.attrs[name]).reshape(1)[0])


def _values(group: h5py.Group, name: str) -> npt.NDArray[np.generic]:
    """One variable, unless it claims to be bigger than any map of ours."""
    dataset = group[name]
    size = int(np.prod(dataset.shape, dtype=np.float64))
    if size > _MAX_VALUES:
        raise DataError(f"'{name}' has {size} values, at most {_MAX_VALUES} are read", cure="write a smaller map")
    values: npt.NDArray[np.generic] = dataset[...]
    return values


def _alternative(file: h5py.File) -> tuple[FloatArray | None, FloatArray | None]:
    """Height and probability of the second surface, or neither."""
    if "alternative_crc32" not in file.attrs and "alternative_height" not in file:
        return None, None
    height = _values(file, "alternative_height").astype(np.float64)
    weight = _values(file, "alternative_weight").astype(np.float64)
    _verify(file, checksum_of(*alternative_arrays(height, weight)), "alternative_crc32")
    return height, weight


def _verify(group: h5py.Group, computed: int, attribute: str = "content_crc32") -> None:
    if _whole_attribute(group, attribute) != computed:
        raise DataError("the map fails its checksum: it is damaged", cure="write the map again")


def read_native(path: Path) -> SurfaceMap:
    """Read a map back, bit by bit.

    Raises
    ------
    DataError : not there, not NetCDF4, not ours, newer, damaged, or too big.
    """
    with _opened(path) as file:
        second, weight = _alternative(file)
        surface = SurfaceMap(
            grid=MapGrid(
                u_m=_values(file, "u").astype(np.float64),
                v_m=_values(file, "v").astype(np.float64),
                world_from_part=_values(file, "world_from_part").astype(np.float64),
            ),
            height_m=_values(file, "height").astype(np.float64),
            sigma_m=_values(file, "height_stderr").astype(np.float64),
            confidence=_values(file, "confidence").astype(np.float64),
            count=_values(file, "count").astype(np.int64),
            mask=_values(file, "mask").astype(np.int64) != 0,
            regime=_values(file, "regime").astype(np.uint8),
            method=str(file.attrs["method"]),
            alternative_height_m=second,
            alternative_weight=weight,
            decisions=read_decisions(file["guard"]) if "guard" in file else (),
        )
        _verify(file, checksum_of(*layer_arrays(surface)))
        return surface


def read_native_points(path: Path) -> FusedPoints | None:
    """The fused points stored with a map, or None when it has none.

    Raises
    ------
    DataError : as `read_native`.
    """
    with _opened(path) as file:
        if "points" not in file:
            return None
        group = file["points"]
        here = [column for column in POINT_COLUMNS if column.name in group or not column.optional]
        later = [name for name in later_columns() if name in group]
        values: dict[str, Any] = {column.name: _values(group, column.name).astype(column.dtype) for column in here}
        points = FusedPoints(start=_values(group, "start").astype(np.int64), **values)
        _verify(group, checksum_of(*point_arrays(points, later)))
        return points
