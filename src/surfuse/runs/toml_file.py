"""Reading small TOML files that may be hostile: size, depth and values are bounded, errors name file and line."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

from surfuse.errors import ConfigError, nearest
from surfuse.runs.log_files import read_whole

MAX_BYTES = 64 * 1024
MAX_DEPTH = 16

# A key of many thousand dotted parts takes the parser seconds: it is refused before.
_DECIMAL_COMMA = re.compile(rb"(?m)^[^#\n\[]*=[ \t]*(-?\d+,\d+)[ \t]*(?:#.*)?\r?$")
_LONG_KEY = re.compile(rb"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){%d}""" % MAX_DEPTH)

_HEADER = re.compile(r"\s*\[{1,2}\s*([\w.-]+)\s*\]")
_LISTED = ("sensor",)  # tables of which a file may hold several

Table = Mapping[str, object]


def _with_point(number: bytes) -> str:
    return number.decode("ascii").replace(",", ".")


def _cure_of(error: str, content: bytes) -> str:
    """What to do about an error of the parser."""
    comma = _DECIMAL_COMMA.search(content)
    if comma is not None:
        return f"write numbers with a point: {_with_point(comma[1])}"
    if error.startswith(("Cannot declare", "Cannot overwrite")):
        lines = content.decode("utf-8-sig").rstrip().split("\n")
        place = re.search(r"line (\d+)", error)
        header = _HEADER.match(lines[int(place[1]) - 1 if place else -1])
        if header is not None:
            name = header[1]
            return f"write [[{name}]] for each" if name in _LISTED else f"write one [{name}] table"
    return "correct that line"


def parse_toml(content: bytes, where: str) -> dict[str, object]:
    """The tables of a TOML text.

    Raises
    ------
    ConfigError : more than 64 kB, nested deeper than 16, not UTF-8, not TOML, or a number that is not finite
        (inf and nan are TOML, but no quantity of ours).
    """
    if len(content) > MAX_BYTES:
        raise ConfigError(f"the file has {len(content)} bytes, at most {MAX_BYTES} are read", where=where)
    long_key = _LONG_KEY.search(content)
    if long_key is not None:
        line = content.count(b"\n", 0, long_key.start()) + 1
        raise ConfigError(f"line {line} is nested deeper than {MAX_DEPTH}", where=where, cure="give plain tables")
    try:
        tables = tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ConfigError(f"byte {error.start} is not UTF-8", where=where, cure="save the file as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not valid TOML: {error}", where=where, cure=_cure_of(str(error), content)) from error
    except RecursionError as error:
        raise ConfigError("the file is nested too deep", where=where, cure="give plain tables") from error
    _check(tables, where, ())
    return tables


def read_toml(path: Path) -> dict[str, object]:
    """The tables of a TOML file; see `parse_toml`.

    Raises
    ------
    StorageError : the file cannot be read.
    """
    return parse_toml(read_whole(path), str(path))


def _check(value: object, where: str, keys: tuple[str, ...]) -> None:
    if len(keys) > MAX_DEPTH:
        raise ConfigError(f"{'.'.join(keys[:3])}... is nested deeper than {MAX_DEPTH}", where=where)
    if isinstance(value, dict):
        for key, inner in value.items():
            _check(inner, where, (*keys, str(key)))
    elif isinstance(value, list):
        for inner in value:
            _check(inner, where, (*keys, "[]"))
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{'.'.join(keys)} = {value}", where=where, cure="give a finite number")


def refuse_unknown(table: Table, valid: Iterable[str], where: str) -> None:
    """Raise ConfigError for the first key that is not one of the valid ones, with the nearest of them.

    Raises
    ------
    ConfigError : there is such a key; names it and the nearest valid one.
    """
    names = tuple(valid)
    for key in table:
        if key not in names:
            raise ConfigError(f"unknown key '{key}'", where=where, cure=nearest(key, names))


def number(table: Table, key: str, where: str, default: float | None = None) -> float:
    """A number of a table as float; without a default the key must be there.

    Raises
    ------
    ConfigError : the key is missing, or its value is not a number.
    """
    if key not in table:
        if default is None:
            raise ConfigError(f"the key '{key}' is missing", where=where, cure=f"add '{key} = <number>'")
        return default
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{key} = {value!r} is not a number", where=where, cure="give a number without quotes")
    return float(value)


def vector(table: Table, key: str, where: str) -> tuple[float, float, float]:
    """Three numbers of a table.

    Raises
    ------
    ConfigError : the key is missing, or its value is not a list of three numbers.
    """
    value = table.get(key)
    if not isinstance(value, list) or len(value) != 3:
        raise ConfigError(
            f"{key} = {value!r} is not a list of three numbers", where=where, cure=f"write {key} = [x, y, z]"
        )
    x, y, z = (number({key: item}, key, where) for item in value)
    return x, y, z
