"""Which pieces of a true mesh belong to the part that was scanned, when several parts stand on the table."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, IntArray, Outline


def pieces_of_part(vertices_m: FloatArray, triangles: IntArray, outline: Outline) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3) in the world and triangles (F, 3) of the pieces that overlap the outline; all when none does.

    A piece is what hangs together by shared vertices. It overlaps when the boxes of both, in the part frame along u and
    v, have something in common; a piece of the scanned part that is hidden in the picture stays too.
    """
    count = len(vertices_m)
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_array((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), shape=(count, count))
    pieces, piece = connected_components(graph, directed=False)
    if pieces == 1:
        return vertices_m, triangles
    seen = transform_points(inverse(outline.world_from_part), vertices_m)[:, :2]
    low, high = outline.vertices_m.min(axis=0), outline.vertices_m.max(axis=0)
    first, last = np.full((pieces, 2), np.inf), np.full((pieces, 2), -np.inf)
    np.minimum.at(first, piece, seen)
    np.maximum.at(last, piece, seen)
    mine = np.all((first <= high) & (last >= low), axis=1)
    kept = triangles[mine[piece[triangles[:, 0]]]]
    if len(kept) in (0, len(triangles)):
        return vertices_m, triangles
    used, renumbered = np.unique(kept, return_inverse=True)
    return vertices_m[used], renumbered.reshape(-1, 3).astype(np.int64)
