"""A beam as a cone over the columns of a map: which nodes it covers, and where its sphere of equal range meets them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, MapGrid


class Beams(NamedTuple):
    """The readings of a survey as kernels take them: N cones in the part frame.

    `start` (N, 3) in m and unit `axis` (N, 3); `range_m` (N,) from the start; `spread` (N,) half the beam angle in rad,
    0 for a sensor that measures along its axis.
    """

    start: FloatArray
    axis: FloatArray
    range_m: FloatArray
    spread: FloatArray


class Nodes(NamedTuple):
    """The nodes of a map as kernels take them: `u` (C,) and `v` (R,) in m, increasing; `wanted` (R, C) are filled."""

    u: FloatArray
    v: FloatArray
    wanted: BoolArray


def nodes_of(grid: MapGrid, wanted: BoolArray) -> Nodes:
    """The nodes of a grid of R rows and C columns, those marked by `wanted` (R, C) to be filled."""
    return Nodes(np.ascontiguousarray(grid.u_m), np.ascontiguousarray(grid.v_m), wanted)


@compiled
def columns_within(
    start: FloatArray, axis: FloatArray, range_m: float, spread_rad: float, u: FloatArray, v: FloatArray
) -> tuple[int, int, int, int]:
    """First and last + 1 column and row of the nodes that a cone's cap can cover.

    The cap of a sphere within `spread_rad` of the axis lies within the chord 2 r sin(spread / 2) of the hit point.

    `start` (3,) in m and unit `axis` (3,) in the part frame, `spread_rad` is half the beam angle; `u` (C,) and `v` (R,)
    are the nodes in m, increasing. The bounds are held within the map, and the box is empty where the cap misses it.
    """
    wide = 2.0 * range_m * math.sin(0.5 * min(spread_rad, math.pi))
    cu, cv = start[0] + range_m * axis[0], start[1] + range_m * axis[1]
    return (
        int(np.searchsorted(u, cu - wide)),
        int(np.searchsorted(u, cu + wide, side="right")),
        int(np.searchsorted(v, cv - wide)),
        int(np.searchsorted(v, cv + wide, side="right")),
    )


@compiled
def columns_between(
    start: FloatArray, axis: FloatArray, near_m: float, far_m: float, spread_rad: float, u: FloatArray, v: FloatArray
) -> tuple[int, int, int, int]:
    """First and last + 1 column and row of the nodes that a cone can cover between two ranges.

    The cone is convex, so the hull of its two ends holds what lies between them.

    Arguments as in `columns_within`, with the two ranges `near_m` and `far_m`.
    """
    a0, a1, b0, b1 = columns_within(start, axis, near_m, spread_rad, u, v)
    c0, c1, d0, d1 = columns_within(start, axis, far_m, spread_rad, u, v)
    return min(a0, c0), max(a1, c1), min(b0, d0), max(b1, d1)


@compiled
def off_axis(du: float, dv: float, drop: float, axis: FloatArray, range_m: float, spread_rad: float) -> float:
    """Angle between the axis and a point (du, dv, -drop) at this range, as a share of the spread; inf behind.

    From the chord between the two directions, which stays exact near the axis.

    `axis` (3,) is a unit vector in the part frame; (du, dv) in m beside the start of the beam, `drop` in m below it.
    """
    x, y, z = du / range_m - axis[0], dv / range_m - axis[1], -drop / range_m - axis[2]
    chord = 0.5 * math.sqrt(x * x + y * y + z * z)
    return 2.0 * math.asin(min(chord, 1.0)) / spread_rad


@compiled
def shell(du: float, dv: float, axis: FloatArray, range_m: float, spread_rad: float) -> tuple[float, float]:
    """How far below the start (m) the sphere of a range meets a column at (du, dv), and its angle off the axis there.

    The angle is a share of the spread; inf where the sphere does not reach the column.

    `axis` (3,) is a unit vector in the part frame; (du, dv) in m beside the start of the beam, which is at the origin.
    """
    side = du * du + dv * dv
    if side >= range_m * range_m:
        return 0.0, math.inf
    drop = math.sqrt(range_m * range_m - side)
    return drop, off_axis(du, dv, drop, axis, range_m, spread_rad)


@compiled
def _nearest(value: float, nodes: FloatArray) -> int:
    """Index of the nearest node within half a step, or -1."""
    n = nodes.shape[0]
    k = int(np.searchsorted(nodes, value))
    if k > 0 and (k == n or value - nodes[k - 1] <= nodes[k] - value):
        k -= 1
    if n == 1:
        return k
    step = nodes[k + 1] - nodes[k] if k + 1 < n and (k == 0 or value > nodes[k]) else nodes[k] - nodes[k - 1]
    return k if abs(value - nodes[k]) <= 0.5 * step * (1.0 + 1e-9) else -1


@compiled
def nearest_node(at_u: float, at_v: float, u: FloatArray, v: FloatArray) -> tuple[int, int]:
    """Row and column of the node whose cell a point lies in; (-1, -1) outside of the map.

    `u` (C,) and `v` (R,) are increasing, in m as the point is. A cell reaches half a step to both sides of its node.
    """
    c, k = _nearest(at_u, u), _nearest(at_v, v)
    return (k, c) if k >= 0 and c >= 0 else (-1, -1)
