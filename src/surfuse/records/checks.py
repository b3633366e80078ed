"""Array types, and the checks every record makes of its arrays."""

from __future__ import annotations

from typing import TypeGuard

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.poses import are_rigid

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]


def owned(
    array: npt.ArrayLike, dtype: npt.DTypeLike, name: str, shape: tuple[int | None, ...]
) -> npt.NDArray[np.generic]:
    """A read-only array with the asked type and shape (None: any length): a copy, unless nobody can write to it."""
    copy = array if _is_fixed(array, dtype) else np.array(array, dtype=dtype)
    fits = copy.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, copy.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise DataError(f"{name} has shape {copy.shape}, wanted {wanted}")
    copy.setflags(write=False)
    return copy


def _is_fixed(array: npt.ArrayLike, dtype: npt.DTypeLike) -> TypeGuard[npt.NDArray[np.generic]]:
    """Whether an array of this type is read-only, and so is the array that it may be a view of."""
    if not isinstance(array, np.ndarray) or array.dtype != dtype or array.flags.writeable:
        return False
    return array.base is None or (isinstance(array.base, np.ndarray) and not array.base.flags.writeable)


def own(record: object, dtype: npt.DTypeLike, **shapes: tuple[int | None, ...]) -> None:
    """Replace fields of a frozen record by their checked read-only copies."""
    for name, shape in shapes.items():
        object.__setattr__(record, name, owned(getattr(record, name), dtype, f"{type(record).__name__}.{name}", shape))


def own_pose(record: object, *names: str) -> None:
    """Replace fields of a record by owned 4 x 4 arrays, refused unless each is a rigid motion."""
    own(record, np.float64, **dict.fromkeys(names, (4, 4)))
    for name in names:
        check_rigid(getattr(record, name), f"{type(record).__name__}.{name}")


def check_rigid(poses: FloatArray, name: str) -> None:
    """Refuse poses (..., 4, 4) of which one is no rigid motion."""
    rigid = are_rigid(poses)
    if not np.all(rigid):
        which = "" if poses.ndim == 2 else f"[{int(np.argmin(rigid))}]"
        raise DataError(
            f"{name}{which} is not a right-handed rigid pose",
            cure="give a rotation (orthonormal, determinant +1), a place in metres, and the last row 0, 0, 0, 1",
        )


def check_sensors(sensor: IntArray, known: int) -> None:
    """Refuse readings (N,) of a sensor that is not among the known ones.

    Raises
    ------
    DataError : names the first such sensor.
    """
    if len(sensor) and not (sensor.min() >= 0 and sensor.max() < known):
        wrong = sensor[(sensor < 0) | (sensor >= known)]
        raise DataError(
            f"a reading names sensor {wrong[0]}, but there are {known} sensors, numbered from 0",
            cure="describe every sensor of the log",
        )


UNIT_TOLERANCE = 1e-3
"""How far the length of a unit vector may be from 1: a file has four digits of it."""


def check_unit(axis: FloatArray, name: str) -> None:
    """Refuse directions (N, 3) of another length than 1; nan is a direction that nobody knows."""
    square = np.einsum("nk,nk->n", axis, axis)
    with np.errstate(invalid="ignore"):
        wrong = np.abs(square - 1.0) > 2.0 * UNIT_TOLERANCE
    if np.any(wrong):
        row = int(np.argmax(wrong))
        raise DataError(
            f"{name}[{row}] has the length {np.sqrt(square[row]):.6g}, wanted 1",
            cure="give unit vectors along the beams",
        )


def check_finite(values: FloatArray, name: str) -> None:
    """Refuse an array that holds nan or an infinite number."""
    wrong = ~np.isfinite(values)
    if np.any(wrong):
        raise DataError(f"{name} holds {values[wrong][0]:g}", cure="give finite numbers")


def check_least(values: npt.NDArray[np.floating | np.integer], name: str, least: float) -> None:
    """Refuse an array that holds a number below `least`; nan is a number that nobody knows."""
    with np.errstate(invalid="ignore"):
        wrong = values < least
    if np.any(wrong):
        raise DataError(f"{name} holds {values[wrong][0]:g}", cure=f"give {least:g} or more")


def check_share(values: FloatArray, name: str) -> None:
    """Refuse an array with a number outside 0 to 1, to rounding; nan is a number that nobody knows."""
    with np.errstate(invalid="ignore"):
        wrong = (values < 0.0) | (values > 1.0 + 1e-9)
    if np.any(wrong):
        raise DataError(f"{name} holds {values[wrong][0]:g}", cure="give 0 to 1")


def check_increasing(values: FloatArray, name: str) -> None:
    """Refuse an array that is not finite and increasing."""
    check_finite(values, name)
    if np.any(wrong := np.diff(values) <= 0.0):
        at = int(np.argmax(wrong))
        raise DataError(
            f"{name} goes from {values[at]:g} to {values[at + 1]:g} at {at + 1}", cure="give finite, increasing numbers"
        )


def check_number(name: str, value: float, low: float, high: float, *, above: bool = False) -> None:
    """Refuse a number outside low <= value <= high (low < value with `above`), and one that is not finite.

    Raises
    ------
    DataError : names the number, the value and the limits.
    """
    if np.isfinite(value) and (low < value if above else low <= value) and value <= high:
        return
    upper = "" if high == float("inf") else f" and at most {high:g}"
    raise DataError(f"{name} = {value:g}", cure=f"give a number {'above' if above else 'of at least'} {low:g}{upper}")
