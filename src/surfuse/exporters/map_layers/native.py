"""Layout of the native map file: NetCDF4, CF-1.11; every layer of a `SurfaceMap` to the last bit.

The axes u and v carry no `axis` attribute (checkers would take them for longitude and latitude) and no fill value.
"""

from __future__ import annotations

from pathlib import Path

import h5netcdf
import numpy as np

from surfuse import __version__
from surfuse.errors import DataError, StorageError
from surfuse.records import FusedPoints, Gap, Gate, MapGrid, Regime, SurfaceMap

FORMAT = "surfuse map"
FORMAT_VERSION = 1
_MAX_CELLS = 100_000_000

_Array = np.ndarray[tuple[int, ...], np.dtype[np.generic]]

_POINT_COLUMNS = {
    "stop": ("number of the stop", ""),
    "row": ("scan line of the stop", ""),
    "depth_m": ("fused value M(n), the range along the grip axis", "m"),
    "sigma_m": ("standard deviation of the fused value", "m"),
    "gap": ("why the stop has no fused value", ""),
    "reset": ("whether the prediction window started afresh", ""),
}
_READING_COLUMNS = {
    "sensor": ("number of the sensor", ""),
    "dc": ("degree of confidence, the product of its factors", "1"),
    "dc1": ("factor of prediction", "1"),
    "dc2": ("factor of agreement", "1"),
    "dc3": ("factor of the boundary", "1"),
    "gate": ("why validation kept the reading out", ""),
}


def write_native(path: Path, surface: SurfaceMap, points: FusedPoints | None) -> None:
    """Write the file in place; the caller makes it atomic."""
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
            }
        )
        _write_axes(file, surface.grid)
        _write_layers(file, surface)
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
    mask.attrs.update({"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "empty measured"})
    regime = _variable(file, "regime", dims, surface.regime, "what the value of the cell rests on", "")
    regime.attrs["flag_values"] = np.array([int(r) for r in Regime], dtype=np.uint8)
    regime.attrs["flag_meanings"] = " ".join(r.name.lower() for r in Regime)


def _write_points(group: h5netcdf.Group, points: FusedPoints) -> None:
    """The fused points, ragged: readings of stop j are the rows start[j]:start[j + 1]."""
    group.dimensions = {"stops": len(points), "edges": len(points) + 1, "readings": len(points.sensor), "uvw": 3}
    for name, (text, units) in _POINT_COLUMNS.items():
        data = getattr(points, name)
        _variable(group, name, ("stops",), data.astype(np.int8) if data.dtype == np.bool_ else data, text, units)
    _variable(group, "point_m", ("stops", "uvw"), points.point_m, "fused point u, v, w in the part frame", "m")
    _variable(group, "start", ("edges",), points.start, "first reading of each stop", "")
    for name, (text, units) in _READING_COLUMNS.items():
        _variable(group, name, ("readings",), getattr(points, name), text, units)
    for name, kinds in (("gap", Gap), ("gate", Gate)):
        group.variables[name].attrs["flag_values"] = np.array([int(kind) for kind in kinds], dtype=np.int64)
        group.variables[name].attrs["flag_meanings"] = " ".join(kind.name.lower() for kind in kinds)


def _open(path: Path) -> h5netcdf.File:
    if not path.is_file():
        raise DataError("there is no such map file", where=str(path), cure="give a surface.nc or a run folder")
    try:
        file = h5netcdf.File(path, "r")
    except PermissionError as error:
        raise StorageError("may not be read", where=str(path), cure="check its permissions") from error
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise DataError("not a NetCDF4 file, or damaged", where=str(path), cure="write the map again") from error
    return file


def _check_version(file: h5netcdf.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        names = ", ".join(sorted(file.variables)[:8])
        raise DataError(
            f"a NetCDF file of another kind (variables: {names})", where=str(path), cure="give a map made by surfuse"
        )
    version = int(file.attrs["format_version"])
    if version > FORMAT_VERSION:
        raise DataError(
            f"the map has format version {version}, this surfuse reads up to {FORMAT_VERSION}",
            where=str(path),
            cure="install a newer surfuse",
        )


_DAMAGE = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, IndexError)


def read_native(path: Path) -> SurfaceMap:
    """Read a map back, bit by bit.

    Raises
    ------
    DataError : not there, not NetCDF4, not ours, newer, damaged, or too big.
    """
    with _open(path) as file:
        try:
            _check_version(file, path)
            cells = len(file.dimensions["u"]) * len(file.dimensions["v"])
            if cells > _MAX_CELLS:
                raise DataError(f"the map has {cells} cells, at most {_MAX_CELLS} are read", where=str(path))
            layers = file.variables
            grid = MapGrid(u_m=layers["u"][...], v_m=layers["v"][...], world_from_part=layers["world_from_part"][...])
            return SurfaceMap(
                grid=grid,
                height_m=layers["height"][...],
                sigma_m=layers["height_stderr"][...],
                confidence=layers["confidence"][...],
                count=layers["count"][...],
                mask=layers["mask"][...] != 0,
                regime=layers["regime"][...],
                method=str(file.attrs["method"]),
            )
        except DataError as error:
            raise DataError(error.what, where=error.where or str(path), cure=error.cure) from error
        except _DAMAGE as error:
            raise DataError(f"the map is damaged: {error}", where=str(path), cure="write the map again") from error


def read_native_points(path: Path) -> FusedPoints | None:
    """The fused points stored with a map, or None when it has none.

    Raises
    ------
    DataError : as `read_native`.
    """
    with _open(path) as file:
        try:
            _check_version(file, path)
            if "points" not in file.groups:
                return None
            columns = file.groups["points"].variables
            names = (*_POINT_COLUMNS, *_READING_COLUMNS, "point_m", "start")
            arrays = {name: columns[name][...] for name in names}
            return FusedPoints(
                stop=arrays["stop"],
                row=arrays["row"],
                depth_m=arrays["depth_m"],
                sigma_m=arrays["sigma_m"],
                point_m=arrays["point_m"],
                gap=arrays["gap"],
                reset=arrays["reset"] != 0,
                start=arrays["start"],
                sensor=arrays["sensor"],
                dc=arrays["dc"],
                dc1=arrays["dc1"],
                dc2=arrays["dc2"],
                dc3=arrays["dc3"],
                gate=arrays["gate"],
            )
        except _DAMAGE as error:
            raise DataError(f"the map is damaged: {error}", where=str(path), cure="write the map again") from error
