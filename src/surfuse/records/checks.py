"""Array types, and the checks every record makes of its arrays."""

from __future__ import annotations

from typing import TypeGuard

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.poses import is_rigid

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
        if not is_rigid(getattr(record, name)):
            raise DataError(f"{type(record).__name__}.{name} is not a right-handed rigid pose")
