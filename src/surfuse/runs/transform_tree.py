"""The frames of a ROS 2 log over time: poses of a frame in the root, interpolated between /tf messages.

Between two transforms the position moves linearly and the rotation along the great arc (slerp, Shoemake 1985), as
tf2 does. Outside the recorded time nothing is extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import FloatArray
from surfuse.records import BoolArray, IntArray


@dataclass
class _Edge:
    parent: str
    static: bool
    time_ns: list[int] = field(default_factory=list)
    value: list[tuple[float, ...]] = field(default_factory=list)


class TransformTree:
    """Collects transforms parent <- child and answers where a frame was."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all child frames."""
        return tuple(self._edges)

    def add(self, parent: str, child: str, time_ns: int, value: tuple[float, ...], static: bool) -> None:
        """One transform: translation x, y, z in m and quaternion x, y, z, w.

        Raises
        ------
        DataError : a child with two parents, a value that is not finite, or a quaternion of length 0.
        """
        norm = float(np.linalg.norm(value[3:]))
        if not (np.all(np.isfinite(value)) and norm > 0.5):
            raise DataError(f"the transform {parent} -> {child} is {value}", cure="check the publisher of /tf")
        edge = self._edges.setdefault(child, _Edge(parent, static))
        if edge.parent != parent:
            raise DataError(
                f"the frame '{child}' hangs on '{edge.parent}' and on '{parent}'", cure="keep one of the publishers"
            )
        edge.time_ns.append(time_ns)
        edge.value.append((*value[:3], *(q / norm for q in value[3:])))

    def root(self, frame: str) -> str:
        """The frame that `frame` hangs on in the end.

        Raises
        ------
        DataError : the frames form a ring.
        """
        seen = [frame]
        while seen[-1] in self._edges:
            parent = self._edges[seen[-1]].parent
            if parent in seen:
                raise DataError(f"the frames {' -> '.join(seen)} form a ring", cure="check the publishers of /tf")
            seen.append(parent)
        return seen[-1]

    def poses(self, frame: str, time_ns: IntArray) -> tuple[FloatArray, BoolArray]:
        """Root-from-frame poses (N, 4, 4) at times (N,), and which of them lie within the recorded time."""
        result = np.tile(np.eye(4), (len(time_ns), 1, 1))
        known = np.ones(len(time_ns), dtype=np.bool_)
        while frame in self._edges:
            edge = self._edges[frame]
            step, inside = _interpolate(edge, time_ns)
            result, known = step @ result, known & inside
            frame = edge.parent
        return result, known


def _interpolate(edge: _Edge, time_ns: IntArray) -> tuple[FloatArray, BoolArray]:
    stamps, first = np.unique(np.array(edge.time_ns, dtype=np.int64), return_index=True)
    values = np.array(edge.value)[first]
    if edge.static:
        return np.repeat(_matrices(values[-1:]), len(time_ns), axis=0), np.ones(len(time_ns), dtype=np.bool_)
    inside: BoolArray = (time_ns >= stamps[0]) & (time_ns <= stamps[-1])
    after = np.clip(np.searchsorted(stamps, time_ns, side="left"), 1 if len(stamps) > 1 else 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    span = np.maximum(stamps[after] - stamps[before], 1)
    share = np.clip((time_ns - stamps[before]) / span, 0.0, 1.0)[:, None]
    a, b = values[before], values[after]
    mixed = np.concatenate([(1.0 - share) * a[:, :3] + share * b[:, :3], _slerp(a[:, 3:], b[:, 3:], share)], axis=1)
    return _matrices(mixed), inside


def _slerp(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    cosine = np.sum(a * b, axis=1, keepdims=True)
    b, cosine = np.where(cosine < 0.0, -b, b), np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    # Close together the arc is a straight line, and the sine below would be 0.
    near = angle < 1e-6
    sine = np.where(near, 1.0, np.sin(angle))
    wa = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / sine)
    wb = np.where(near, share, np.sin(share * angle) / sine)
    mixed: FloatArray = wa * a + wb * b
    length: FloatArray = np.linalg.norm(mixed, axis=1, keepdims=True)
    return mixed / length


def _matrices(values: FloatArray) -> FloatArray:
    """Poses (N, 4, 4) of rows x, y, z, qx, qy, qz, qw."""
    x, y, z, w = values[:, 3:].T
    result = np.tile(np.eye(4), (len(values), 1, 1))
    result[:, :3, 3] = values[:, :3]
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:, :3, :3] = np.moveaxis(np.array(rotation), -1, 0)
    return result
