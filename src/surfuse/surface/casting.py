"""Ranges along arbitrary rays onto a mesh."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from surfuse.records import FloatArray, IntArray
from surfuse.surface.truth import check_mesh


class RayCaster:
    """A mesh (V, 3), (F, 3) that rays can be sent at; Embree finds the triangle, double precision the range.

    The mesh is in m, in a frame of its own, which is that of all rays.
    """

    def __init__(self, vertices_m: FloatArray, faces: IntArray) -> None:
        check_mesh(vertices_m, faces)
        self._corners = vertices_m[faces]
        # Embree works in single precision: near the origin it loses least.
        self._centre = 0.5 * (vertices_m.min(axis=0) + vertices_m.max(axis=0))
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(self._corners - self._centre, dtype=np.float32))

    def ranges(self, origin_m: FloatArray, direction: FloatArray) -> FloatArray:
        """Range (N,) from origins (N, 3) along unit directions (N, 3) to the first triangle; +inf without any."""
        hit = self._hits(origin_m, direction)
        found, met = np.full(len(origin_m), np.inf), np.flatnonzero(hit >= 0)
        a, b, c = np.moveaxis(self._corners[hit[met]], 1, 0)
        normal = np.cross(b - a, c - a)
        along = np.sum(normal * direction[met], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = np.sum(normal * (a - origin_m[met]), axis=1) / along
        found[met] = np.where(along == 0.0, np.inf, exact)
        return found

    def incidence_deg(self, origin_m: FloatArray, direction: FloatArray) -> FloatArray:
        """Angle (N,) between the rays and the normal of the triangle that they meet first; nan without any.

        Origins (N, 3) in m, unit directions (N, 3); from 0, facing, to 90 degrees, whichever side is met.
        """
        hit = self._hits(origin_m, direction)
        angle, met = np.full(len(origin_m), np.nan), np.flatnonzero(hit >= 0)
        a, b, c = np.moveaxis(self._corners[hit[met]], 1, 0)
        normal = np.cross(b - a, c - a)
        cosine = np.abs(np.sum(normal * direction[met], axis=1)) / np.linalg.norm(normal, axis=1)
        angle[met] = np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))
        return angle

    def normals(self, origin_m: FloatArray, direction: FloatArray) -> FloatArray:
        """Unit normal (N, 3) of the triangle that each ray meets first; nan without any.

        Origins (N, 3) in m, unit directions (N, 3).
        """
        hit = self._hits(origin_m, direction)
        found, met = np.full((len(origin_m), 3), np.nan), np.flatnonzero(hit >= 0)
        a, b, c = np.moveaxis(self._corners[hit[met]], 1, 0)
        normal = np.cross(b - a, c - a)
        found[met] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return found

    def _hits(self, origin_m: FloatArray, direction: FloatArray) -> IntArray:
        start = np.ascontiguousarray(origin_m - self._centre, dtype=np.float32)
        return np.asarray(self._scene.run(start, np.ascontiguousarray(direction, dtype=np.float32)), dtype=np.int64)
