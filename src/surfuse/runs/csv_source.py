"""The text of a readings CSV: its encoding, its dialect and its header, and where in the file a row stands."""

from __future__ import annotations

import csv
import difflib
import io
from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from surfuse.errors import DataError, nearest
from surfuse.runs.log_files import read_whole

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

REQUIRED = ("t", "sensor", "px", "py", "pz", "ax", "ay", "az", "range_m")
OPTIONAL = ("status", "sigma_m", "amplitude", "stop")
COMMENT = "#"
_ALIKE = 0.75  # how alike an unknown name is to one that it may have been meant for, 1 for equal (difflib)
_NAMED = 8


class CsvSource:
    """The text of a CSV file with its dialect: `,`, `;` or tab, decimal point or (not with `,`) decimal comma.

    `header` holds our names of the columns, and an empty text for each column that is not read; `notes` what is odd
    about them. Lines that begin with `#` are comments.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = _decode(read_whole(path), path)
        number, line = _header_line(self.text, path)
        self.delimiter, given = _dialect(line, f"{path}:{number}")
        self.header, self.notes = _columns(given, f"{path}:{number}")

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
        """A fresh reader that stands behind the header (the first line that is neither blank nor a comment)."""
        reader = csv.reader(_uncommented(self.text), delimiter=self.delimiter, strict=True)
        while not any(map(str.strip, next(reader))):
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


def _uncommented(text: str) -> Iterable[str]:
    """The lines of a text, comments made blank, so that all keep their numbers."""
    lines = io.StringIO(text, newline="")
    return ("\n" if _is_comment(line) else line for line in lines) if COMMENT in text else lines


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENT)


def _header_line(text: str, path: Path) -> tuple[int, str]:
    """Number and text of the header, which is the first line that is neither blank nor a comment."""
    for number, line in enumerate(_uncommented(text), start=1):
        if line.strip():
            return number, line.strip("\r\n")
    cure = f"give a header and rows: {','.join(REQUIRED)}"
    raise DataError("the file holds nothing but comments", where=str(path), cure=cure)


def _dialect(line: str, where: str) -> tuple[str, list[str]]:
    """The delimiter under which a header names most of our columns, and its names as written."""
    known = set(REQUIRED + OPTIONAL)
    best: tuple[str, list[str]] = (",", [])
    problem = ""
    for delimiter in (",", ";", "\t"):
        try:
            names = [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])]
        except csv.Error as error:
            problem = str(error)
            continue
        if not best[1] or len(known & set(map(_plain, names))) > len(known & set(map(_plain, best[1]))):
            best = (delimiter, names)
    if not best[1]:
        raise DataError(f"not a CSV file: {problem}", where=where, cure="give a header line")
    return best


def _plain(name: str) -> str:
    """A name of a column, in any case and with spaces, as ours are written."""
    return "_".join(name.casefold().split())


def _columns(given: list[str], where: str) -> tuple[list[str], tuple[str, ...]]:
    """Our names of the columns of a header, an empty text for each that is not read, and what is to be told of them.

    Raises
    ------
    DataError : a required column is missing, or one of ours comes twice.
    """
    plain = [_plain(name) for name in given]
    header = [name if name in REQUIRED + OPTIONAL else "" for name in plain]
    others = [name for name, ours in zip(given, header, strict=True) if not ours]
    missing = [name for name in REQUIRED if name not in header]
    if missing:
        raise _missing(missing, others, where)
    twice = [name for name in header if name and header.count(name) > 1]
    if twice:
        raise DataError(f"the column '{twice[0]}' comes twice", where=where, cure="keep one of them")
    absent = [name for name in OPTIONAL if name not in header]
    return header, (_not_read(others, absent, where),) if others else ()


def _missing(missing: list[str], others: list[str], where: str) -> DataError:
    cure = f"the header must name {','.join(REQUIRED)}"
    near = [f"'{name[:40]}' is close to '{missing[0]}'" for name in others[:200] if missing[0] == _meant(name)]
    return DataError(
        f"the columns {', '.join(missing)} are missing" if len(missing) > 1 else f"the column {missing[0]} is missing",
        where=where,
        cure=f"{near[0]}; {cure}" if near else cure,
    )


def _meant(name: str) -> str:
    """The required column that a name was perhaps meant to be, or an empty text."""
    cure = nearest(_plain(name)[:40], REQUIRED)
    return cure.split("'")[1] if cure.startswith("did you mean") else ""


def _not_read(others: list[str], absent: list[str], where: str) -> str:
    """One sentence on the columns that have no meaning here; `absent` are optional ones that the file does not have."""
    named = [f"'{name[:40]}'" if name else "one without a name" for name in others[:_NAMED]]
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    sentence = f"{where}: {'column' if len(others) == 1 else 'columns'} not read: {', '.join(named)}{more}"
    for name in others[:200]:
        like = difflib.get_close_matches(_plain(name)[:40], absent, n=1, cutoff=_ALIKE)
        if like:
            return f"{sentence}; did you mean '{like[0]}' by '{name[:40]}'?"
    return sentence
