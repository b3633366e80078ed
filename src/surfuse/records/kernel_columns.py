"""Readings and fused points as plain columns: what the compiled kernels of the fusion methods work on.

A live sweep is a scan of one stop, so that live and replayed fusion run the very same compiled code. Which columns a
kernel sees is what the two tuples name; all else follows from the tables of the records.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from surfuse.records import BoolArray, FloatArray, FusedPoints, IntArray, Readings, Sweep
from surfuse.records.columns import Per, columns_of, edges_of, view


class ScanColumns(NamedTuple):
    """N readings of M stops, ragged by `start` (M + 1,); frames and units as in `surfuse.records.Readings`."""

    range_m: FloatArray
    status: IntArray
    sensor: IntArray
    position_m: FloatArray
    axis: FloatArray
    sigma_m: FloatArray
    start: IntArray
    row: IntArray
    world_from_grip: FloatArray


class PointColumns(NamedTuple):
    """Fused points as in `surfuse.records.FusedPoints`, written by a kernel.

    A reading that failed validation has dc = 0 and nan for the three factors: they were never evaluated.
    """

    depth_m: FloatArray
    sigma_m: FloatArray
    point_m: FloatArray
    gap: IntArray
    reset: BoolArray
    dc: FloatArray
    dc1: FloatArray
    dc2: FloatArray
    dc3: FloatArray
    gate: IntArray


_PER_STOP = frozenset(column.name for column in columns_of(Sweep) if column.per is Per.STOP)
_TABLE = {column.name: column for column in columns_of(FusedPoints)}
_LAYOUT = tuple(
    (_TABLE[name].per is Per.STOP, _TABLE[name].entry, np.dtype(_TABLE[name].dtype)) for name in PointColumns._fields
)
_HANDED_ON = tuple(column.name for column in columns_of(FusedPoints) if column.name not in PointColumns._fields)


def scan_of(readings: Readings | Sweep) -> ScanColumns:
    """The columns of a scan, or of one stop as a scan of its own (views where the layout allows)."""
    if isinstance(readings, Sweep):
        return ScanColumns(*(_of_one_stop(readings, name) for name in ScanColumns._fields))
    return ScanColumns(*(np.ascontiguousarray(getattr(readings, name)) for name in ScanColumns._fields))


def _of_one_stop(sweep: Sweep, name: str) -> Any:
    if name == "start":
        return edges_of([sweep.n_readings])
    value = getattr(sweep, name)
    if name not in _PER_STOP:
        return np.ascontiguousarray(value)
    entry = np.array([value]) if isinstance(value, int) else np.ascontiguousarray(value)[np.newaxis]
    # Records are read-only; the same flag here keeps the kernels at one compiled version.
    entry.setflags(write=False)
    return entry


def empty_points(n_stops: int, n_readings: int) -> PointColumns:
    """Columns for a kernel to fill."""
    return PointColumns._make(
        np.empty((n_stops if of_stop else n_readings, *entry), dtype) for of_stop, entry, dtype in _LAYOUT
    )


def fused_points(scan: ScanColumns, readings: Readings | Sweep, columns: PointColumns) -> FusedPoints:
    """The record of all stops in the columns, which are read-only from now on."""
    for column in columns:
        column.setflags(write=False)
    handed_on = {
        name: _of_one_stop(readings, name) if isinstance(readings, Sweep) else getattr(readings, name)
        for name in _HANDED_ON
    }
    return view(FusedPoints, start=scan.start, **handed_on, **columns._asdict())
