"""Readings and fused points as plain columns: what the compiled kernels of the fusion methods work on.

A live sweep is a scan of one stop, so that live and replayed fusion run the very same compiled code.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surfuse.records import BoolArray, FloatArray, FusedPoint, FusedPoints, Gap, IntArray, Readings, Sweep


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


def scan_of_readings(readings: Readings) -> ScanColumns:
    """The columns of a whole scan (views where the layout allows)."""
    return ScanColumns(
        np.ascontiguousarray(readings.range_m),
        np.ascontiguousarray(readings.status),
        np.ascontiguousarray(readings.sensor),
        np.ascontiguousarray(readings.position_m),
        np.ascontiguousarray(readings.axis),
        np.ascontiguousarray(readings.sigma_m),
        np.ascontiguousarray(readings.start),
        np.ascontiguousarray(readings.row),
        np.ascontiguousarray(readings.world_from_grip),
    )


def _read_only(values: Sequence[int]) -> IntArray:
    # Records are read-only; the same flag here keeps the kernels at one compiled version.
    array = np.array(values, dtype=np.int64)
    array.setflags(write=False)
    return array


def scan_of_sweep(sweep: Sweep) -> ScanColumns:
    """The columns of one stop."""
    return ScanColumns(
        np.ascontiguousarray(sweep.range_m),
        np.ascontiguousarray(sweep.status),
        np.ascontiguousarray(sweep.sensor),
        np.ascontiguousarray(sweep.position_m),
        np.ascontiguousarray(sweep.axis),
        np.ascontiguousarray(sweep.sigma_m),
        _read_only((0, len(sweep.sensor))),
        _read_only((sweep.row,)),
        np.ascontiguousarray(sweep.world_from_grip)[np.newaxis],
    )


def empty_points(n_stops: int, n_readings: int) -> PointColumns:
    """Columns for a kernel to fill."""
    return PointColumns(
        np.empty(n_stops),
        np.empty(n_stops),
        np.empty((n_stops, 3)),
        np.empty(n_stops, dtype=np.int64),
        np.empty(n_stops, dtype=np.bool_),
        np.empty(n_readings),
        np.empty(n_readings),
        np.empty(n_readings),
        np.empty(n_readings),
        np.empty(n_readings, dtype=np.int64),
    )


def fused_point(sweep: Sweep, columns: PointColumns) -> FusedPoint:
    """The record of the one stop in the columns."""
    return FusedPoint(
        stop=sweep.stop,
        row=sweep.row,
        depth_m=float(columns.depth_m[0]),
        sigma_m=float(columns.sigma_m[0]),
        point_m=columns.point_m[0],
        sensor=sweep.sensor,
        dc=columns.dc,
        dc1=columns.dc1,
        dc2=columns.dc2,
        dc3=columns.dc3,
        gate=columns.gate,
        gap=Gap(int(columns.gap[0])),
        reset=bool(columns.reset[0]),
    )


def fused_points(readings: Readings, columns: PointColumns) -> FusedPoints:
    """The record of all stops in the columns, which are read-only from now on."""
    for column in columns:
        column.setflags(write=False)
    return FusedPoints(
        stop=readings.stop,
        row=readings.row,
        depth_m=columns.depth_m,
        sigma_m=columns.sigma_m,
        point_m=columns.point_m,
        gap=columns.gap,
        reset=columns.reset,
        start=readings.start,
        sensor=readings.sensor,
        dc=columns.dc,
        dc1=columns.dc1,
        dc2=columns.dc2,
        dc3=columns.dc3,
        gate=columns.gate,
    )


def stacked(points: Sequence[FusedPoint]) -> FusedPoints:
    """Fused points in the order given, as the columns of one scan; none gives empty columns."""

    def ragged(columns: list[FloatArray]) -> FloatArray:
        return np.concatenate(columns) if columns else np.zeros(0)

    return FusedPoints(
        stop=np.array([point.stop for point in points], dtype=np.int64),
        row=np.array([point.row for point in points], dtype=np.int64),
        depth_m=np.array([point.depth_m for point in points], dtype=np.float64),
        sigma_m=np.array([point.sigma_m for point in points], dtype=np.float64),
        point_m=np.array([point.point_m for point in points], dtype=np.float64).reshape(-1, 3),
        gap=np.array([int(point.gap) for point in points], dtype=np.int64),
        reset=np.array([point.reset for point in points], dtype=np.bool_),
        start=np.concatenate([[0], np.cumsum([len(point.sensor) for point in points], dtype=np.int64)]),
        sensor=np.concatenate([point.sensor for point in points]) if points else np.zeros(0, dtype=np.int64),
        dc=ragged([point.dc for point in points]),
        dc1=ragged([point.dc1 for point in points]),
        dc2=ragged([point.dc2 for point in points]),
        dc3=ragged([point.dc3 for point in points]),
        gate=np.concatenate([point.gate for point in points]) if points else np.zeros(0, dtype=np.int64),
    )
