"""Sharp edges of a scene as points that scatter sound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.records import FloatArray, IntArray
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene

SHARP_RAD = float(np.radians(25.0))
STAND_OFF_M = 0.002
_MOST_POINTS = 40_000


@dataclass(frozen=True)
class EdgePoints:
    """Scatter points along sharp edges, world frame: `position_m` (K, 3), just off the edge, in free space.

    `tangent` (K, 3) unit along the edge, `faces` (K, 2, 3) the unit normals of the two faces that meet there (of a
    sheet's rim: the same twice), `length_m` (K,) of edge that the point stands for.
    """

    position_m: FloatArray
    tangent: FloatArray
    faces: FloatArray
    length_m: FloatArray


NO_EDGES = EdgePoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))


def sharp_edges(scene: Scene, spacing_m: float) -> EdgePoints:
    """Points every `spacing_m` along convex edges sharper than 25 degrees and along the rims of sheets.

    The floor has none: its rim is the end of the model, not of a thing. With more edges than 40,000 points the
    spacing is widened.
    """
    wanted = scene.material != int(Material.FLOOR)
    triangles, normal = scene.triangles[wanted], scene.normal[wanted]
    ends, out, owners = _sharp(scene.vertices_m, triangles, normal)
    start, span = scene.vertices_m[ends[:, 0]], scene.vertices_m[ends[:, 1]] - scene.vertices_m[ends[:, 0]]
    length = np.linalg.norm(span, axis=1)
    keep = length > 1e-6
    start, span, length, out, owners = start[keep], span[keep], length[keep], out[keep], owners[keep]
    if not len(length):
        return NO_EDGES
    spacing = max(spacing_m, float(length.sum()) / _MOST_POINTS)
    pieces = np.maximum(1, np.ceil(length / spacing)).astype(np.int64)
    edge = np.repeat(np.arange(len(length)), pieces)
    first = np.concatenate([[0], np.cumsum(pieces)[:-1]])
    along = (np.arange(len(edge)) - first[edge] + 0.5) / pieces[edge]
    position = start[edge] + along[:, None] * span[edge] + STAND_OFF_M * out[edge]
    return EdgePoints(
        np.ascontiguousarray(position),
        np.ascontiguousarray(span[edge] / length[edge, None]),
        np.ascontiguousarray(normal[owners[edge]]),
        np.ascontiguousarray(length[edge] / pieces[edge]),
    )


def _sharp(vertices: FloatArray, triangles: IntArray, normal: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Sharp edges: vertex pairs (E, 2), unit directions (E, 3) away from the material, triangles (E, 2) beside them."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    pairs, index, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(index.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    centre = vertices[triangles].mean(axis=1)
    shared = np.flatnonzero(count == 2)
    a, b = owner[order[first[shared]]], owner[order[first[shared] + 1]]
    cosine = np.einsum("ij,ij->i", normal[a], normal[b])
    convex = np.einsum("ij,ij->i", normal[a], centre[b] - centre[a]) < 0.0
    kept = (cosine < np.cos(SHARP_RAD)) & convex
    bisector = normal[a[kept]] + normal[b[kept]]
    rim = np.flatnonzero(count == 1)
    lonely = owner[order[first[rim]]]
    outward = 0.5 * (vertices[pairs[rim, 0]] + vertices[pairs[rim, 1]]) - centre[lonely]
    out = np.vstack([bisector, outward])
    size = np.linalg.norm(out, axis=1, keepdims=True)
    owners = np.vstack([np.column_stack([a[kept], b[kept]]), np.column_stack([lonely, lonely])])
    return pairs[np.concatenate([shared[kept], rim])], out / np.where(size > 0.0, size, 1.0), owners
