"""Numbers for the page's scripts: arrays as base64 of little-endian bytes, thinned to a budget."""

from __future__ import annotations

import base64
import math

import numpy as np
import numpy.typing as npt

Packed = dict[str, str | float | None]

# JavaScript views by name; "f4" keeps all digits that a map holds at the scale of a part.
KINDS = {"f4": "<f4", "u2": "<u2", "u1": "<u1"}


def pack(values: npt.ArrayLike, kind: str) -> Packed:
    """An array as {"t": kind, "b": base64}; one repeated number as {"t": "c", "v": number or None for nan}."""
    array = np.ascontiguousarray(np.asarray(values).ravel().astype(KINDS[kind]))
    first = array[:1]
    if array.size and bool(np.all(array == first)) and math.isfinite(float(first[0])):
        return {"t": "c", "v": float(first[0])}
    if array.size and array.dtype.kind == "f" and bool(np.all(np.isnan(array))):
        return {"t": "c", "v": None}
    return {"t": kind, "b": base64.b64encode(array.tobytes()).decode("ascii")}


def pack_share(values: npt.ArrayLike) -> Packed:
    """Numbers in [0, 1] in steps of 1/65534; nan is 65535."""
    array = np.asarray(values, dtype=np.float64)
    steps = np.where(np.isfinite(array), np.round(np.clip(array, 0.0, 1.0) * 65534.0), 65535.0)
    packed = pack(steps, "u2")
    return {**packed, "s": 1.0}


def stride_for(count: int, most: int, dimensions: int = 1) -> int:
    """The smallest stride that leaves at most `most` of `count` items, taken along one or two axes."""
    if count <= most:
        return 1
    return math.ceil(count / most) if dimensions == 1 else math.ceil(math.sqrt(count / most))


def thinned(count: int, stride: int) -> npt.NDArray[np.int64]:
    """Indices 0, stride, 2 stride, ... and always the last one, so that the border stays where it is."""
    index = np.arange(0, count, stride, dtype=np.int64)
    return index if not count or index[-1] == count - 1 else np.append(index, count - 1)
