"""Arrays of a caller as the table that the CSV reader makes of a file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from surfuse.door.arguments import names, numbers, shown
from surfuse.errors import DataError, nearest
from surfuse.records import FloatArray, IntArray
from surfuse.runs.reading_table import STATUS_WORDS, UNKNOWN_STATUS, ReadingTable, with_stop
from surfuse.runs.side_files import METRES_LIMIT, GivenPart, described_frame, described_outline

NAME = "sf.log"
_VECTORS = {"p": "position_m", "a": "axis"}


@dataclass(frozen=True)
class ArraySource:
    """Arrays in the words of messages: rows are counted from 0, columns are those of the arrays."""

    name: str = NAME
    sensors_name: str = "sensors"
    frame_name: str = "frame"

    def where(self, row: int, column: str) -> str:
        """The array and its index."""
        if column[0] in _VECTORS and column[1:] in ("x", "y", "z"):
            return f"{NAME}: {_VECTORS[column[0]]}[{row}, {'xyz'.index(column[1])}]"
        return f"{NAME}: {'t_s' if column == 't' else column}[{row}]"

    def row_names(self, one: int, other: int) -> str:
        """Two rows."""
        return f"rows {one} and {other}"


def table_of_arrays(
    t_s: npt.ArrayLike,
    sensor: npt.ArrayLike,
    position_m: npt.ArrayLike,
    axis: npt.ArrayLike,
    range_m: npt.ArrayLike,
) -> ReadingTable:
    """The table of the required columns; the arrays are copied.

    Raises
    ------
    DataError : other types, other shapes, no reading.
    """
    times = numbers(t_s, f"{NAME}: t_s", (None,))
    n = len(times)
    if n == 0:
        raise DataError("no readings", where=NAME, cure="give at least one")
    table = ReadingTable(
        source=ArraySource(),
        t_s=times,
        sensor=names(sensor, f"{NAME}: sensor", n),
        position_m=numbers(position_m, f"{NAME}: position_m", (n, 3)),
        axis=numbers(axis, f"{NAME}: axis", (n, 3)),
        range_m=numbers(range_m, f"{NAME}: range_m", (n,)),
        status=None,
        sigma_m=None,
        amplitude=None,
        stop=None,
    )
    if "" in table.sensor:
        raise DataError("the sensor has no name", where=table.where(table.sensor.index(""), "sensor"), cure="name it")
    return table


def with_optional(
    table: ReadingTable,
    status: npt.ArrayLike | None,
    sigma_m: npt.ArrayLike | None,
    amplitude: npt.ArrayLike | None,
    stop: npt.ArrayLike | None,
) -> ReadingTable:
    """The table with those optional columns that are given.

    Raises
    ------
    DataError : other types or shapes, unknown words, stops that are not whole.
    """
    n = (len(table.t_s),)
    table = replace(
        table,
        status=None if status is None else _status_codes(status, table),
        sigma_m=None if sigma_m is None else numbers(sigma_m, f"{NAME}: sigma_m", n),
        amplitude=None if amplitude is None else numbers(amplitude, f"{NAME}: amplitude", n),
    )
    return table if stop is None else with_stop(table, numbers(stop, f"{NAME}: stop", n))


def _status_codes(status: npt.ArrayLike, table: ReadingTable) -> IntArray:
    """Codes (N,) from the words or codes of the CSV; an empty word is no status."""
    words = [word.lower() for word in names(status, f"{NAME}: status", len(table.t_s))]
    known = {"": UNKNOWN_STATUS} | STATUS_WORDS
    for row, word in enumerate(words):
        if word not in known:
            cure = nearest(word[:40], STATUS_WORDS)
            raise DataError(f"unknown status '{word[:40]}'", where=table.where(row, "status"), cure=cure)
    return np.array([known[word] for word in words], dtype=np.int64)


def part_of_arrays(
    frame: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None, outline: npt.ArrayLike | None
) -> GivenPart:
    """The part frame from (origin, u, v) and the outline (K, 2) in it.

    Raises
    ------
    DataError, ConfigError : other shapes, axes that are zero or parallel, millimetres, an outline without a frame.
    """
    if frame is None:
        if outline is not None:
            raise DataError("an outline without a part frame", where=NAME, cure="give frame=(origin, u, v) too")
        return GivenPart()
    where = f"{NAME}: frame"
    if not isinstance(frame, tuple | list) or len(frame) != 3:
        raise DataError(f"{shown(frame)} is not (origin, u, v)", where=where, cure="give three vectors (3,)")
    vectors = {
        name: _finite(numbers(vector, f"{where}: {name}", (3,)), f"{where}: {name}").tolist()
        for name, vector in zip(("origin", "u", "v"), frame, strict=True)
    }
    world_from_part = described_frame(vectors, where)
    if outline is None:
        return GivenPart(world_from_part)
    vertices = _finite(numbers(outline, f"{NAME}: outline", (None, 2)), f"{NAME}: outline")
    if np.any(np.abs(vertices) > METRES_LIMIT):
        largest = float(np.abs(vertices).max())
        raise DataError(f"{largest:g} looks like millimetres", where=f"{NAME}: outline", cure="divide by 1000")
    pairs = [(float(u), float(v)) for u, v in vertices]
    return GivenPart(world_from_part, described_outline(pairs, world_from_part, f"{NAME}: outline"))


def _finite(values: FloatArray, where: str) -> FloatArray:
    if not np.all(np.isfinite(values)):
        raise DataError(f"{values[~np.isfinite(values)][0]} is not finite", where=where, cure="give metres")
    return values
