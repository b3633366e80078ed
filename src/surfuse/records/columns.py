"""Columns, defined once: from their table follow checking, owning, slicing, selecting and stacking.

A column is a field of a record that was made by `per_reading` or `per_stop`. Records of columns are views where they
can be: what was checked once is not checked or copied again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, dataclass, field, fields
from enum import Enum
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.records.checks import IntArray, owned

Tail = tuple[int | None, ...]
Array = npt.NDArray[np.generic]
T = TypeVar("T")


class Per(Enum):
    """What a column has one entry for."""

    READING = "reading"
    STOP = "stop"


@dataclass(frozen=True)
class Column:
    """One column: an entry of shape `tail` for every reading or stop.

    `unit` is empty for numbers and codes, "1" for shares. `missing` is the entry that stands for an unknown one; a
    column with `optional` may be left out altogether. None in `tail`: any length, the same for all entries.
    """

    name: str
    per: Per
    dtype: type[np.generic]
    tail: Tail
    unit: str
    meaning: str
    missing: float
    optional: bool

    @property
    def entry(self) -> tuple[int, ...]:
        """Shape of an entry of which nothing is known: what is open has the length 0."""
        return tuple(0 if length is None else length for length in self.tail)

    def absent(self, n: int) -> Array:
        """What stands for a column that is not given: n missing entries in no memory, or entries of width 0."""
        one = np.full(self.entry, self.missing, dtype=self.dtype)
        one.setflags(write=False)
        return np.broadcast_to(one, (n, *one.shape))


NOT_GIVEN: Array = np.zeros(0)
"""Default of columns that may be left out."""
NOT_GIVEN.setflags(write=False)


def _not_given() -> Any:
    return NOT_GIVEN


def _column(per: Per, unit: str, meaning: str, tail: Tail, dtype: type[np.generic], missing: float | None) -> Any:
    # What `dataclasses.field` gives is no value of the annotated type either: the type checker is told so by its own
    # stub, and here by Any.
    given = {"per": per, "dtype": dtype, "tail": tail, "unit": unit, "meaning": meaning}
    table = {**given, "missing": np.nan if missing is None else missing, "optional": missing is not None}
    if missing is None:
        return field(metadata=table)
    return field(default_factory=_not_given, metadata=table, kw_only=True)


def per_reading(
    unit: str,
    meaning: str,
    tail: Tail = (),
    dtype: type[np.generic] = np.float64,
    missing: float | None = None,
) -> Any:
    """A column with an entry for every reading; with `missing` it may be left out."""
    return _column(Per.READING, unit, meaning, tail, dtype, missing)


def per_stop(
    unit: str,
    meaning: str,
    tail: Tail = (),
    dtype: type[np.generic] = np.float64,
    missing: float | None = None,
) -> Any:
    """A column with an entry for every stop; with `missing` it may be left out."""
    return _column(Per.STOP, unit, meaning, tail, dtype, missing)


def ragged_start() -> Any:
    """The field `start` (M + 1,) of a ragged record: stop j has the readings start[j]:start[j + 1]."""
    return field()


_TABLES: dict[type[object], tuple[Column, ...]] = {}


def columns_of(record: type[object]) -> tuple[Column, ...]:
    """The table of a record: its columns in the order of their definition."""
    if record not in _TABLES:
        found: tuple[Field[Any], ...] = fields(record)  # type: ignore[arg-type]
        _TABLES[record] = tuple(Column(one.name, **one.metadata) for one in found if "per" in one.metadata)
    return _TABLES[record]


def columns_per(record: type[object], per: Per) -> tuple[Column, ...]:
    """The columns of a record with an entry per reading, or per stop."""
    return tuple(column for column in columns_of(record) if column.per is per)


def own_columns(record: object, n_readings: int, n_stops: int | None) -> None:
    """Replace the columns of a frozen record by checked read-only arrays; `n_stops` None: the record is one stop.

    Raises
    ------
    DataError : a column of another shape; what is not given is filled in.
    """
    for column in columns_of(type(record)):
        value = getattr(record, column.name)
        if column.per is Per.STOP and n_stops is None:
            _own_entry(record, column, value)
            continue
        n = n_readings if column.per is Per.READING or n_stops is None else n_stops
        if value is NOT_GIVEN or (column.optional and np.size(value) == 0):
            value = column.absent(n)
        name = f"{type(record).__name__}.{column.name}"
        object.__setattr__(record, column.name, owned(value, column.dtype, name, (n, *column.tail)))


def _own_entry(record: object, column: Column, value: npt.ArrayLike) -> None:
    """The one entry of a column per stop: a plain number where the column has no trailing shape."""
    name = f"{type(record).__name__}.{column.name}"
    if column.tail:
        entry = column.absent(1)[0] if column.optional and np.size(value) == 0 else value
        object.__setattr__(record, column.name, owned(entry, column.dtype, name, column.tail))
    else:
        object.__setattr__(record, column.name, column.dtype(owned(value, column.dtype, name, ())).item())


def view(record: type[T], **values: object) -> T:
    """A record of values that are slices of checked records: neither checked nor copied again."""
    made = object.__new__(record)
    made.__dict__.update(values)
    return made


def own_start(record: object, start: npt.ArrayLike, n_readings: int, n_stops: int) -> IntArray:
    """Own and check the `start` (M + 1,) of a ragged record.

    Raises
    ------
    DataError : the stops do not cover the readings in order.
    """
    name = type(record).__name__
    edges = np.asarray(owned(start, np.int64, f"{name}.start", (n_stops + 1,)), dtype=np.int64)
    object.__setattr__(record, "start", edges)
    if edges[0] != 0 or edges[-1] != n_readings or np.any(edges[1:] < edges[:-1]):
        raise DataError(
            f"{name}.start runs from {edges[0]} to {edges[-1]} over {n_readings} readings: "
            "the stops do not cover the rows in order",
            cure=f"give increasing numbers from 0 to {n_readings}",
        )
    return edges


def edges_of(sizes: Sequence[int]) -> IntArray:
    """Read-only `start` (M + 1,) of stops with so many readings each."""
    edges = np.zeros(len(sizes) + 1, dtype=np.int64)
    np.cumsum(sizes, out=edges[1:])
    edges.setflags(write=False)
    return edges


def stacked(column: Column, parts: Sequence[Array]) -> Array:
    """The rows of parts (n_k, ...), one part after the other; entries of an open shape are filled up to the widest."""
    if not parts:
        return np.zeros((0, *column.entry), dtype=column.dtype)
    if None in column.tail and len({part.shape[1:] for part in parts}) > 1:
        widest = tuple(np.max([part.shape[1:] for part in parts], axis=0).tolist())
        parts = [_widened(column, part, widest) for part in parts]
    return np.concatenate(parts)


def _widened(column: Column, part: Array, shape: tuple[int, ...]) -> Array:
    wide = np.full((len(part), *shape), column.missing, dtype=column.dtype)
    wide[tuple(slice(n) for n in part.shape)] = part
    return wide


class ArrayRecord:
    """Base of the records that hold arrays: equal when they have one type and all fields are equal (nan equal to nan).

    The hash looks at shapes and texts, not at numbers: equal records have equal hashes, and it is cheap.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, one.name), getattr(other, one.name)) for one in fields(self))

    def __hash__(self) -> int:
        return hash((type(self).__name__, *(_trait(getattr(self, one.name)) for one in fields(self))))


def same(one: object, other: object) -> bool:
    """Whether two values of a field are equal: arrays in shape and values, nan equal to nan, tuples entry by entry."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        first, second = np.asarray(one), np.asarray(other)
        return first.shape == second.shape and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (one != one and other != other)
    return bool(one == other)


def _trait(value: object) -> object:
    """Something hashable that equal values share."""
    if isinstance(value, tuple):
        return tuple(_trait(one) for one in value)
    return value if isinstance(value, str) else np.shape(value) if isinstance(value, np.ndarray) else None
