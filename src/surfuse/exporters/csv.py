"""CSV with one node a row: `u_m,v_m,w_m,sigma_m,confidence,count,regime,measured`; reads back exactly.

`measured` is 0 where only the prior gives the height, else 1. A map with second surfaces has `alternative_w_m` and
`alternative_weight` too. The pose of the part frame and the method stand in a comment line at the top.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from surfuse.durable import write_text
from surfuse.errors import DataError, StorageError
from surfuse.records import ByteArray, FloatArray, IntArray, MapGrid, SurfaceMap

SUFFIXES = (".csv",)
SUMMARY = "CSV: one node a row (u, v, w, sigma, confidence, count, regime, measured)"
MARKS_PRIOR = True
_COLUMNS = "u_m,v_m,w_m,sigma_m,confidence,count,regime"
_LARGEST_COUNT = 2.0**53  # the largest whole numbers that the text of a float tells apart
_MEASURED = _COLUMNS + ",measured"
_SECOND = _MEASURED + ",alternative_w_m,alternative_weight"
_LAYOUTS = (_COLUMNS, _MEASURED, _SECOND)
MARK = "# surfuse map "


def write(path: Path, surface: SurfaceMap, overwrite: bool = False) -> None:
    """Write the nodes with a value, row by row; numbers in the shortest form that reads back exactly.

    Raises
    ------
    StorageError : the file exists and `overwrite` is false, or the disk refused.
    """
    head = {
        "version": 1,
        "method": surface.method,
        "world_from_part": surface.grid.world_from_part.tolist(),
        "u_m": surface.grid.u_m.tolist(),
        "v_m": surface.grid.v_m.tolist(),
    }
    second, weight = surface.alternative_height_m, surface.alternative_weight
    two = second is not None and weight is not None
    lines = [MARK + json.dumps(head), _SECOND if two else _MEASURED]
    r, c = np.nonzero(surface.mask)
    columns: list[FloatArray | IntArray | ByteArray] = [
        surface.grid.u_m[c],
        surface.grid.v_m[r],
        surface.height_m[r, c],
        surface.sigma_m[r, c],
        surface.confidence[r, c],
        surface.count[r, c],
        surface.regime[r, c],
        surface.measured[r, c].astype(np.int64),
    ]
    if second is not None and weight is not None:
        columns += [second[r, c], weight[r, c]]
    lines += [",".join(map(repr, row)) for row in zip(*(column.tolist() for column in columns), strict=True)]
    write_text(path, "\n".join(lines) + "\n", overwrite=overwrite)


def read(path: Path) -> SurfaceMap:
    """Read the map back; cells without a row are empty.

    Raises
    ------
    DataError : not there, not such a file, or damaged; the message names the line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError as error:
        raise DataError("there is no such map file", where=str(path)) from error
    except UnicodeDecodeError as error:
        raise DataError("not a text file", where=str(path), cure="give a map exported as .csv") from error
    except OSError as error:
        raise StorageError(f"cannot be read: {error.strerror}", where=str(path)) from error
    if len(lines) < 2 or not lines[0].startswith(MARK) or lines[1] not in _LAYOUTS:
        cure = "give a map exported as .csv; readings are fused with 'surfuse fuse'"
        raise DataError("not a map exported by surfuse", where=f"{path}:1", cure=cure)
    try:
        head = json.loads(lines[0].removeprefix(MARK))
        grid = MapGrid(u_m=head["u_m"], v_m=head["v_m"], world_from_part=head["world_from_part"])
        method, version = str(head["method"]), int(head["version"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"the first line is damaged: {error}", where=f"{path}:1", cure="export again") from error
    if version > 1:
        raise DataError(f"map format {version}, this surfuse reads 1", where=str(path), cure="install a newer surfuse")
    return _surface(path, lines[2:], grid, method, lines[1].count(",") + 1)


def _surface(path: Path, lines: list[str], grid: MapGrid, method: str, width: int) -> SurfaceMap:
    table = np.empty((len(lines), width))
    for i, line in enumerate(lines):
        try:
            table[i] = [float(cell) for cell in line.split(",")]
        except ValueError as error:
            raise DataError(f"'{line[:60]}' is not a row of {width} numbers", where=f"{path}:{i + 3}") from error
    column = _nodes(path, table[:, 0], grid.u_m, "u_m")
    row = _nodes(path, table[:, 1], grid.v_m, "v_m")
    empty = np.full(grid.shape, math.nan)
    layers = {name: empty.copy() for name in ("height_m", "sigma_m")}
    layers["height_m"][row, column], layers["sigma_m"][row, column] = table[:, 2], table[:, 3]
    confidence, whole, mask = np.zeros(grid.shape), np.zeros((2, *grid.shape)), np.zeros(grid.shape, dtype=bool)
    confidence[row, column], whole[0, row, column], whole[1, row, column] = table[:, 4], table[:, 5], table[:, 6]
    mask[row, column] = True
    most = np.array([_LARGEST_COUNT, 255.0])[:, np.newaxis, np.newaxis]
    if not np.all((whole >= 0.0) & (whole <= most) & (whole == np.round(whole))):
        raise DataError("count and regime must be whole numbers, 0 or more", where=str(path), cure="export again")
    if not np.all(np.isfinite(table[:, 2])):
        raise DataError("a measured node has no finite height", where=str(path), cure="export again")
    second, weight = empty.copy(), np.zeros(grid.shape)
    if width == _SECOND.count(",") + 1:
        second[row, column], weight[row, column] = table[:, 8], table[:, 9]
    return SurfaceMap(
        grid=grid,
        height_m=layers["height_m"],
        sigma_m=layers["sigma_m"],
        confidence=confidence,
        count=whole[0].astype(np.int64),
        mask=mask,
        regime=whole[1].astype(np.uint8),
        method=method,
        alternative_height_m=second if width == _SECOND.count(",") + 1 else None,
        alternative_weight=weight if width == _SECOND.count(",") + 1 else None,
    )


def _nodes(path: Path, values: FloatArray, nodes: FloatArray, name: str) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Index of each value among the nodes of an axis."""
    index = np.clip(np.searchsorted(nodes, values), 0, len(nodes) - 1)
    wrong = np.flatnonzero(nodes[index] != values)
    if len(wrong):
        i = int(wrong[0])
        raise DataError(f"{name} = {values[i]} is no node of the map", where=f"{path}:{i + 3}", cure="export again")
    return index.astype(np.int64)
