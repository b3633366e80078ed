"""A readings CSV as columns of numbers: strict, fast, and able to say file, line and column of what is wrong.

Blocks of rows are converted a column at a time by Python's own `float`, which rounds correctly; only when a block
fails is it searched cell by cell for the message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from surfuse.errors import DataError, nearest
from surfuse.records import FloatArray, Status
from surfuse.runs.csv_source import CsvSource
from surfuse.runs.reading_table import STATUS_WORDS, UNKNOWN_STATUS, ReadingTable, with_stop

_BLOCK_ROWS = 2048
_INF_WORDS = ("inf", "infinity")


def read_csv_table(path: Path) -> ReadingTable:
    """Parse a readings CSV (SPEC: files and commands).

    Raises
    ------
    DataError : anything but numbers in the columns that are read; the message names file, line and column.
    StorageError : the file cannot be read.
    """
    source = CsvSource(path)
    parser = _Columns(source)
    for block in _blocks(source):
        parser.add(block)
    return parser.table()


def _blocks(source: CsvSource) -> Iterator[list[list[str]]]:
    reader = source.reader()
    while block := source.checked(lambda: list(islice(reader, _BLOCK_ROWS)), reader):
        yield [cells for cells in block if cells]


class _Columns:
    """Collects the converted blocks of each column."""

    def __init__(self, source: CsvSource) -> None:
        self._source = source
        self._rows = 0
        self._numbers: dict[str, list[FloatArray]] = {name: [] for name in source.header if name not in ("", "sensor")}
        self._sensor: list[str] = []
        self._commas = self._points = False

    def add(self, block: list[list[str]]) -> None:
        width = len(self._source.header)
        if any(len(cells) != width for cells in block):
            self._report_ragged(block, width)
        for name, cells in zip(self._source.header, zip(*block, strict=True), strict=True):
            if not name:
                continue
            if name == "sensor":
                self._add_sensors(cells)
            elif name == "status":
                self._numbers[name].append(np.array([self._status(cells, i) for i in range(len(cells))]))
            else:
                self._numbers[name].append(self._convert(name, cells))
        self._rows += len(block)

    def _where(self, i: int, column: str) -> str:
        line = self._source.line_of(self._rows + i)
        return f"{self._source.path}:{line}:{column}" if column else f"{self._source.path}:{line}"

    def _report_ragged(self, block: list[list[str]], width: int) -> None:
        i = next(i for i, cells in enumerate(block) if len(cells) != width)
        cure = "give every column in every line"
        if self._source.delimiter == "," and len(block[i]) > width:
            cure += "; numbers with a decimal comma need ';' between the columns"
        raise DataError(
            f"{len(block[i])} values, but the header has {width} columns", where=self._where(i, ""), cure=cure
        )

    def _add_sensors(self, cells: Sequence[str]) -> None:
        names = [cell.strip() for cell in cells]
        if "" in names:
            raise DataError("the sensor has no name", where=self._where(names.index(""), "sensor"))
        self._sensor += names

    def _status(self, cells: Sequence[str], i: int) -> int:
        word = cells[i].strip().lower()
        if not word:
            return UNKNOWN_STATUS
        if word not in STATUS_WORDS:
            names = tuple(status.name.lower() for status in Status)
            raise DataError(
                f"unknown status '{cells[i][:40]}'", where=self._where(i, "status"), cure=nearest(word[:40], names)
            )
        return STATUS_WORDS[word]

    def _convert(self, column: str, cells: Sequence[str]) -> FloatArray:
        joined = "".join(cells)
        # float() also takes underscores and the digits of every script; neither is a number in a CSV file.
        if "_" in joined or not joined.isascii():
            self._refuse(column, cells, lambda cell: "_" in cell or not cell.isascii())
        if self._source.delimiter != ",":
            cells = self._with_points(column, cells, joined)
        empty = {"range_m": "inf", "sigma_m": "nan", "amplitude": "nan"}.get(column)
        if empty is not None:
            cells = [cell if cell and not cell.isspace() else empty for cell in cells]
        try:
            values = np.array(list(map(float, cells)))
        except ValueError:
            self._refuse(column, cells, lambda cell: not _is_float(cell))
            raise
        self._refuse_overflow(column, cells, values)
        return values

    def _with_points(self, column: str, cells: Sequence[str], joined: str) -> Sequence[str]:
        """Decimal commas made points; a file has the one or the other, never both."""
        late = "." if self._commas or (not self._points and "," in cells[0]) else ","
        self._commas |= "," in joined
        self._points |= "." in joined
        if self._commas and self._points:
            self._refuse(column, cells, lambda cell: late in cell, "the file mixes decimal points and decimal commas")
        return [cell.replace(",", ".") for cell in cells] if self._commas else cells

    def _refuse(self, column: str, cells: Iterable[str], wrong: Callable[[str], bool], what: str = "") -> None:
        for i, cell in enumerate(cells):
            if wrong(cell):
                shown = f"'{cell[:40]}'" if cell.strip() else "an empty cell"
                raise DataError(
                    f"{shown} is not a number" + (f": {what}" if what else ""),
                    where=self._where(i, column),
                    cure="write numbers like -0.125 or 1.5e-3",
                )

    def _refuse_overflow(self, column: str, cells: Sequence[str], values: FloatArray) -> None:
        """A literal like 1e999 is no way to say inf."""
        for i in np.flatnonzero(np.isinf(values)).tolist():
            if cells[i].strip().lstrip("+-").lower() not in _INF_WORDS:
                raise DataError(f"'{cells[i][:40]}' is too large", where=self._where(i, column), cure="give SI units")

    def table(self) -> ReadingTable:
        if self._rows == 0:
            raise DataError("the file has a header but no readings", where=str(self._source.path), cure="add rows")

        def column(name: str) -> FloatArray | None:
            blocks = self._numbers.get(name)
            return np.concatenate(blocks) if blocks else None

        def columns(*names: str) -> FloatArray:
            return np.column_stack([np.concatenate(self._numbers[name]) for name in names])

        status, stop = column("status"), column("stop")
        table = ReadingTable(
            source=self._source,
            t_s=columns("t")[:, 0],
            sensor=self._sensor,
            position_m=columns("px", "py", "pz"),
            axis=columns("ax", "ay", "az"),
            range_m=columns("range_m")[:, 0],
            status=None if status is None else status.astype(np.int64),
            sigma_m=column("sigma_m"),
            amplitude=column("amplitude"),
            stop=None,
            notes=self._source.notes,
        )
        return table if stop is None else with_stop(table, stop)


def _is_float(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
