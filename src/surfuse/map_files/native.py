"""Layout of the native map file: NetCDF4, CF-1.11; every layer of a `SurfaceMap` to the last bit.

The axes u and v carry no `axis` attribute (checkers would take them for longitude and latitude) and no fill value.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import h5netcdf
import numpy as np

from surfuse import __version__
from surfuse.map_files.decisions import write_decisions
from surfuse.records import FusedPoints, Gap, Gate, MapGrid, Regime, SurfaceMap
from surfuse.records.columns import Per
from surfuse.records.fused import POINT_COLUMNS

FORMAT = "surfuse map"
FORMAT_VERSION = 1

_Array = np.ndarray[tuple[int, ...], np.dtype[np.generic]]

VERSION_1 = (
    "stop", "row", "depth_m", "sigma_m", "gap", "reset", "sensor", "dc", "dc1", "dc2", "dc3", "gate", "point_m",
)  # fmt: skip
"""Columns of the fused points in format version 1, in the order of their checksum."""

_DIMENSIONS = {"point_m": ("uvw",)}
_CODES = (("gap", Gap), ("gate", Gate))


def checksum_of(*arrays: _Array) -> int:
    """CRC-32 over the bytes of all arrays: HDF5 itself does not notice a flipped bit in the data."""
    value = 0
    for array in arrays:
        value = zlib.crc32(np.ascontiguousarray(array).tobytes(), value)
    return value


def layer_arrays(surface: SurfaceMap) -> tuple[_Array, ...]:
    """All that the checksum of a map covers, in this order."""
    grid = surface.grid
    axes = (grid.u_m, grid.v_m, grid.world_from_part)
    return (
        *axes,
        surface.height_m,
        surface.sigma_m,
        surface.confidence,
        surface.count,
        surface.mask,
        surface.regime,
        np.frombuffer(surface.method.encode("utf-8"), dtype=np.uint8),
    )


def alternative_arrays(height_m: _Array, weight: _Array) -> tuple[_Array, ...]:
    """All that the checksum of the second surface covers; its own, so that readers of earlier versions keep theirs."""
    return height_m, weight


def later_columns() -> tuple[str, ...]:
    """Columns of the fused points that came after format version 1, in the order of the table."""
    return tuple(column.name for column in POINT_COLUMNS if column.name not in VERSION_1)


def point_arrays(points: FusedPoints, later: Sequence[str]) -> tuple[_Array, ...]:
    """All that the checksum of the fused points covers, in this order; `later` are those of the later columns."""
    return tuple(getattr(points, name) for name in (*VERSION_1, "start", *later))


def write_native(path: Path | BinaryIO, surface: SurfaceMap, points: FusedPoints | None) -> None:
    """Write the file in place, or into memory; the caller makes it atomic."""
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(
            {
                "Conventions": "CF-1.11",
                "title": "Surface fused from range readings",
                "source": f"surfuse {__version__}",
                "method": surface.method,
                "history": f"written by surfuse {__version__}",
                "format": FORMAT,
                "format_version": np.int32(FORMAT_VERSION),
                "surfuse_version": __version__,
                "content_crc32": np.uint32(checksum_of(*layer_arrays(surface))),
            }
        )
        _write_axes(file, surface.grid)
        _write_layers(file, surface)
        _write_alternative(file, surface)
        if surface.decisions:
            write_decisions(file.create_group("guard"), surface.decisions)
        if points is not None:
            _write_points(file.create_group("points"), points)


def _variable(
    group: h5netcdf.Group, name: str, dims: tuple[str, ...], data: _Array, long_name: str, units: str
) -> h5netcdf.Variable:
    """One variable, compressed when it is a map layer; `units` empty for what has none."""
    packing = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if data.ndim == 2 and data.size else {}
    variable = group.create_variable(name, dims, data=data, **packing)
    variable.attrs["long_name"] = long_name
    if units:
        variable.attrs["units"] = units
    return variable


def _write_axes(file: h5netcdf.File, grid: MapGrid) -> None:
    rows, columns = grid.shape
    file.dimensions = {"v": rows, "u": columns, "frame_row": 4, "frame_column": 4}
    _variable(file, "u", ("u",), grid.u_m, "coordinate along the scan line, part frame", "m")
    _variable(file, "v", ("v",), grid.v_m, "coordinate up from the foot of the part, part frame", "m")
    text = "pose of the part frame in the world (4x4, p_world = world_from_part p_part)"
    _variable(file, "world_from_part", ("frame_row", "frame_column"), grid.world_from_part, text, "1")


def _write_layers(file: h5netcdf.File, surface: SurfaceMap) -> None:
    dims = ("v", "u")
    height = _variable(file, "height", dims, surface.height_m, "surface out of the part (w) over u and v", "m")
    height.attrs["ancillary_variables"] = "height_stderr confidence count mask regime"
    _variable(file, "height_stderr", dims, surface.sigma_m, "standard deviation of the height", "m")
    _variable(file, "confidence", dims, surface.confidence, "degree of confidence of the cell, 0 to 1", "1")
    _variable(file, "count", dims, surface.count, "number of readings that the cell rests on", "1")
    mask = _variable(file, "mask", dims, surface.mask.astype(np.int8), "whether the cell has a value", "")
    mask.attrs.update({"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no_value has_value"})
    regime = _variable(file, "regime", dims, surface.regime, "what the value of the cell rests on", "")
    regime.attrs["flag_values"] = np.array([int(r) for r in Regime], dtype=np.uint8)
    regime.attrs["flag_meanings"] = " ".join(r.name.lower() for r in Regime)
    regime.attrs["comment"] = "cells of the kind 'prior' continue their surroundings: no reading holds them"


def _write_alternative(file: h5netcdf.File, surface: SurfaceMap) -> None:
    """The second surface of cells where two compete, when the method knows of it."""
    height, weight, dims = surface.alternative_height_m, surface.alternative_weight, ("v", "u")
    if height is None or weight is None:
        return
    second = _variable(file, "alternative_height", dims, height, "second surface (w) where two compete", "m")
    second.attrs["ancillary_variables"] = "alternative_weight"
    text = "probability that the cell belongs to the second surface, 0 where there is none"
    share = _variable(file, "alternative_weight", dims, weight, text, "1")
    share.attrs["valid_range"] = np.array([0.0, 1.0])
    file.attrs["alternative_crc32"] = np.uint32(checksum_of(*alternative_arrays(height, weight)))


def _write_points(group: h5netcdf.Group, points: FusedPoints) -> None:
    """The fused points, ragged: readings of stop j are the rows start[j]:start[j + 1]."""
    group.attrs["content_crc32"] = np.uint32(checksum_of(*point_arrays(points, later_columns())))
    group.dimensions = {"stops": len(points), "edges": len(points) + 1, "readings": len(points.sensor)}
    for column in POINT_COLUMNS:
        data = getattr(points, column.name)
        tails = _DIMENSIONS.get(column.name) or tuple(f"{column.name}_{k}" for k in range(len(column.tail)))
        for name, length in zip(tails, data.shape[1:], strict=True):
            group.dimensions[name] = length
        dimensions = ("stops" if column.per is Per.STOP else "readings", *tails)
        stored = data.astype(np.int8) if data.dtype == np.bool_ else data
        _variable(group, column.name, dimensions, stored, column.meaning, column.unit)
    _variable(group, "start", ("edges",), points.start, "first reading of each stop", "")
    for name, kinds in _CODES:
        group.variables[name].attrs["flag_values"] = np.array([int(kind) for kind in kinds], dtype=np.int64)
        group.variables[name].attrs["flag_meanings"] = " ".join(kind.name.lower() for kind in kinds)
