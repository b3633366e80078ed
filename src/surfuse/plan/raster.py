"""The raster of stops over an outline: horizontal lines a step apart, stops a step apart (paper, section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.polygons import spans
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, IntArray, Outline

_ON_LATTICE = 1e-6  # share of a step by which rounding may put a boundary beside a lattice line
STOPS_MAX = 1_000_000


@dataclass(frozen=True)
class StopRaster:
    """Stops in visiting order: `uv_m` (N, 2) in the part frame, `row` (N,) the line, counted from the bottom."""

    uv_m: FloatArray
    row: IntArray


def raster(outline: Outline, step_m: float = 0.01, same_side: bool = False) -> StopRaster:
    """Stops on the lattice u = i step, v = j step inside an outline (already enlarged), from the bottom line up.

    Each line starts at one extreme of the boundary: by default at alternating ones, which is the shortest way;
    with `same_side` always at the one of least u. A line that the outline cuts into several pieces stays one row.

    Raises
    ------
    ConfigError : the step is not positive, or so small that there would be more than a million stops.
    """
    if not (np.isfinite(step_m) and step_m > 0.0):
        raise ConfigError(f"step_m = {step_m}", cure="give a step > 0 m")
    vertices = outline.vertices_m
    size = np.ptp(vertices, axis=0)
    if float(np.prod(size / step_m + 1.0)) > STOPS_MAX:
        raise ConfigError(
            f"a step of {1e3 * step_m:g} mm over {size[0]:.2f} m x {size[1]:.2f} m gives more than {STOPS_MAX} stops",
            cure="take a larger step",
        )
    lines: list[FloatArray] = []
    rows: list[IntArray] = []
    for j in _lattice(float(vertices[:, 1].min()), float(vertices[:, 1].max()), step_m):
        line = _line(outline, int(j), step_m)
        if len(line) == 0:
            continue
        backwards = len(lines) % 2 == 1 and not same_side
        lines.append(line[::-1] if backwards else line)
        rows.append(np.full(len(line), len(rows), dtype=np.int64))
    if not lines:
        return StopRaster(np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
    return StopRaster(np.vstack(lines), np.concatenate(rows))


def _lattice(low: float, high: float, step_m: float) -> IntArray:
    """Indices of the multiples of the step between two values, both included."""
    return np.arange(np.ceil(low / step_m - _ON_LATTICE), np.floor(high / step_m + _ON_LATTICE) + 1.0).astype(np.int64)


def _line(outline: Outline, j: int, step_m: float) -> FloatArray:
    """Stops (K, 2) of line j in the order of u."""
    v = outline.vertices_m[:, 1]
    # A line on the topmost or lowest edge must not miss it by rounding.
    cut = min(max(j * step_m, float(v.min())), float(v.max()))
    pieces = [_lattice(low, high, step_m) for low, high in spans(outline.vertices_m, cut)]
    if not pieces:
        return np.zeros((0, 2))
    u = np.unique(np.concatenate(pieces)) * step_m
    return np.column_stack([u, np.full(len(u), j * step_m)])


FACING = np.diag([-1.0, 1.0, -1.0])
"""How the grip (3, 3) is turned in the part frame: z along -w into the part, y along v (up), hence x along -u."""


def nearest_quarter(part_from_grip: FloatArray) -> FloatArray:
    """The rotation (3, 3) that faces the part, square to the scan lines, nearest to how the grip is turned now."""
    quarters = [FACING @ rotation_about([0.0, 0.0, 1.0], k * np.pi / 2) for k in range(4)]
    quarters = [np.round(turn) for turn in quarters]
    return max(quarters, key=lambda turn: float(np.trace(turn.T @ part_from_grip[:3, :3])))


def grip_targets(
    world_from_part: FloatArray, uv_m: FloatArray, standoff_m: float = 0.43, turn: FloatArray = FACING
) -> FloatArray:
    """Grip poses (N, 4, 4) in the world that look at points (N, 2) of the acquisition plane from the standoff.

    `turn` (3, 3) is the grip in the part frame, its z along -w.
    """
    part_from_grip = np.zeros((len(uv_m), 4, 4))
    part_from_grip[:] = pose(turn, [0.0, 0.0, standoff_m])
    part_from_grip[:, :2, 3] = uv_m
    targets: FloatArray = world_from_part @ part_from_grip
    return targets
