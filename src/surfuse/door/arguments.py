"""What a caller hands in, made into what the stages take; whatever does not fit is refused by name."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError, UsageError
from surfuse.records import FloatArray

FilePath = str | os.PathLike[str]
_NUMBER_KINDS = "fiu"


def path_of(value: FilePath, name: str) -> Path:
    """A path of the file system.

    Raises
    ------
    UsageError : neither a text nor a path.
    """
    if isinstance(value, str | os.PathLike):
        return Path(value)
    raise UsageError(f"{name} = {shown(value)}", cure="give the path of a file or folder")


def numbers(values: npt.ArrayLike, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """A new array (`shape`, None: any length) of float64 from a list, array or column; masked values become nan.

    Raises
    ------
    DataError : texts, times, complex numbers, None, ragged lists, another shape.
    """
    cure = f"give {_wanted(shape)}"
    try:
        raw = _unmasked(values)
        if raw.dtype.kind not in _NUMBER_KINDS + "O":
            raise DataError(f"{name} has the type {raw.dtype}", cure=cure)
        if raw.dtype.kind == "O" and any(isinstance(item, str | bytes | bool) for item in raw.flat):
            raise DataError(f"{name} holds texts or truth values", cure=cure)
        if raw.dtype.kind == "O" and any(item is None for item in raw.flat):
            raise DataError(f"{name} holds None", cure=f"{cure}; nan where there is none")
        array = raw.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} is no array of numbers ({error})", cure=cure) from error
    fits = array.ndim == len(shape) and all(
        length in (None, found) for length, found in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise DataError(f"{name} has shape {array.shape}", cure=cure)
    return array


def _wanted(shape: tuple[int | None, ...]) -> str:
    """An array in words: numbers of shape (20, 3), or of one dimension and any length."""
    if shape == (None,):
        return "numbers in a list or array of one dimension, one a reading"
    return f"numbers of shape ({', '.join('any number' if length is None else str(length) for length in shape)})"


def _unmasked(values: npt.ArrayLike) -> npt.NDArray[np.generic]:
    """The array, masked numbers as nan."""
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "iu":
        values = values.astype(np.float64)
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "fO":
        return np.asarray(values.filled(np.nan))
    return np.asarray(values)


def names(values: npt.ArrayLike, name: str, count: int) -> list[str]:
    """A list of `count` names from texts or whole numbers.

    Raises
    ------
    DataError : one text for all, other types, another length.
    """
    cure = f"give {count} names or whole numbers, one a reading"
    if isinstance(values, str | bytes):
        raise DataError(f"{name} = {shown(values)} is one text", cure=cure)
    try:
        cells = list(np.asarray(values).astype(object).ravel()) if np.ndim(values) == 1 else None
    except ValueError:
        cells = None
    if cells is None or len(cells) != count:
        raise DataError(f"{name} has shape {'of its own' if cells is None else (len(cells),)}", cure=cure)
    for row, cell in enumerate(cells):
        if isinstance(cell, bool) or not isinstance(cell, str | int | np.integer):
            raise DataError(f"{name}[{row}] = {shown(cell)}", cure=cure)
    return [str(cell).strip() for cell in cells]


def finite_number(value: float, name: str) -> float:
    """A finite number.

    Raises
    ------
    UsageError : anything else.
    """
    found = plain(value)
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        raise UsageError(f"{name} = {shown(value)}", cure="give a finite number")
    return float(found)


def plain(value: object) -> object:
    """A value of NumPy as the plain one of Python; whatever else it is stays what it is."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return value


def plain_values(values: Mapping[str, object] | None, name: str) -> dict[str, object]:
    """Keys and plain values of a mapping (None: none).

    Raises
    ------
    UsageError : not a mapping from texts.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        raise UsageError(f"{name} = {shown(values)}", cure="give a mapping from names to values")
    return {key: plain(value) for key, value in values.items()}


def shown(value: object) -> str:
    """A value in one short line, for a message."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:60]}..."
