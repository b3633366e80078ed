"""The fields of a sweep in the messages of our log; they follow from the table of the columns.

The columns of format version 1 come in their old order, later ones behind them in the order of the table. A message
that lacks a column (a log from before it) gives its missing entries.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from surfuse.records import Sweep
from surfuse.records.columns import Column, Per, columns_of

VERSION_1 = (
    "stop", "row", "world_from_grip", "t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude",
    "spread_m", "count", "joints_rad", "sigma_m",
)  # fmt: skip
_PLACE = {name: place for place, name in enumerate(VERSION_1)}
_KINDS: dict[type[np.generic], str] = {np.float64: "float64", np.int64: "int64"}


def logged(record: type[Sweep] = Sweep) -> tuple[Column, ...]:
    """The columns of a sweep in the order of the message."""
    return tuple(sorted(columns_of(record), key=lambda column: _PLACE.get(column.name, len(_PLACE))))


def _is_number(column: Column) -> bool:
    return column.per is Per.STOP and not column.tail


def _kind(column: Column) -> str:
    """Type of the field in the ROS 2 interface language."""
    kind = _KINDS[column.dtype]
    if _is_number(column):
        return kind
    lengths = [length for length in column.tail if length is not None]
    fixed = column.per is Per.STOP and len(lengths) == len(column.tail)
    return f"{kind}[{math.prod(lengths)}]" if fixed else f"{kind}[]"


def definition_text(columns: tuple[Column, ...]) -> str:
    """The definition of a message with these columns, one field a line."""
    return "".join(f"{_kind(column)} {column.name}\n" for column in columns)


def sweep_message(sweep: Sweep) -> dict[str, object]:
    """One stop with all its readings: numbers and flat lists by name."""
    message: dict[str, object] = {}
    for column in logged(type(sweep)):
        value = getattr(sweep, column.name)
        message[column.name] = value if _is_number(column) else np.ravel(value).tolist()
    return message


def sweep_of(field: Callable[[str], npt.ArrayLike | None], record: type[Sweep] = Sweep) -> Sweep:
    """Inverse of `sweep_message`; `field` gives the value of a field by its name, or None where a message lacks it.

    Raises
    ------
    DataError, ValueError : the values do not make a sweep, or one that cannot be left out is missing.
    """
    readings = len(np.atleast_1d(np.asarray(field("sensor"))))
    values: dict[str, npt.ArrayLike] = {}
    for column in columns_of(record):
        value = field(column.name)
        if value is not None:
            flat = np.asarray(value, dtype=column.dtype)
            values[column.name] = (
                flat.item() if _is_number(column) else flat.reshape(_shape(column, readings, flat.size))
            )
        elif not column.optional:
            raise ValueError(f"the message has no field {column.name}")
    return record(**values)  # type: ignore[arg-type]


def _shape(column: Column, readings: int, size: int) -> tuple[int, ...]:
    """Shape of a field of so many numbers; what is open in the column follows from their number."""
    entries = readings if column.per is Per.READING else 1
    closed = entries * math.prod(length for length in column.tail if length is not None)
    open_length = size // closed if closed else 0
    tail = tuple(open_length if length is None else length for length in column.tail)
    return (readings, *tail) if column.per is Per.READING else tail
