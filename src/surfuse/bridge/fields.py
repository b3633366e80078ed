"""The fields of one JSON object, taken out by type; whatever does not fit is named with its path."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from surfuse.bridge.strict_json import cleaned
from surfuse.errors import DataError, nearest
from surfuse.records import FloatArray

ROTATION_TOLERANCE = 1e-6
BOTTOM_ROW = np.array([0.0, 0.0, 0.0, 1.0])
WHOLE_LIMIT = 2**53
_UNIT = np.eye(3)
T = TypeVar("T")


class Fields:
    """See the module. `path` says where the object stands, as `readings[2].`; keys that nobody asks for are ignored."""

    def __init__(self, values: Mapping[str, object], path: str = "") -> None:
        self._values, self._path = values, path

    def name_of(self, key: str) -> str:
        """The full name of a field, for messages."""
        return f"'{self._path}{key}'"

    def has(self, key: str) -> bool:
        """Whether the field is there and not null."""
        return self._values.get(key) is not None

    def value(self, key: str) -> object:
        """The raw value, which may be null.

        Raises
        ------
        DataError : the key is missing. So do all others here, also for a wrong type.
        """
        if key not in self._values:
            given = ", ".join(cleaned(name, 40) for name in list(self._values)[:12]) or "none"
            raise DataError(f"{self.name_of(key)} is missing; keys given: {given}", cure="see the protocol")
        return self._values[key]

    def number(self, key: str, *, least: float = -math.inf, most: float = math.inf) -> float:
        """A finite number; true and false are none."""
        return number_of(self.value(key), self.name_of(key), least=least, most=most)

    def positive(self, key: str) -> float:
        """A number above 0."""
        value = self.number(key)
        if not value > 0.0:
            raise DataError(f"{self.name_of(key)} = {value:g}, wanted a number above 0")
        return value

    def whole(self, key: str, *, least: int = 0, most: int = WHOLE_LIMIT) -> int:
        """A whole number, written as one."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise _wrong(self.name_of(key), value, "a whole number")
        if not least <= value <= most:
            raise DataError(f"{self.name_of(key)} = {value}, wanted {least} to {most}")
        return value

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self.value(key)
        if not isinstance(value, bool):
            raise _wrong(self.name_of(key), value, "true or false")
        return value

    def text(self, key: str) -> str:
        """Text of any length."""
        return text_of(self.value(key), self.name_of(key))

    def word(self, key: str, known: Mapping[str, T]) -> T:
        """What one of the known words stands for."""
        word = self.text(key)
        if word not in known:
            raise DataError(f"{self.name_of(key)} = '{cleaned(word, 40)}'", cure=nearest(word[:80], known))
        return known[word]

    def items(self, key: str) -> list[object]:
        """A list of anything."""
        value = self.value(key)
        if not isinstance(value, list):
            raise _wrong(self.name_of(key), value, "a list")
        return value

    def each(self, key: str, convert: Callable[[object, str], T]) -> tuple[T, ...]:
        """A list whose items are converted, each with its own name in the messages."""
        name = f"{self._path}{key}"
        return tuple(convert(item, f"'{name}[{i}]'") for i, item in enumerate(self.items(key)))

    def inner(self, key: str) -> Fields:
        """The object in a field."""
        return fields_of(self.value(key), self.name_of(key))

    def pose(self, key: str) -> FloatArray:
        """16 numbers, row by row, of a rigid pose: (4, 4)."""
        return pose_of(self.value(key), self.name_of(key))

    def numbers(self, key: str) -> FloatArray:
        """A list of finite numbers: (N,)."""
        return np.array(self.each(key, number_of), dtype=np.float64)


def number_of(value: object, name: str, *, least: float = -math.inf, most: float = math.inf) -> float:
    """A finite number within limits, as float64."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(name, value, "a number")
    result = float(value)
    if not math.isfinite(result):
        raise DataError(f"{name} = {result}, wanted a finite number")
    if not least <= result <= most:
        raise DataError(f"{name} = {result:g}, wanted {least:g} to {most:g}")
    return result


def text_of(value: object, name: str) -> str:
    """Text."""
    if not isinstance(value, str):
        raise _wrong(name, value, "text")
    return value


def flag_of(value: object, name: str) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise _wrong(name, value, "true or false")
    return value


def fields_of(value: object, name: str) -> Fields:
    """The fields of an object inside another."""
    if not isinstance(value, dict):
        raise _wrong(name, value, "an object")
    return Fields(value, name.strip("'") + ".")


def pose_of(value: object, name: str) -> FloatArray:
    """A rigid, right-handed pose (4, 4) from 16 numbers; the bottom row becomes exactly 0 0 0 1."""
    if not isinstance(value, list) or len(value) != 16:
        count = f"{len(value)} items" if isinstance(value, list) else _kind(value)
        raise DataError(f"{name} has {count}, wanted the 16 numbers of a 4 x 4 pose, row by row")
    matrix = np.array([number_of(item, f"{name}[{i}]") for i, item in enumerate(value)]).reshape(4, 4)
    check_rigid(matrix, name)
    matrix[3] = BOTTOM_ROW
    matrix.setflags(write=False)
    return matrix


def check_rigid(matrix: FloatArray, name: str) -> None:
    """Refuse a (4, 4) that is not a rigid, right-handed pose within 1e-6.

    Raises
    ------
    DataError : what is wrong with it.
    """
    if not np.abs(matrix[3] - BOTTOM_ROW).max() <= ROTATION_TOLERANCE:
        row = ", ".join(f"{item:g}" for item in matrix[3])
        raise DataError(f"{name} has the bottom row {row}, wanted 0, 0, 0, 1", cure="write the pose row by row")
    rotation = matrix[:3, :3]
    # Entries of a rotation are at most 1; beyond that the product below might overflow.
    largest = float(np.abs(rotation).max())
    off = float(np.abs(rotation @ rotation.T - _UNIT).max()) if largest < 2.0 else largest
    if not off <= ROTATION_TOLERANCE:
        raise DataError(
            f"{name} is no rotation: its rows are {off:.2g} off unit length and right angles, "
            f"at most {ROTATION_TOLERANCE:g}",
            cure="write all digits, and no scale",
        )
    if not float(np.linalg.det(rotation)) > 0.0:
        raise DataError(f"{name} is left-handed: the determinant is -1", cure="turn one axis round")


def _wrong(name: str, value: object, wanted: str) -> DataError:
    return DataError(f"{name} is {_kind(value)}, wanted {wanted}")


def _kind(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, int | float):
        return f"the number {value:g}"
    if isinstance(value, str):
        return f"the text '{cleaned(value, 40)}'"
    return "a list" if isinstance(value, list) else "an object"
