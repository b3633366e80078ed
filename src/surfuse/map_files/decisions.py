"""The decisions of a method on the regions of its map, as a group of the native map file: one row a region."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import h5netcdf
import h5py
import numpy as np

from surfuse.errors import DataError
from surfuse.records import FloatArray, GuardReason, IntArray, RegionDecision

LARGEST = 1_000_000
MOST_CANDIDATES = 32
_WHOLE = ("cells", "held_out", "chosen", "reason")


def columns(decisions: Sequence[RegionDecision]) -> tuple[dict[str, IntArray], dict[str, FloatArray]]:
    """Whole numbers (N,) and real numbers (N, 2 or K) of N decisions among the same K candidates.

    Raises
    ------
    DataError : the regions were decided among different candidates.
    """
    names = decisions[0].candidates
    if any(one.candidates != names for one in decisions):
        raise DataError("the regions of the map were decided among different candidates")
    whole = {
        "cells": [one.cells for one in decisions],
        "held_out": [one.held_out for one in decisions],
        "chosen": [names.index(one.chosen) for one in decisions],
        "reason": [int(one.reason) for one in decisions],
    }
    real = {
        "low_uv": [one.low_uv_m for one in decisions],
        "high_uv": [one.high_uv_m for one in decisions],
        "miss": [one.miss_m for one in decisions],
        "above_free_space": [one.above_free_space for one in decisions],
    }
    return (
        {name: np.array(values, dtype=np.int64) for name, values in whole.items()},
        {name: np.array(values, dtype=np.float64) for name, values in real.items()},
    )


def _checksum(names: str, whole: dict[str, IntArray], real: dict[str, FloatArray]) -> int:
    value = zlib.crc32(names.encode())
    for array in (*whole.values(), *real.values()):
        value = zlib.crc32(np.ascontiguousarray(array).tobytes(), value)
    return value


def write_decisions(group: h5netcdf.Group, decisions: Sequence[RegionDecision]) -> None:
    """Fill an empty group."""
    whole, real = columns(decisions)
    names = " ".join(decisions[0].candidates)
    group.dimensions = {"regions": len(decisions), "uv": 2, "candidates": len(decisions[0].candidates)}
    group.attrs["candidates"] = names
    group.attrs["content_crc32"] = np.uint32(_checksum(names, whole, real))
    for name, column in whole.items():
        group.create_variable(name, ("regions",), data=column)
    for name, table in real.items():
        second = "uv" if name.endswith("_uv") else "candidates"
        group.create_variable(name, ("regions", second), data=table).attrs["units"] = (
            "1" if name == "above_free_space" else "m"
        )
    group.variables["chosen"].attrs["flag_values"] = np.arange(len(decisions[0].candidates), dtype=np.int64)
    group.variables["chosen"].attrs["flag_meanings"] = names
    group.variables["reason"].attrs["flag_values"] = np.array([int(r) for r in GuardReason], dtype=np.int64)
    group.variables["reason"].attrs["flag_meanings"] = " ".join(r.name.lower() for r in GuardReason)


def read_decisions(group: h5py.Group) -> tuple[RegionDecision, ...]:
    """The decisions of a group.

    Raises
    ------
    DataError : more regions than any map of ours has, or damaged.
    """
    text = str(group.attrs["candidates"])
    names = tuple(text.split(" "))
    size = len(group["cells"])
    if size > LARGEST or len(names) > MOST_CANDIDATES:
        raise DataError(f"the map names {size} regions and {len(names)} candidates", cure="write the map again")
    whole = {name: group[name][...].astype(np.int64) for name in _WHOLE}
    real = {name: group[name][...].astype(np.float64) for name in ("low_uv", "high_uv", "miss", "above_free_space")}
    if int(np.asarray(group.attrs["content_crc32"]).reshape(1)[0]) != _checksum(text, whole, real):
        raise DataError("the decisions of the map fail their checksum: it is damaged", cure="write the map again")
    return tuple(
        RegionDecision(
            low_uv_m=(float(real["low_uv"][k, 0]), float(real["low_uv"][k, 1])),
            high_uv_m=(float(real["high_uv"][k, 0]), float(real["high_uv"][k, 1])),
            cells=int(whole["cells"][k]),
            held_out=int(whole["held_out"][k]),
            candidates=names,
            chosen=names[int(whole["chosen"][k])],
            reason=GuardReason(int(whole["reason"][k])),
            miss_m=tuple(float(x) for x in real["miss"][k]),
            above_free_space=tuple(float(x) for x in real["above_free_space"][k]),
        )
        for k in range(size)
    )
