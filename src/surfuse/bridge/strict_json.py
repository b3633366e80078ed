"""One line of the wire to one JSON object and back: strict, bounded, and exact to the last bit of a number."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence

from surfuse.errors import DataError

Json = Mapping[str, object] | Sequence[object] | str | float | int | bool | None

LINE_LIMIT_BYTES = 2**20
IMAGE_LIMIT_BYTES = 16 * 2**20
DEPTH_LIMIT = 16
DIGITS_LIMIT = 21  # JavaScript writes whole numbers below 1e21 without exponent
_SHOWN_BYTES = 60

# A string without an end matches too: else a line of escaped quotes would be scanned again from each of them.
_STRING = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*(?:"|\\?\Z)', re.DOTALL)
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_STEP = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}


def cleaned(text: str, limit: int = 200) -> str:
    """Text of a stranger as it may stand in our messages: one line, nothing invisible, at most `limit` characters."""
    words = " ".join("".join(letter if letter.isprintable() else " " for letter in text[: 4 * limit]).split())
    return words if len(words) <= limit and len(text) <= 4 * limit else words[: limit - 3] + "..."


def in_a_sentence(text: str, limit: int = 200) -> str:
    """The same without the full stop at its end: words of ours follow."""
    words = cleaned(text, limit)
    return words if words.endswith("...") else words.rstrip(" .")


def shown(line: bytes) -> str:
    """The beginning of a line, for an error message."""
    return "'" + cleaned(line[: 4 * _SHOWN_BYTES].decode("utf-8", "replace"), _SHOWN_BYTES) + "'"


def decode_line(line: bytes) -> dict[str, object]:
    """The JSON object that a line without its end holds.

    Raises
    ------
    DataError : not UTF-8, not JSON, not an object; a key twice; NaN, Infinity or a number beyond float64; a whole
        number of more than 21 digits; brackets more than 16 deep.
    """
    _check_depth(line)
    try:
        value = json.loads(
            line.decode("utf-8"),
            object_pairs_hook=_without_twins,
            parse_constant=_refuse_constant,
            parse_float=_finite,
            parse_int=_short_integer,
        )
    except UnicodeDecodeError as error:
        raise DataError(f"byte {error.start} of the line {shown(line)} is not UTF-8", cure="write UTF-8") from error
    except (json.JSONDecodeError, RecursionError) as error:
        raise DataError(f"the line {shown(line)} is not JSON: {error}", cure="write one JSON object a line") from error
    if not isinstance(value, dict):
        raise DataError(f"the line {shown(line)} is not a JSON object", cure="write one JSON object a line")
    return value


def encode_line(message: Mapping[str, Json], limit_bytes: int = LINE_LIMIT_BYTES) -> bytes:
    """A JSON object as one line with its end; every float64 comes back with the same bits.

    Raises
    ------
    DataError : a number that is not finite, or a line of more than `limit_bytes`.
    """
    try:
        line = json.dumps(message, allow_nan=False, separators=(",", ":")).encode("ascii") + b"\n"
    except ValueError as error:
        raise DataError(f"a message that JSON cannot hold: {error}", cure="write finite numbers only") from error
    if len(line) > limit_bytes:
        raise DataError(f"a line of {len(line)} bytes, at most {limit_bytes}", cure="send less at a time")
    return line


def _check_depth(line: bytes) -> None:
    """Brackets outside of strings; the parser itself would recurse as deep as the line says."""
    brackets = line.translate(None, _NOT_BRACKETS)
    if len(brackets) <= DEPTH_LIMIT:
        return
    brackets = _STRING.sub(b"", line).translate(None, _NOT_BRACKETS)
    depth = max(itertools.accumulate((_STEP[bracket] for bracket in brackets), initial=0))
    if depth > DEPTH_LIMIT:
        raise DataError(f"brackets {depth} deep, at most {DEPTH_LIMIT}", cure="write the flat objects of the protocol")


def _without_twins(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """An object, refused when a key stands twice: nobody knows which one is meant."""
    result = dict(pairs)
    if len(result) != len(pairs):
        twin = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise DataError(f"the key '{cleaned(twin, 40)}' stands twice in one object", cure="write each key once")
    return result


def _refuse_constant(name: str) -> object:
    raise DataError(f"{name} is not JSON", cure='write null and a "status" for a range without a number')


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise DataError(f"the number {cleaned(text, 40)} is beyond float64", cure="write finite numbers only")
    return value


def _short_integer(text: str) -> int:
    if len(text) > DIGITS_LIMIT + text.startswith("-"):
        raise DataError(f"a whole number of {len(text)} digits, at most {DIGITS_LIMIT}", cure="write it as 1.5e9 or so")
    return int(text)
