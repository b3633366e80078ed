"""From single readings to sweeps: which belong together, the grip pose of each sweep, its scan line, the part frame."""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import FloatArray, pose
from surfuse.records import IntArray

_SAME_ROW = 0.5
_LONG_MOVE = 1.25


def group_by_repeat(sensor: IntArray) -> IntArray:
    """Sweep number (N,) of each reading: a new sweep begins when a sensor comes again."""
    sweep = np.empty(len(sensor), dtype=np.int64)
    current = -1
    seen: set[int] = set()
    for i, name in enumerate(sensor.tolist()):
        if current < 0 or name in seen:
            current += 1
            seen.clear()
        seen.add(name)
        sweep[i] = current
    return sweep


def sweep_means(start: IntArray, values: FloatArray) -> FloatArray:
    """Means (M, D) over the rows (N, D) of each sweep."""
    means: FloatArray = np.add.reduceat(values, start[:-1], axis=0) / np.diff(start)[:, None]
    return means


def grip_poses(start: IntArray, position_m: FloatArray, axis: FloatArray, x_hint: FloatArray) -> FloatArray:
    """World-from-grip poses (M, 4, 4) of sweeps: mean position, z along the mean axis, x nearest to `x_hint` (3,).

    Source: SPEC, "the grip axis of a sweep is the mean of its sensors' positions and axes".

    Raises
    ------
    DataError : the axes of a sweep cancel out.
    """
    centre, z = sweep_means(start, position_m), sweep_means(start, axis)
    norm = np.linalg.norm(z, axis=1, keepdims=True)
    if np.any(norm < 0.1):
        raise DataError(
            f"the sensor axes of sweep {int(np.argmin(norm))} point against one another",
            cure="give the sensors of one stop axes that point at the part",
        )
    z = z / norm
    x = x_hint - (z @ x_hint)[:, None] * z
    # Where the hint runs along the beam it says nothing; then the grip takes another fixed direction.
    parallel = np.linalg.norm(x, axis=1) < 0.1
    if np.any(parallel):
        other = np.roll(x_hint, 1) if abs(float(np.roll(x_hint, 1) @ x_hint)) < 0.9 else np.array([0.0, 0.0, 1.0])
        x[parallel] = other - (z[parallel] @ other)[:, None] * z[parallel]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(z), 1, 1))
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2], poses[:, :3, 3] = x, np.cross(z, x), z, centre
    return poses


def line_direction(points: FloatArray) -> FloatArray | None:
    """Unit direction (D,) along which consecutive points (M, D) mostly move, or None when they do not move.

    The principal axis of the steps between neighbours; long moves (more than 1.25 medians: returns to the
    start of a line) do not count.
    """
    steps = np.diff(points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    moving = length > 1e-9
    if not np.any(moving):
        return None
    short = moving & (length <= _LONG_MOVE * np.median(length[moving]))
    _, vectors = np.linalg.eigh(steps[short].T @ steps[short])
    direction: FloatArray = vectors[:, -1]
    return direction * (1.0 if direction[np.argmax(np.abs(direction))] > 0.0 else -1.0)


def row_numbers(uv_m: FloatArray) -> IntArray:
    """Scan line (M,) of each stop at uv_m (M, 2): a new line begins when the stop leaves the current one sideways.

    Sideways is perpendicular to `line_direction`; the limit is half the median step from where the line began.
    """
    rows = np.zeros(len(uv_m), dtype=np.int64)
    direction = line_direction(uv_m) if len(uv_m) > 1 else None
    if direction is None:
        return rows
    length = np.linalg.norm(np.diff(uv_m, axis=0), axis=1)
    limit = _SAME_ROW * float(np.median(length[length > 1e-9]))
    sideways = (uv_m @ np.array([-direction[1], direction[0]])).tolist()
    row, begin = 0, sideways[0]
    for j, offset in enumerate(sideways):
        if abs(offset - begin) > limit:
            row, begin = row + 1, offset
        rows[j] = row
    return rows


def estimate_part_frame(centre_m: FloatArray, beam: FloatArray, range_m: FloatArray) -> FloatArray:
    """A part frame (4, 4) for readings that come without one.

    Parameters are the centres (M, 3) of the sweeps in the order of time, the mean beam (3,), and all ranges.
    w is against the mean beam; u is the main direction of motion across the beam, or a horizontal one when nothing
    moves; v = w x u points up where it can. The origin lies below the mean centre, at the median range.

    Raises
    ------
    DataError : the beams point in all directions, so that there is no common one.
    """
    if np.linalg.norm(beam) < 0.1:
        raise DataError(
            "no part frame can be estimated: the sensor axes have no common direction", cure="give a frame.toml"
        )
    beam = beam / np.linalg.norm(beam)
    u = line_direction(centre_m - np.outer(centre_m @ beam, beam))
    if u is None or abs(float(u @ beam)) > 0.9:
        u = np.cross([0.0, 0.0, 1.0], -beam) if abs(beam[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = u - (u @ beam) * beam
    u = u / np.linalg.norm(u)
    v = np.cross(-beam, u)
    if v[2] < -0.1 or (abs(v[2]) <= 0.1 and u[np.argmax(np.abs(u))] < 0.0):
        u, v = -u, -v
    echoes = range_m[np.isfinite(range_m)]
    depth = float(np.median(echoes)) if len(echoes) else 0.0
    return pose(np.column_stack([u, v, -beam]), centre_m.mean(axis=0) + depth * beam)
