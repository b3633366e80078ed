"""The text of a readings CSV: its encoding, its dialect and its header, and where in the file a row stands."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from surfuse.errors import DataError, nearest
from surfuse.runs.log_files import read_whole

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

REQUIRED = ("t", "sensor", "px", "py", "pz", "ax", "ay", "az", "range_m")
OPTIONAL = ("status", "sigma_m", "amplitude", "stop")


class CsvSource:
    """The text of a CSV file with its dialect: `,`, `;` or tab, decimal point or (not with `,`) decimal comma."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = _decode(read_whole(path), path)
        self.delimiter, self.header = _dialect(self.text, path)

    @property
    def name(self) -> str:
        """The path of the file."""
        return str(self.path)

    @property
    def sensors_name(self) -> str:
        """The file that describes the sensors."""
        return "sensors.toml"

    @property
    def frame_name(self) -> str:
        """The file that gives the part frame."""
        return "frame.toml"

    def where(self, row: int, column: str) -> str:
        """`file:line:column` of a cell."""
        return f"{self.path}:{self.line_of(row)}:{column}"

    def row_names(self, one: int, other: int) -> str:
        """The lines of two rows."""
        return f"lines {self.line_of(one)} and {self.line_of(other)}"

    def reader(self) -> CsvReader:
        """A fresh reader that stands behind the header (the first line that is not blank)."""
        reader = csv.reader(io.StringIO(self.text, newline=""), delimiter=self.delimiter, strict=True)
        while not next(reader):
            pass
        return reader

    def checked(self, read: Callable[[], list[list[str]]], reader: CsvReader) -> list[list[str]]:
        """What `read` takes from `reader`, with the errors of the csv module made ours.

        Raises
        ------
        DataError : the file is not CSV; names file and line.
        """
        try:
            return read()
        except csv.Error as error:
            raise DataError(
                f"not a CSV file: {error}",
                where=f"{self.path}:{reader.line_num}",
                cure="correct the quotes of that line, and keep fields short",
            ) from error

    def line_of(self, row: int) -> int:
        """Line in the file of data row `row` (from 0)."""
        reader = self.reader()
        return next(islice((reader.line_num for cells in reader if cells), row, None))


def _decode(content: bytes, path: Path) -> str:
    if not content.strip():
        raise DataError("the file is empty", where=str(path), cure=f"give a header and rows: {','.join(REQUIRED)}")
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise DataError(
            f"byte {content[error.start]:#04x} is not {encoding.removesuffix('-sig').upper()}",
            where=f"{path}:{line}",
            cure="save the file as UTF-8",
        ) from error


def _dialect(text: str, path: Path) -> tuple[str, list[str]]:
    """The delimiter under which the first line names most of our columns, and that line's names."""
    known = set(REQUIRED + OPTIONAL)
    best: tuple[str, list[str]] = (",", [])
    first_line = re.split("[\r\n]", text.lstrip("\r\n"), maxsplit=1)[0]
    problem = ""
    for delimiter in (",", ";", "\t"):
        try:
            names = next(csv.reader([first_line], delimiter=delimiter), [])
        except csv.Error as error:
            problem = str(error)
            continue
        header = [name.strip() for name in names]
        if len(known & set(header)) > len(known & set(best[1])) or not best[1]:
            best = (delimiter, header)
    if not best[1]:
        raise DataError(f"not a CSV file: {problem}", where=f"{path}:1", cure="give a header line")
    _check_header(best[1], path)
    return best


def _check_header(header: list[str], path: Path) -> None:
    where = f"{path}:1"
    missing = [name for name in REQUIRED if name not in header]
    extra = [name for name in header if name not in REQUIRED + OPTIONAL]
    if missing:
        cure = f"the header must name {','.join(REQUIRED)}"
        near = [f"'{name[:40]}' is close to '{missing[0]}'" for name in extra[:200] if missing[0] == _meant(name)]
        raise DataError(
            f"the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} {'are' if len(missing) > 1 else 'is'} "
            "missing",
            where=where,
            cure=f"{near[0]}; {cure}" if near else cure,
        )
    if extra:
        more = f" (and {len(extra) - 1} more)" if len(extra) > 1 else ""
        cure = nearest(extra[0][:40], REQUIRED + OPTIONAL)
        raise DataError(f"unknown column '{extra[0][:40]}'{more}", where=where, cure=f"remove it, or {cure}")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise DataError(f"the column '{twice[0]}' comes twice", where=where, cure="keep one of them")


def _meant(name: str) -> str:
    """The required column that a name was perhaps meant to be, or an empty text."""
    cure = nearest(name[:40], REQUIRED)
    return cure.split("'")[1] if cure.startswith("did you mean") else ""
