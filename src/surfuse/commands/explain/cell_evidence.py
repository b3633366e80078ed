"""What a cell of a map rests on: the stops that were put into it, or the readings whose beams cover it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.commands.explain.map_source import MapSource
from surfuse.errors import UsageError
from surfuse.geometry.poses import inverse, rotate_vectors, transform_points
from surfuse.records import BoolArray, FloatArray, FusedPoints, Gap, IntArray, MapGrid, Readings
from surfuse.surface.gridding import grid_points

SAME_HEIGHT_M = 1e-9


@dataclass(frozen=True)
class Evidence:
    """The cell (row, column) of the map's grid and what is behind it.

    With `by_stops` the cell is the average of the stops `stops` (indices of sweeps), each by its own readings; else
    the method made its map from all readings at once, and `stops` are all that have a reading in `rows`.
    `rows` are the indices of the readings, `hit_m` (K, 3) where their own axes end, in the part frame, `footprint_m`
    (K,) the radius of the beam there, `off_axis_rad` (K,) the angle from the axis under which the sensor sees the cell,
    `distance_m` (K,) from the sensor to the cell, and `value_m` (K,) the range along the grip axis of the sweep.
    """

    row: int
    column: int
    by_stops: bool
    stops: IntArray
    rows: IntArray
    hit_m: FloatArray
    footprint_m: FloatArray
    off_axis_rad: FloatArray
    distance_m: FloatArray
    value_m: FloatArray


def evidence_at(source: MapSource, u_m: float, v_m: float) -> Evidence:
    """What lies behind the cell whose node is nearest to (u, v).

    Raises
    ------
    UsageError : (u, v) is not on the map; the message gives its extent.
    """
    row, column = _cell(source.surface.grid, u_m, v_m)
    member = _stops_in(source.points, source.surface.grid, row, column)
    by_stops = _made_of_points(source, row, column, member)
    sweep = np.repeat(np.arange(source.readings.n_sweeps), np.diff(source.readings.start))
    hit, radius, angle, distance = _beams(source, row, column)
    if by_stops:
        rows = np.flatnonzero(member[sweep])
    else:
        rows = np.flatnonzero(angle <= _half_beam(source.readings))
        rows = rows[np.argsort(angle[rows], kind="stable")]
    return Evidence(
        row=row,
        column=column,
        by_stops=by_stops,
        stops=np.flatnonzero(member) if by_stops else np.unique(sweep[rows]),
        rows=rows,
        hit_m=hit[rows],
        footprint_m=radius[rows],
        off_axis_rad=angle[rows],
        distance_m=distance[rows],
        value_m=on_grip_axis(source.readings)[rows],
    )


def on_grip_axis(readings: Readings) -> FloatArray:
    """Each range (N,) as a range along the grip axis of its sweep: m = r (a . g) + (p - o) . g (see validation)."""
    sweep = np.repeat(np.arange(readings.n_sweeps), np.diff(readings.start))
    grip = readings.world_from_grip[sweep]
    origin, direction = grip[:, :3, 3], grip[:, :3, 2]
    along = np.sum(readings.axis * direction, axis=1)
    with np.errstate(invalid="ignore"):
        value = readings.range_m * along + np.sum((readings.position_m - origin) * direction, axis=1)
    return np.asarray(value, dtype=np.float64)


def _cell(grid: MapGrid, u_m: float, v_m: float) -> tuple[int, int]:
    place = []
    for name, value, nodes in (("v", v_m, grid.v_m), ("u", u_m, grid.u_m)):
        slack = 0.5 * float(np.median(np.diff(nodes))) if len(nodes) > 1 else np.inf
        if not nodes[0] - slack - 1e-9 <= value <= nodes[-1] + slack + 1e-9:
            raise UsageError(
                f"{name} = {1e3 * value:g} mm is not on the map",
                cure=f"{name} runs from {1e3 * nodes[0]:.1f} to {1e3 * nodes[-1]:.1f} mm",
            )
        place.append(int(np.argmin(np.abs(nodes - value))))
    return place[0], place[1]


def _alone(grid: MapGrid, row: int, column: int) -> tuple[FloatArray, FloatArray]:
    """Borders of a cell along v and along u: half a step to either side, any distance where there is one node."""
    borders = []
    for nodes, index in ((grid.v_m, row), (grid.u_m, column)):
        middle = 0.5 * (nodes[1:] + nodes[:-1])
        steps = np.diff(nodes)
        low = middle[index - 1] if index > 0 else nodes[0] - (0.5 * steps[0] if len(steps) else np.inf)
        high = middle[index] if index < len(middle) else nodes[-1] + (0.5 * steps[-1] if len(steps) else np.inf)
        borders.append(np.array([low, high]))
    return borders[0], borders[1]


def _stops_in(points: FusedPoints, grid: MapGrid, row: int, column: int) -> BoolArray:
    """Stops (M,) whose fused point lies in the cell."""
    along_v, along_u = _alone(grid, row, column)
    u, v = points.point_m[:, 0], points.point_m[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (u > along_u[0]) & (u <= along_u[1]) & (v > along_v[0]) & (v <= along_v[1])
    return np.asarray(inside & (points.gap == int(Gap.NONE)), dtype=np.bool_)


def _made_of_points(source: MapSource, row: int, column: int, member: BoolArray) -> bool:
    """Whether the map is its points on the grid: the same height here, or, in a cell without one, elsewhere."""
    surface = source.surface
    regridded = grid_points(source.points, surface.grid, surface.method)
    both = surface.mask & regridded.mask
    if surface.mask[row, column]:
        both = np.zeros_like(both)
        both[row, column] = regridded.mask[row, column] and bool(np.any(member))
    return bool(np.any(both)) and bool(
        np.all(np.abs(surface.height_m[both] - regridded.height_m[both]) <= SAME_HEIGHT_M)
    )


def _half_beam(readings: Readings) -> FloatArray:
    return np.array([0.5 * spec.beam_full_angle_rad for spec in readings.specs])[readings.sensor]


def _beams(source: MapSource, row: int, column: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Own-axis ends (N, 3), footprints (N,), and angle and distance (N,) of the cell as each sensor sees it."""
    readings, surface = source.readings, source.surface
    part_from_world = inverse(surface.grid.world_from_part)
    position = transform_points(part_from_world, readings.position_m)
    axis = rotate_vectors(part_from_world, readings.axis)
    known = surface.height_m[surface.mask]
    typical = float(np.median(known)) if len(known) else 0.0
    height = float(surface.height_m[row, column]) if surface.mask[row, column] else typical
    cell = np.array([surface.grid.u_m[column], surface.grid.v_m[row], height])
    with np.errstate(invalid="ignore"):
        hit = position + np.where(np.isfinite(readings.range_m), readings.range_m, np.nan)[:, None] * axis
        radius = np.where(np.isfinite(readings.range_m), readings.range_m, np.nan) * np.tan(_half_beam(readings))
    towards = cell - position
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.sum(towards * axis, axis=1) / np.where(distance > 0.0, distance, 1.0)
    return hit, radius, np.arccos(np.clip(cosine, -1.0, 1.0)), distance
