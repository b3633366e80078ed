"""Outward offset of a simple polygon: mitred corners, self-intersections removed by winding numbers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.polygons import counter_clockwise, is_simple, signed_area

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MITRE_LIMIT = 2.0  # corners sharper than 60 degrees are cut square, so that no spike grows out of them
_STRAIGHT = 1e-9  # sine of the turn below which a vertex lies on a straight line


def offset(polygon: npt.ArrayLike, distance: float) -> FloatArray:
    """Enlarge a simple polygon (P, 2) outwards by a distance: (Q, 2), counter-clockwise.

    Edges move outwards parallel to themselves; convex corners stay corners (mitre), those sharper than 60 degrees
    are cut square at the distance. Every point within the distance of the polygon is inside the result; notches
    narrower than twice the distance close, and a hole that this leaves is filled. The raw offset curve keeps the
    points of positive winding number (Chen and McMains, Polygon offsetting by computing winding numbers, 2005).

    Raises
    ------
    DataError : the polygon crosses itself or has no area, or the distance is negative or not finite.
    """
    vertices = _without_repeats(counter_clockwise(polygon))
    if not (np.isfinite(distance) and distance >= 0.0):
        raise DataError(f"offset distance {distance}", cure="give a finite distance >= 0")
    if len(vertices) < 3 or not is_simple(vertices) or not signed_area(vertices) > 0.0:
        raise DataError(f"the polygon of {len(vertices)} vertices crosses itself or has no area")
    if distance == 0.0:
        return vertices
    raw, convex = _raw_offset(vertices, distance)
    return raw if convex else _outer_boundary(raw)


def _without_repeats(vertices: FloatArray) -> FloatArray:
    return vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]


def _raw_offset(vertices: FloatArray, distance: float) -> tuple[FloatArray, bool]:
    """The offset edges joined corner by corner, perhaps crossing themselves, and whether all corners are convex."""
    edge = np.roll(vertices, -1, axis=0) - vertices
    edge /= np.linalg.norm(edge, axis=1)[:, None]
    normal_out = np.column_stack([edge[:, 1], -edge[:, 0]])
    points: list[FloatArray] = []
    convex = True
    for i, vertex in enumerate(vertices):
        before, after = normal_out[i - 1], normal_out[i]
        turn = float(before[0] * after[1] - before[1] * after[0])
        cosine = float(before @ after)
        if turn < -_STRAIGHT:
            # Through the vertex itself: the loop that this makes has no positive winding of its own.
            points += [vertex + distance * before, vertex, vertex + distance * after]
            convex = False
        elif 1.0 + cosine >= 2.0 / MITRE_LIMIT**2:
            points.append(vertex + distance * (before + after) / (1.0 + cosine))
        else:
            points += _square_corner(vertex, edge[i - 1], before, after, edge[i], distance)
    return np.array(points), convex


def _square_corner(
    vertex: FloatArray,
    edge_in: FloatArray,
    normal_in: FloatArray,
    normal_out: FloatArray,
    edge_out: FloatArray,
    distance: float,
) -> list[FloatArray]:
    """Cut a sharp corner by the line perpendicular to its bisector that touches the circle of the distance."""
    quarter_turn = np.tan(0.25 * np.arccos(np.clip(float(normal_in @ normal_out), -1.0, 1.0)))
    return [
        vertex + distance * (normal_in + quarter_turn * edge_in),
        vertex + distance * (normal_out - quarter_turn * edge_out),
    ]


def _outer_boundary(raw: FloatArray) -> FloatArray:
    """The outermost loop around the points of positive winding number of a closed curve (M, 2)."""
    size = float(np.max(np.ptp(raw, axis=0)))
    origin = raw.mean(axis=0)
    tolerance = 1e-9 * size
    start, end = _split_at_crossings(raw - origin, tolerance)
    direction = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    left = np.column_stack([-direction[:, 1], direction[:, 0]])
    middle = 0.5 * (start + end)
    nudge = 2.0 * tolerance * left
    closed = raw - origin
    boundary = (_winding(middle + nudge, closed) > 0) & (_winding(middle - nudge, closed) <= 0)
    loops = _loops(start[boundary], end[boundary], tolerance)
    outer = max(loops, key=signed_area, default=np.zeros((0, 2)))
    if len(outer) < 3 or not signed_area(outer) > 0.0:
        raise DataError(
            f"a polygon with {len(raw)} offset points has no clean offset", cure="simplify the outline, or use a margin"
        )
    result: FloatArray = _without_straight(outer) + origin
    return result


def _split_at_crossings(closed: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray]:
    """Cut the edges of a closed curve (M, 2) wherever another edge crosses or touches them."""
    start, end = closed, np.roll(closed, -1, axis=0)
    long_enough = np.linalg.norm(end - start, axis=1) > tolerance
    start, end = start[long_enough], end[long_enough]
    pieces: list[FloatArray] = []
    for a, b in zip(start, end, strict=True):
        along = b - a
        length = float(np.hypot(*along))
        cuts = np.unique(np.clip(_cut_parameters(a, along, start, end, tolerance), 0.0, 1.0))
        cuts = np.concatenate([[0.0], cuts[(cuts * length > tolerance) & ((1.0 - cuts) * length > tolerance)], [1.0]])
        keep = np.concatenate([[True], np.diff(cuts) * length > tolerance])
        nodes = a + cuts[keep, None] * along
        nodes[-1] = b
        pieces.append(np.hstack([nodes[:-1], nodes[1:]]))
    cut = np.vstack(pieces)
    return cut[:, :2], cut[:, 2:]


def _cut_parameters(
    a: FloatArray, along: FloatArray, start: FloatArray, end: FloatArray, tolerance: float
) -> FloatArray:
    """Where along the segment a + t along the segments start-end cross it or end on it: values of t."""
    other = end - start
    gap = start - a
    cross = along[0] * other[:, 1] - along[1] * other[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (gap[:, 0] * other[:, 1] - gap[:, 1] * other[:, 0]) / cross
        s = (gap[:, 0] * along[1] - gap[:, 1] * along[0]) / cross
    crossing = t[(t > 0.0) & (t < 1.0) & (s >= 0.0) & (s <= 1.0)]
    foot = gap @ along / (along @ along)
    off_line = np.linalg.norm(gap - foot[:, None] * along, axis=1)
    return np.concatenate([crossing, foot[(off_line < tolerance) & (foot > 0.0) & (foot < 1.0)]])


def _winding(points: FloatArray, closed: FloatArray) -> IntArray:
    """Winding numbers (N,) of a closed curve (M, 2) around points (N, 2), by signed crossings of a ray along +x."""
    winding = np.zeros(len(points), dtype=np.int64)
    for (ax, ay), (bx, by) in zip(closed, np.roll(closed, -1, axis=0), strict=True):
        up, down = (ay <= points[:, 1]) & (by > points[:, 1]), (by <= points[:, 1]) & (ay > points[:, 1])
        side = (bx - ax) * (points[:, 1] - ay) - (points[:, 0] - ax) * (by - ay)
        winding += (up & (side > 0.0)).astype(np.int64) - (down & (side < 0.0))
    return winding


def _loops(start: FloatArray, end: FloatArray, tolerance: float) -> list[FloatArray]:
    """Chain directed pieces into closed loops; where several leave a node, the sharpest right turn is outermost."""
    free = np.ones(len(start), dtype=bool)
    loops: list[FloatArray] = []
    while np.any(free):
        chain = [int(np.flatnonzero(free)[0])]
        free[chain[0]] = False
        while np.linalg.norm(end[chain[-1]] - start[chain[0]]) > 4.0 * tolerance:
            gap = np.linalg.norm(start - end[chain[-1]], axis=1)
            near = np.flatnonzero(free & (gap <= 4.0 * tolerance))
            if len(near) == 0:
                break
            along = end[chain[-1]] - start[chain[-1]]
            out = end[near] - start[near]
            turn = np.arctan2(along[0] * out[:, 1] - along[1] * out[:, 0], out @ along)
            chain.append(int(near[np.argmin(turn)]))
            free[chain[-1]] = False
        else:
            loops.append(start[chain])
    return loops


def _without_straight(loop: FloatArray) -> FloatArray:
    """Drop the vertices where the boundary runs straight on."""
    into, out = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    scale = np.linalg.norm(into, axis=1) * np.linalg.norm(out, axis=1)
    corners: FloatArray = loop[(np.abs(cross) > _STRAIGHT * scale) | (np.sum(into * out, axis=1) < 0.0)]
    return corners
